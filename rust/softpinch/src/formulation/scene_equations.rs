//! The equations of a scene after the choice of formulation, fingers and ledger. Step loops and methods call
//! them without knowing this choice.
//!
//! They are written once for all numbers: lanes, dual numbers of lanes for Jacobians, and the dual numbers of a run
//! with derivatives. Each call goes to code that is compiled once for each kind of numbers. In lanes a call costs
//! little (measured: docs/what-a-scene-pays.md), so step loops and methods are compiled once, not once for each
//! formulation.

use crate::formulation::any_parts::AnyParts;
use crate::formulation::contact_equations::ContactEquations;
use crate::formulation::csm::Csm;
use crate::formulation::equations::{Equations, Evaluation, MAX_COMPONENTS, States, for_fingers};
use crate::formulation::inlined::Inlined;
use crate::formulation::nullspace::Nullspace;
use crate::formulation::projected;
use crate::formulation::system::{Jacobian, Linear, Size, StageState, Stages, System};
use crate::formulation::table::Formulation;
use crate::formulation::unilateral::Unilateral;
use crate::model::contact::Parts;
use crate::model::contact_modes::{ContactModel, Contacts};
use crate::model::control::Fingers;
use crate::model::drive::{Input, SegmentDrive, SegmentFrame};
use crate::model::energy::Energies;
use crate::model::forces::{Applied, Carriage, Plant};
use crate::model::frame::{FrameLoads, FrameMotion};
use crate::model::motion::Motion;
use crate::model::parameters::Stabilization;
use crate::model::source::Source;
use crate::number::dual::Dual;
use crate::number::lanes::{LaneTask, Lanes, Lift};
use crate::number::real::Real;
use crate::number::simd::level::Instructions;

/// The kinds of equations.
#[derive(Debug, Clone, Copy)]
pub(crate) enum EquationKind<R> {
    Csm(Csm<R>),
    Nullspace(Nullspace<R>),
    Unilateral(Unilateral<R>),
    AnyParts(AnyParts<R>),
}

/// Evaluates one expression with the equations of any kind. No code is compiled for unilateral contact, or for parts that
/// are not the paper's, if the constants in brackets are false; then no equations are of these kinds.
macro_rules! with {
    ($kind:expr, $equations:ident => $body:expr) => {
        with!($kind, $equations [true, true] => $body)
    };
    ($kind:expr, $equations:ident [$unilateral:expr, $any_parts:expr] => $body:expr) => {
        match &$kind {
            EquationKind::Csm($equations) => $body,
            EquationKind::Nullspace($equations) => $body,
            EquationKind::Unilateral($equations) if $unilateral => $body,
            EquationKind::Unilateral(Unilateral { csm: $equations, .. }) => $body,
            EquationKind::AnyParts($equations) if $any_parts => $body,
            EquationKind::AnyParts(AnyParts { unilateral: Unilateral { csm: $equations, .. }, .. }) => $body,
        }
    };
}
pub(crate) use with;

impl<R: Real> EquationKind<R> {
    /// The equations of a scene, or of one scene for each lane.
    #[inline(always)]
    fn new(choice: Choice, source: &impl Source<R>, gains: &Stabilization) -> Self {
        let Choice { formulation, contact, fingers, moves, .. } = choice;
        let gains = match formulation {
            Formulation::Csm => *gains,
            Formulation::Nullspace | Formulation::Projected => Stabilization { alpha: 0.0, beta: 0.0 },
        };
        let plant = Plant::new(source, fingers, moves);
        if R::ANY_PARTS && !source.kinds().has_the_papers_parts() {
            let opens = contact == ContactModel::Unilateral;
            let drifts = opens || formulation != Formulation::Nullspace;
            let unilateral = Unilateral::new(source, Csm::new(plant, &gains));
            return Self::AnyParts(AnyParts { unilateral, drifts, opens });
        }
        match (contact, formulation) {
            (ContactModel::Unilateral, _) => {
                Self::Unilateral(Unilateral::new(source, Csm::new(plant, &gains)))
            }
            (_, Formulation::Nullspace) => Self::Nullspace(Nullspace::new(plant)),
            _ => Self::Csm(Csm::new(plant, &gains)),
        }
    }
}

/// The numbers of components of the equations' states, with or without the works of the ledger.
#[inline(always)]
pub(super) fn size_of<R: Real, E: Equations<R>>(equations: &E, driven: bool, ledger: bool) -> Size {
    let works = if ledger { equations.works() + usize::from(equations.plant().moves) } else { 0 };
    Size { states: equations.states(driven), degrees: equations.degrees(driven), works }
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
    /// Whether the hand moves.
    pub moves: bool,
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

/// The equations of a scene in dual numbers with `W` directions; those of parts that are not the paper's in one direction
/// after the other, which takes little code.
#[derive(Debug, Clone, Copy)]
pub enum Tangent<R, const W: usize> {
    /// With the paper's parts.
    Papers(SceneEquations<Dual<R, W>>),
    /// With others.
    AnyParts(SceneEquations<Dual<R, 1>>),
}

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
fn copy_computed<R: Real, E: Equations<R>>(
    equations: &E,
    (driven, ledger): (bool, bool),
    rate: &mut States<R>,
    found: &States<R>,
) {
    for_fingers!(driven, driven => {
        let states = equations.states(driven);
        rate[..states].copy_from_slice(&found[..states]);
        if ledger {
            // That of the hand's motion is zero if there is none.
            let works = states..states + equations.works() + 1;
            rate[works.clone()].copy_from_slice(&found[works]);
        }
    });
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

/// Evaluates the equations. A caller that knows how the fingers move has the code for these alone.
#[inline(always)]
pub(super) fn evaluate_into<R: Lanes, E: Equations<R>>(
    equations: &E,
    (driven, ledger): (bool, bool),
    (applied, contacts): (Applied<'_, R>, &Contacts<R>),
    y: &States<R>,
    now: &mut Evaluation<R>,
) {
    let found = equations.evaluate(driven, applied, contacts, y, ledger);
    copy_computed(equations, (driven, ledger), &mut now.rate, &found.rate);
    now.motion = found.motion;
    now.multipliers = found.multipliers;
    now.residuals = found.residuals;
    now.tilt = found.tilt;
    now.sin_tilt = found.sin_tilt;
    now.places = found.places;
    now.torque = found.torque;
    if equations.opens() {
        now.share = found.share;
    }
}

/// Evaluates only the rates, likewise.
#[inline(always)]
pub(super) fn rates_into<R: Lanes, E: Equations<R>>(
    equations: &E,
    (driven, ledger): (bool, bool),
    (applied, contacts): (Applied<'_, R>, &Contacts<R>),
    at: StageState<'_, R>,
    rate: &mut States<R>,
) {
    let StageState { from, by, along } = at;
    let mut y = [R::zero(); MAX_COMPONENTS];
    for_fingers!(driven, driven => {
        for n in 0..equations.states(driven) {
            y[n] = along[n].mul_add(by, from[n]);
        }
    });
    let found = equations.evaluate(driven, applied, contacts, &y, ledger).rate;
    copy_computed(equations, (driven, ledger), rate, &found);
}

/// Evaluates an expression for the fingers of the equations. If the constant in brackets is true, the code is compiled
/// for each kind of fingers alone; this is done where it was measured to pay (docs/what-a-scene-pays.md).
macro_rules! for_fingers_of {
    ($equations:expr, $driven:ident [$alone:expr] => $body:expr) => {{
        let driven = $equations.plant().driven;
        if $alone {
            for_fingers!(driven, $driven => $body)
        } else {
            let $driven = driven;
            $body
        }
    }};
}

task! {
    Evaluate(drive: &'a SegmentDrive<R>, tau: R, moving: Option<&'a FrameLoads<R>>, y: &'a States<R>, now: &'a mut Evaluation<R>, ledger: bool) -> (),
    equations => for_fingers_of!(equations, driven [R::ORDER < 2 && E::Parts::PAPERS] => {
        evaluate_into(equations, (driven, ledger), ((&drive.at(tau), Carriage::Either(moving)), &drive.contacts), y, now);
    })
}
task! {
    Rates(input: &'a Input<R>, moving: Option<&'a FrameLoads<R>>, contacts: &'a Contacts<R>, from: &'a States<R>, by: R, along: &'a States<R>, rate: &'a mut States<R>, ledger: bool) -> (),
    equations => for_fingers_of!(equations, driven [R::ORDER < 2 && E::Parts::PAPERS] => {
        rates_into(equations, (driven, ledger), ((input, Carriage::Either(moving)), contacts), StageState { from, by, along }, rate);
    })
}

/// Computes the inputs of an instant.
pub(crate) struct InputAt<'a, R>(pub(crate) &'a SegmentDrive<R>, pub(crate) R);

impl<R: Lanes> LaneTask<R> for InputAt<'_, R> {
    type Output = Input<R>;

    #[inline(always)]
    fn run(self) -> Input<R> {
        self.0.at(self.1)
    }
}

/// Computes the forces of the hand's motion at a stage.
struct Load<'a, R, T> {
    frame: &'a SegmentFrame<R>,
    /// The plant, and the number of coordinates among the states.
    plant: (&'a Plant<T>, usize),
    input: &'a Input<T>,
    at: StageState<'a, T>,
}

impl<R: Lanes, T: Lift<R>> LaneTask<T> for Load<'_, R, T> {
    type Output = FrameLoads<T>;

    #[inline(always)]
    fn run(self) -> FrameLoads<T> {
        let Self { frame, plant: (plant, degrees), input, at: StageState { from, by, along } } = self;
        let (mut q, mut p) = ([T::zero(); 3], [T::zero(); 3]);
        for n in 0..3 {
            q[n] = along[n].mul_add(by, from[n]);
            p[n] = along[degrees + n].mul_add(by, from[degrees + n]);
        }
        plant.loads(&frame.motion(input.tau), &input.force, q, p)
    }
}

impl<R: Lanes, T: Lift<R>> Load<'_, R, T> {
    /// Calls it, so that equations of a hand at rest have little code for it.
    #[inline(never)]
    fn loads(self) -> FrameLoads<T> {
        T::call(self.frame.instructions, self)
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
    equations => if equations.drifts() {
        let driven = equations.plant().driven;
        projected::correct(equations, (driven, ledger), &drive.at(tau), &drive.contacts, y);
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
    const INLINES_STAGES: bool = R::WIDTH > 1 && R::ORDER == 0;
}

/// The equations of a hand that moves. They are called, so that equations of a hand at rest have little code for it.
impl<R: Lanes> SceneEquations<R> {
    #[cold]
    #[inline(never)]
    fn rates_moving(
        &self,
        frame: &SegmentFrame<R>,
        (input, contacts): (&Input<R>, &Contacts<R>),
        (from, along): (&States<R>, &States<R>),
        &by: &R,
        rate: &mut States<R>,
    ) {
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => {
            let plant = (equations.plant(), self.size().degrees);
            let moving = Some(&Load { frame, plant, input, at: StageState { from, by, along } }.loads());
            R::call(instructions, Rates { equations, input, moving, contacts, from, by, along, rate, ledger });
        });
    }

    #[cold]
    #[inline(never)]
    fn evaluate_moving(
        &self,
        frame: &SegmentFrame<R>,
        (drive, tau): (&SegmentDrive<R>, R),
        y: &States<R>,
        now: &mut Evaluation<R>,
    ) {
        let Self { instructions, ledger, .. } = *self;
        let input = &R::call(instructions, InputAt(drive, tau));
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => {
            let (plant, by) = ((equations.plant(), self.size().degrees), R::zero());
            let moving = Some(&Load { frame, plant, input, at: StageState { from: y, by, along: y } }.loads());
            R::call(instructions, Evaluate { equations, drive, tau, moving, y, now, ledger });
        });
    }
}

/// Runs in numbers with derivatives are bilateral, so no code of unilateral contact is compiled for them.
impl<R: Lanes> System<R> for SceneEquations<R> {
    #[inline(always)]
    fn size(&self) -> Size {
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => {
            size_of(equations, equations.plant().driven, self.ledger)
        })
    }

    fn begin(&self, motion: &Motion<R>) -> States<R> {
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => equations.begin(equations.plant().driven, motion))
    }

    #[inline(always)]
    fn evaluate_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, now: &mut Evaluation<R>) {
        if let Some(frame) = &drive.frame {
            return self.evaluate_moving(frame, (drive, tau), y, now);
        }
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => {
            R::call(instructions, Evaluate { equations, drive, tau, moving: None, y, now, ledger });
        });
    }

    #[inline(always)]
    fn rates(&self, input: &Input<R>, drive: &SegmentDrive<R>, at: StageState<'_, R>, rate: &mut States<R>) {
        // In one piece the stage would be copied, as vectors that wait for the stores of its parts.
        let StageState { from, by, along } = at;
        let (moving, contacts) = (None, &drive.contacts);
        if let Some(frame) = &drive.frame {
            return self.rates_moving(frame, (input, contacts), (from, along), &by, rate);
        }
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => {
            R::call(instructions, Rates { equations, input, moving, contacts, from, by, along, rate, ledger });
        });
    }

    /// In lanes the equations of undisturbed bilateral contact are inlined into the stages.
    #[inline(always)]
    fn evaluate_stages(&self, stages: impl Stages<R>) {
        let together =
            |plant: &Plant<R>| Self::INLINES_STAGES && !(self.ledger || plant.driven || plant.moves);
        match &self.kind {
            EquationKind::Csm(equations) if together(equations.plant()) => {
                R::call(self.instructions, Together { stages, equations, called: self });
            }
            EquationKind::Nullspace(equations) if together(equations.plant()) => {
                R::call(self.instructions, Together { stages, equations, called: self });
            }
            _ => stages.run(self),
        }
    }

    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3]) {
        let Self { instructions, ledger, .. } = *self;
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => {
            R::call(instructions, Jump { equations, input, y, impulse, ledger });
        });
    }

    fn energies(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R> {
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => R::call(self.instructions, Energy { equations, contacts, motion }))
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
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => {
            R::call(instructions, Correct { equations, drive, tau, y, ledger });
        });
    }
}

/// Computes a Jacobian in sweeps, each with `W` directions.
struct Sweeps<'a, R, E, const W: usize> {
    equations: &'a E,
    drive: &'a SegmentDrive<R>,
    tau: R,
    y: &'a States<R>,
    ledger: bool,
    jacobian: &'a mut Jacobian<R>,
}

impl<R: Lanes, E: Equations<Dual<R, W>>, const W: usize> LaneTask<Dual<R, W>> for Sweeps<'_, R, E, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { equations, drive, tau, y, ledger, jacobian } = self;
        let contacts = drive.contacts.lifted();
        for_fingers_of!(equations, driven [E::Parts::PAPERS && (R::WIDTH > 1 || !equations.opens())] => {
            let size = size_of(equations, driven, ledger);
            let (states, all) = (size.states, size.all());
            let mut first = 0;
            while first <= states {
                let mut duals = [Dual::constant(0.0); MAX_COMPONENTS];
                for (n, (dual, &number)) in duals.iter_mut().zip(y).take(all).enumerate() {
                    let direction = if n < states { n.wrapping_sub(first) } else { W };
                    *dual = Dual::variable(number, direction);
                }
                let tau = Dual::variable(tau, states.wrapping_sub(first));
                let input = drive.at(tau);
                let mut moving = None;
                if let Some(frame) = &drive.frame {
                    // Only copies are passed on, so that states and inputs of a hand at rest stay in registers.
                    let (state, input, plant) = (duals, &{ input }, (equations.plant(), size.degrees));
                    let at = StageState { from: &state, by: Dual::zero(), along: &state };
                    moving = Some(Load { frame, plant, input, at }.loads());
                }
                let applied = (&input, Carriage::Either(moving.as_ref()));
                let rate = equations.evaluate(driven, applied, &contacts, &duals, ledger).rate;
                for n in 0..all {
                    jacobian.rows[n][first..first + W].copy_from_slice(&rate[n].slope);
                }
                first += W;
            }
        });
    }
}

impl<R: Lanes, const W: usize> Linear<R> for Tangent<R, W> {
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>) {
        match self {
            Self::Papers(system) => {
                let SceneEquations { instructions, ledger, .. } = *system;
                with!(system.kind, equations [true, false] => {
                    Dual::call(instructions, Sweeps::<R, _, W> { equations, drive, tau, y, ledger, jacobian });
                });
            }
            Self::AnyParts(system) => {
                let SceneEquations { instructions, ledger, .. } = *system;
                if let EquationKind::AnyParts(equations) = &system.kind
                    && R::ANY_PARTS
                {
                    Dual::call(
                        instructions,
                        Sweeps::<R, _, 1> { equations, drive, tau, y, ledger, jacobian },
                    );
                }
            }
        }
    }
}

impl<R: Lanes, const W: usize> Tangent<R, W> {
    /// Builds the equations of a scene, or of one scene for each lane.
    pub fn new<S>(instructions: Instructions, choice: Choice, source: &S, gains: &Stabilization) -> Self
    where
        S: Source<Dual<R, W>> + Source<Dual<R, 1>>,
    {
        if R::ANY_PARTS && !<S as Source<Dual<R, 1>>>::kinds(source).has_the_papers_parts() {
            Self::AnyParts(SceneEquations::new(instructions, choice, source, gains))
        } else {
            Self::Papers(SceneEquations::new(instructions, choice, source, gains))
        }
    }
}

impl<const W: usize> Tangent<f64, W> {
    /// Evaluates the state `y` under the inputs and the hand's motion of an instant, without the works of the ledger. The
    /// directions of state, inputs and motion are the caller's, so this differentiates every result by whatever is wanted. `None`
    /// for formulations other than `nullspace`: only its minimal coordinates are linearised with inputs and
    /// outputs, and this code is not compiled for the other formulations.
    pub fn evaluate_seeded(
        &self,
        (input, frame): (&Input<Dual<f64, W>>, &FrameMotion<Dual<f64, W>>),
        y: &States<Dual<f64, W>>,
    ) -> Option<Evaluation<Dual<f64, W>>> {
        match self {
            Self::Papers(system) => {
                let EquationKind::Nullspace(equations) = &system.kind else { return None };
                Some(Dual::call(system.instructions, Seeded { equations, input, frame, y }))
            }
            Self::AnyParts(system) => {
                let EquationKind::AnyParts(equations) = &system.kind else { return None };
                if equations.drifts {
                    return None;
                }
                let mut found = Evaluation::nothing();
                for k in 0..W {
                    let (input, frame) = (&input.map(|own| own.only(k)), &frame.map(|own| own.only(k)));
                    let y = &y.map(|own| own.only(k));
                    found.set_direction(
                        k,
                        &Dual::call(system.instructions, Seeded { equations, input, frame, y }),
                    );
                }
                Some(found)
            }
        }
    }
}

task! {
    Seeded(input: &'a Input<R>, frame: &'a FrameMotion<R>, y: &'a States<R>) -> Evaluation<R>,
    equations => {
        let (plant, driven) = (equations.plant(), equations.plant().driven);
        let first = equations.degrees(driven);
        let (pose, rates) = ([y[0], y[1], y[2]], [y[first], y[first + 1], y[first + 2]]);
        let moving = plant.loads(frame, &input.force, pose, rates);
        equations.evaluate(driven, (input, Carriage::Either(Some(&moving))), &Contacts::sticking(), y, false)
    }
}

impl SceneEquations<f64> {
    /// The equations of unilateral contact; `None` if these are others.
    pub(crate) fn contact(&self, drive: &SegmentDrive) -> Option<ContactEquations<'_>> {
        match &self.kind {
            EquationKind::Unilateral(equations)
            | EquationKind::AnyParts(AnyParts { unilateral: equations, opens: true, .. }) => {
                Some(ContactEquations::new(self.instructions, equations, drive.frame.as_deref().copied()))
            }
            _ => None,
        }
    }
}
