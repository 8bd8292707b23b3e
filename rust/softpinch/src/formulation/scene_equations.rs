//! The equations of a scene after the choice of formulation, fingers and ledger. Step loops and methods call
//! them without knowing this choice.
//!
//! They are written once for all numbers: lanes, dual numbers of lanes for Jacobians, and the dual numbers of a run
//! with derivatives. Each call goes to code that is compiled once for each kind of numbers. In lanes a call costs
//! little (measured: docs/what-a-scene-pays.md), so step loops and methods are compiled once, not once for each
//! formulation.

use crate::formulation::contact_equations::ContactEquations;
use crate::formulation::csm::Csm;
use crate::formulation::equations::{Equations, Evaluation, MAX_COMPONENTS, States};
use crate::formulation::inlined::Inlined;
use crate::formulation::nullspace::Nullspace;
use crate::formulation::projected;
use crate::formulation::system::{Jacobian, Linear, Size, StageState, Stages, System};
use crate::formulation::table::Formulation;
use crate::formulation::unilateral::Unilateral;
use crate::model::contact_modes::{ContactModel, Contacts};
use crate::model::control::{Actuated, Driven, Fingers};
use crate::model::drive::{Input, SegmentDrive};
use crate::model::energy::Energies;
use crate::model::forces::Plant;
use crate::model::motion::Motion;
use crate::model::parameters::Stabilization;
use crate::model::source::Source;
use crate::number::dual::Dual;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::real::Real;
use crate::number::simd::level::Instructions;

/// The kinds of equations.
#[derive(Debug, Clone, Copy)]
pub(crate) enum EquationKind<R> {
    Csm(Csm<R, Actuated<R>>),
    CsmDriven(Csm<R, Driven>),
    Nullspace(Nullspace<R, Actuated<R>>),
    NullspaceDriven(Nullspace<R, Driven>),
    Unilateral(Unilateral<R, Actuated<R>>),
    UnilateralDriven(Unilateral<R, Driven>),
}

/// Evaluates one expression with the equations of any kind. No code is compiled for unilateral contact if the
/// constant in brackets is false; then no equations are of its kinds.
macro_rules! with {
    ($kind:expr, $equations:ident => $body:expr) => {
        with!($kind, $equations [true] => $body)
    };
    ($kind:expr, $equations:ident [$unilateral:expr] => $body:expr) => {
        match &$kind {
            EquationKind::Csm($equations) => $body,
            EquationKind::CsmDriven($equations) => $body,
            EquationKind::Nullspace($equations) => $body,
            EquationKind::NullspaceDriven($equations) => $body,
            EquationKind::Unilateral($equations) if $unilateral => $body,
            EquationKind::UnilateralDriven($equations) if $unilateral => $body,
            EquationKind::Unilateral(Unilateral { csm: $equations, .. }) => $body,
            EquationKind::UnilateralDriven(Unilateral { csm: $equations, .. }) => $body,
        }
    };
}
pub(crate) use with;

impl<R: Real> EquationKind<R> {
    /// The equations of a scene, or of one scene for each lane.
    #[inline(always)]
    fn new(choice: Choice, source: &impl Source<R>, gains: &Stabilization) -> Self {
        let Choice { formulation, contact, fingers, .. } = choice;
        let gains = match formulation {
            Formulation::Csm => *gains,
            Formulation::Nullspace | Formulation::Projected => Stabilization { alpha: 0.0, beta: 0.0 },
        };
        match (contact, formulation, fingers) {
            (ContactModel::Unilateral, _, Fingers::Driven) => {
                Self::UnilateralDriven(Unilateral::new(source, fingers, &gains))
            }
            (ContactModel::Unilateral, ..) => Self::Unilateral(Unilateral::new(source, fingers, &gains)),
            (_, Formulation::Nullspace, Fingers::Driven) => {
                Self::NullspaceDriven(Nullspace::new(Plant::new(source, fingers)))
            }
            (_, Formulation::Nullspace, _) => Self::Nullspace(Nullspace::new(Plant::new(source, fingers))),
            (_, _, Fingers::Driven) => Self::CsmDriven(Csm::new(Plant::new(source, fingers), &gains)),
            _ => Self::Csm(Csm::new(Plant::new(source, fingers), &gains)),
        }
    }
}

/// The numbers of components of the equations' states, with or without the works of the ledger.
#[inline(always)]
pub(super) fn size_of<R: Real, E: Equations<R>>(_: &E, ledger: bool) -> Size {
    Size { states: E::STATES, degrees: E::DEGREES, works: if ledger { E::WORKS } else { 0 } }
}

/// The choice of equations, and whether their state carries the ledger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    /// The formulation of the constraints.
    pub formulation: Formulation,
    /// What the contacts can do.
    pub contact: ContactModel,
    /// How the fingers move.
    pub fingers: Fingers,
    /// Whether the state carries the works of the ledger.
    pub ledger: bool,
}

/// The equations of a scene, or of one scene for each lane, after the choice.
#[derive(Debug, Clone, Copy)]
pub struct SceneEquations<R> {
    instructions: Instructions,
    ledger: bool,
    projected: bool,
    pub(crate) kind: EquationKind<R>,
}

/// The equations of a scene in dual numbers with `W` directions.
pub type Tangent<R, const W: usize> = SceneEquations<Dual<R, W>>;

/// Builds equations. Lanes need this whenever one of their runs changes. The code is called, not inlined.
struct Build<'a, S>(Choice, &'a S, &'a Stabilization);

impl<R: Lanes, S: Source<R>> LaneTask<R> for Build<'_, S> {
    type Output = EquationKind<R>;

    #[inline(always)]
    fn run(self) -> EquationKind<R> {
        let Self(choice, source, gains) = self;
        EquationKind::new(choice, source, gains)
    }
}

impl<R: Lanes> SceneEquations<R> {
    /// Builds the equations of a scene, or of one scene for each lane.
    pub fn new(
        instructions: Instructions,
        choice: Choice,
        source: &impl Source<R>,
        gains: &Stabilization,
    ) -> Self {
        Self {
            instructions,
            ledger: choice.ledger,
            projected: choice.formulation == Formulation::Projected,
            kind: R::call(instructions, Build(choice, source, gains)),
        }
    }
}

/// Copies the components of a derivative that the equations compute.
#[inline(always)]
fn copy_computed<R: Real, E: Equations<R>>(rate: &mut States<R>, found: &States<R>, ledger: bool) {
    rate[..E::STATES].copy_from_slice(&found[..E::STATES]);
    if ledger {
        let works = E::STATES..E::STATES + E::WORKS;
        rate[works.clone()].copy_from_slice(&found[works]);
    }
}

/// Declares a use of the equations as a task, so that its code is compiled with the instructions of the
/// lanes.
macro_rules! task {
    ($name:ident($($field:ident: $type:ty),*) -> $output:ty, $equations:ident => $body:expr) => {
        pub(super) struct $name<'a, R, E> {
            pub(super) equations: &'a E,
            $(pub(super) $field: $type),*
        }

        impl<R: Lanes, E: Equations<R>> LaneTask<R> for $name<'_, R, E> {
            type Output = $output;

            #[inline(always)]
            fn run(self) -> $output {
                let Self { equations: $equations, $($field),* } = self;
                $body
            }
        }
    };
}
task! {
    Evaluate(drive: &'a SegmentDrive<R>, tau: R, y: &'a States<R>, now: &'a mut Evaluation<R>, ledger: bool) -> (),
    equations => {
        let found = equations.evaluate(&drive.at(tau), &drive.contacts, y, ledger);
        copy_computed::<R, E>(&mut now.rate, &found.rate, ledger);
        now.motion = found.motion;
        now.multipliers = found.multipliers;
        now.residuals = found.residuals;
        now.tilt = found.tilt;
        now.sin_tilt = found.sin_tilt;
        now.places = found.places;
        now.torque = found.torque;
        if E::UNILATERAL {
            now.share = found.share;
        }
    }
}
task! {
    Rates(input: &'a Input<R>, contacts: &'a Contacts<R>, at: StageState<'a, R>, rate: &'a mut States<R>, ledger: bool) -> (),
    equations => {
        let StageState { from, by, along } = at;
        let mut y = [R::zero(); MAX_COMPONENTS];
        for n in 0..E::STATES {
            y[n] = along[n].mul_add(by, from[n]);
        }
        copy_computed::<R, E>(rate, &equations.evaluate(input, contacts, &y, ledger).rate, ledger);
    }
}
task! {
    Jump(input: &'a Input<R>, y: &'a mut States<R>, impulse: &'a [R; 3], ledger: bool) -> (),
    equations => equations.jump(input, y, impulse, ledger)
}
task! {
    Energy(contacts: &'a Contacts<R>, motion: &'a Motion<R>) -> Energies<R>,
    equations => equations.energies(contacts, motion)
}
task! {
    Correct(drive: &'a SegmentDrive<R>, tau: R, y: &'a mut States<R>, ledger: bool) -> (),
    equations => if E::DRIFTS {
        projected::correct(equations, &drive.at(tau), &drive.contacts, y, ledger);
    }
}

/// All stages of a step in one piece of code.
struct Together<'a, R, E, W> {
    stages: W,
    equations: &'a E,
    called: &'a SceneEquations<R>,
}

impl<R: Lanes, E: Equations<R>, W: Stages<R>> LaneTask<R> for Together<'_, R, E, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { stages, equations, called } = self;
        stages.run(&Inlined::<_, _, false> { equations, called });
    }
}

impl<R: Lanes> SceneEquations<R> {
    /// A single run has them inlined into its loop, and numbers with derivatives are rare.
    const INLINES_STAGES: bool = R::WIDTH > 1 && !R::HAS_DERIVATIVES;
}

/// Runs in numbers with derivatives are bilateral, so no code of unilateral contact is compiled for them.
impl<R: Lanes> System<R> for SceneEquations<R> {
    #[inline(always)]
    fn size(&self) -> Size {
        with!(self.kind, equations [!R::HAS_DERIVATIVES] => size_of(equations, self.ledger))
    }

    fn begin(&self, motion: &Motion<R>) -> States<R> {
        with!(self.kind, equations [!R::HAS_DERIVATIVES] => equations.begin(motion))
    }

    #[inline(always)]
    fn evaluate_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, now: &mut Evaluation<R>) {
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations [!R::HAS_DERIVATIVES] => {
            R::call(instructions, Evaluate { equations, drive, tau, y, now, ledger });
        });
    }

    #[inline(always)]
    fn rates(&self, input: &Input<R>, contacts: &Contacts<R>, at: StageState<'_, R>, rate: &mut States<R>) {
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations [!R::HAS_DERIVATIVES] => {
            R::call(instructions, Rates { equations, input, contacts, at, rate, ledger });
        });
    }

    /// In lanes the equations of undisturbed bilateral contact are inlined into the stages.
    #[inline(always)]
    fn evaluate_stages(&self, stages: impl Stages<R>) {
        let together = Self::INLINES_STAGES && !self.ledger;
        match &self.kind {
            EquationKind::Csm(equations) if together => {
                R::call(self.instructions, Together { stages, equations, called: self });
            }
            EquationKind::Nullspace(equations) if together => {
                R::call(self.instructions, Together { stages, equations, called: self });
            }
            _ => stages.run(self),
        }
    }

    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3]) {
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations [!R::HAS_DERIVATIVES] => {
            R::call(instructions, Jump { equations, input, y, impulse, ledger });
        });
    }

    fn energies(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R> {
        with!(self.kind, equations [!R::HAS_DERIVATIVES] => R::call(self.instructions, Energy { equations, contacts, motion }))
    }

    #[inline(always)]
    fn corrects(&self) -> bool {
        self.projected
    }

    #[inline(always)]
    fn correct(&self, drive: &SegmentDrive<R>, tau: R, y: &mut States<R>) {
        if !self.projected {
            return;
        }
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations [!R::HAS_DERIVATIVES] => {
            R::call(instructions, Correct { equations, drive, tau, y, ledger });
        });
    }
}

/// Computes a Jacobian in sweeps, each with `W` directions.
struct Sweeps<'a, R, E> {
    equations: &'a E,
    drive: &'a SegmentDrive<R>,
    tau: R,
    y: &'a States<R>,
    ledger: bool,
    jacobian: &'a mut Jacobian<R>,
}

impl<R: Lanes, E: Equations<Dual<R, W>>, const W: usize> LaneTask<Dual<R, W>> for Sweeps<'_, R, E> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let rows = &mut self.jacobian.rows;
        let all = size_of(self.equations, self.ledger).all();
        let contacts = self.drive.contacts.lifted();
        let mut first = 0;
        while first <= E::STATES {
            let mut y = [Dual::constant(0.0); MAX_COMPONENTS];
            for (n, (dual, &number)) in y.iter_mut().zip(self.y).take(all).enumerate() {
                let direction = if n < E::STATES { n.wrapping_sub(first) } else { W };
                *dual = Dual::variable(number, direction);
            }
            let tau = Dual::variable(self.tau, E::STATES.wrapping_sub(first));
            let rate = self.equations.evaluate(&self.drive.at(tau), &contacts, &y, self.ledger).rate;
            for n in 0..all {
                rows[n][first..first + W].copy_from_slice(&rate[n].slope);
            }
            first += W;
        }
    }
}

impl<R: Lanes, const W: usize> Linear<R> for Tangent<R, W> {
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>) {
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations => {
            Dual::call(instructions, Sweeps { equations, drive, tau, y, ledger, jacobian });
        });
    }
}

impl<R: Lanes, const W: usize> Tangent<R, W> {
    /// Evaluates the state `y` under the inputs of an instant, without the works of the ledger. The directions
    /// of state and inputs are the caller's, so this differentiates every result by whatever is wanted. `None`
    /// for formulations other than `nullspace`: only its minimal coordinates are linearised with inputs and
    /// outputs, and this code is not compiled for the other formulations.
    pub fn evaluate_seeded(
        &self,
        input: &Input<Dual<R, W>>,
        y: &States<Dual<R, W>>,
    ) -> Option<Evaluation<Dual<R, W>>> {
        match &self.kind {
            EquationKind::Nullspace(equations) => {
                Some(Dual::call(self.instructions, Seeded { equations, input, y }))
            }
            EquationKind::NullspaceDriven(equations) => {
                Some(Dual::call(self.instructions, Seeded { equations, input, y }))
            }
            _ => None,
        }
    }
}
task! {
    Seeded(input: &'a Input<R>, y: &'a States<R>) -> Evaluation<R>,
    equations => equations.evaluate(input, &Contacts::sticking(), y, false)
}

impl SceneEquations<f64> {
    /// The equations of unilateral contact; `None` if these are others.
    pub(crate) fn contact(&self) -> Option<ContactEquations<'_>> {
        match &self.kind {
            EquationKind::Unilateral(equations) => {
                Some(ContactEquations::Actuated(self.instructions, equations))
            }
            EquationKind::UnilateralDriven(equations) => {
                Some(ContactEquations::Driven(self.instructions, equations))
            }
            _ => None,
        }
    }
}
