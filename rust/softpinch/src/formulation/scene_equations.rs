//! The equations of a scene after the choice of formulation, fingers and ledger. Step loops and methods call
//! them without knowing this choice.
//!
//! Each call goes to code that is compiled once for each kind of numbers. In lanes a call costs little
//! (measured: docs/what-a-scene-pays.md), so step loops and methods are compiled once, not once for each
//! formulation.

use std::marker::PhantomData;

use crate::formulation::contact_equations::{Called, ContactEquations};
use crate::formulation::csm::Csm;
use crate::formulation::equations::{Equations, Evaluation, MAX_COMPONENTS, States};
use crate::formulation::nullspace::Nullspace;
use crate::formulation::projected;
use crate::formulation::system::{Size, StageState, System};
use crate::formulation::table::Formulation;
use crate::formulation::unilateral::Unilateral;
use crate::model::contact_modes::{ContactModel, Contacts};
use crate::model::control::{Actuated, Controller, Driven, Fingers};
use crate::model::drive::{Drive, Input, SegmentDrive};
use crate::model::energy::Energies;
use crate::model::forces::Plant;
use crate::model::motion::Motion;
use crate::model::parameters::Stabilization;
use crate::model::source::Source;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::real::Real;
use crate::number::simd::level::Instructions;

/// The kinds of equations.
#[derive(Debug, Clone, Copy)]
pub(super) enum EquationKind<R> {
    Csm(Csm<R, Actuated<R>>),
    CsmDriven(Csm<R, Driven>),
    Nullspace(Nullspace<R, Actuated<R>>),
    NullspaceDriven(Nullspace<R, Driven>),
    Unilateral(Unilateral<R, Actuated<R>>),
    UnilateralDriven(Unilateral<R, Driven>),
}

/// Evaluates one expression with the equations of any kind.
macro_rules! with {
    ($kind:expr, $equations:ident => $body:expr) => {
        match $kind {
            EquationKind::Csm($equations) => $body,
            EquationKind::CsmDriven($equations) => $body,
            EquationKind::Nullspace($equations) => $body,
            EquationKind::NullspaceDriven($equations) => $body,
            EquationKind::Unilateral($equations) => $body,
            EquationKind::UnilateralDriven($equations) => $body,
        }
    };
}
pub(super) use with;

impl<R: Real> EquationKind<R> {
    /// The equations of a scene, or of one scene for each lane.
    #[inline(always)]
    fn new(choice: Choice, source: &impl Source<R>, gains: &Stabilization) -> Self {
        let Choice { formulation, contact, fingers, .. } = choice;
        let gains = match formulation {
            Formulation::Csm => *gains,
            Formulation::Nullspace | Formulation::Projected => Stabilization { alpha: 0.0, beta: 0.0 },
        };
        let driven = fingers == Fingers::Driven;
        match (contact, formulation) {
            (ContactModel::Unilateral, _) if driven => {
                Self::UnilateralDriven(Unilateral::new(source, fingers, &gains))
            }
            (ContactModel::Unilateral, _) => Self::Unilateral(Unilateral::new(source, fingers, &gains)),
            (_, Formulation::Nullspace) if driven => {
                Self::NullspaceDriven(Nullspace::new(Plant::new(source, fingers)))
            }
            (_, Formulation::Nullspace) => Self::Nullspace(Nullspace::new(Plant::new(source, fingers))),
            (_, Formulation::Csm | Formulation::Projected) if driven => {
                Self::CsmDriven(Csm::new(Plant::new(source, fingers), &gains))
            }
            (_, Formulation::Csm | Formulation::Projected) => {
                Self::Csm(Csm::new(Plant::new(source, fingers), &gains))
            }
        }
    }

    fn size(&self, ledger: bool) -> Size {
        fn of<R: Real, E: Equations<R>>(_: &E, ledger: bool) -> Size {
            size_of::<R, E>(ledger)
        }
        with!(self, equations => of(equations, ledger))
    }
}

/// The numbers of components of the equations' states, with or without the works of the ledger.
#[inline(always)]
pub(super) fn size_of<R: Real, E: Equations<R>>(ledger: bool) -> Size {
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
    pub(super) instructions: Instructions,
    pub(super) ledger: bool,
    projected: bool,
    pub(super) kind: EquationKind<R>,
}

/// Builds equations in numbers of type `N`. Lanes need this whenever one of their runs changes. The code is
/// called, not inlined.
struct Build<'a, S, N>(Choice, &'a S, &'a Stabilization, PhantomData<N>);

impl<R: Lanes, N: Real, S: Source<N>> LaneTask<R> for Build<'_, S, N> {
    type Output = EquationKind<N>;

    #[inline(always)]
    fn run(self) -> EquationKind<N> {
        let Self(choice, source, gains, _) = self;
        EquationKind::new(choice, source, gains)
    }
}

/// Builds the equations of a scene, or of one scene for each lane, in numbers that are lanes or consist of
/// lanes.
pub(super) fn build<R: Lanes, N: Real>(
    instructions: Instructions,
    choice: Choice,
    source: &impl Source<N>,
    gains: &Stabilization,
) -> EquationKind<N> {
    R::call(instructions, Build(choice, source, gains, PhantomData))
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
            kind: build::<R, R>(instructions, choice, source, gains),
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

/// Puts a state back on the constraints.
struct Correct<'a, R, K> {
    plant: &'a Plant<R, K>,
    drive: &'a SegmentDrive<R>,
    tau: R,
    y: &'a mut States<R>,
    ledger: bool,
}

impl<R: Lanes, K: Controller<R>> LaneTask<R> for Correct<'_, R, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        projected::correct(self.plant, &self.drive.at(self.tau), self.y, self.ledger);
    }
}

/// Puts a state back on the constraints of the closed contacts.
struct CorrectClosed<'a, R, K> {
    equations: &'a Unilateral<R, K>,
    drive: &'a SegmentDrive<R>,
    tau: R,
    y: &'a mut States<R>,
    ledger: bool,
}

impl<R: Lanes, K: Controller<R>> LaneTask<R> for CorrectClosed<'_, R, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { equations, drive, tau, y, ledger } = self;
        projected::correct_closed(equations, &drive.at(tau), &drive.contacts, y, ledger);
    }
}

impl<R: Lanes> System<R> for SceneEquations<R> {
    #[inline(always)]
    fn size(&self) -> Size {
        self.kind.size(self.ledger)
    }

    fn begin(&self, motion: &Motion<R>) -> States<R> {
        with!(&self.kind, equations => equations.begin(motion))
    }

    #[inline(always)]
    fn evaluate_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, now: &mut Evaluation<R>) {
        let Self { instructions, ledger, .. } = *self;
        with!(&self.kind, equations => {
            R::call(instructions, Evaluate { equations, drive, tau, y, now, ledger });
        });
    }

    #[inline(always)]
    fn rates(&self, input: &Input<R>, contacts: &Contacts<R>, at: StageState<'_, R>, rate: &mut States<R>) {
        let Self { instructions, ledger, .. } = *self;
        with!(&self.kind, equations => {
            R::call(instructions, Rates { equations, input, contacts, at, rate, ledger });
        });
    }

    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3]) {
        let Self { instructions, ledger, .. } = *self;
        with!(&self.kind, equations => {
            R::call(instructions, Jump { equations, input, y, impulse, ledger });
        });
    }

    fn energies(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R> {
        with!(&self.kind, equations => {
            R::call(self.instructions, Energy { equations, contacts, motion })
        })
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
        match &self.kind {
            EquationKind::Csm(csm) => {
                R::call(instructions, Correct { plant: &csm.plant, drive, tau, y, ledger })
            }
            EquationKind::CsmDriven(csm) => {
                R::call(instructions, Correct { plant: &csm.plant, drive, tau, y, ledger })
            }
            EquationKind::Unilateral(equations) => {
                R::call(instructions, CorrectClosed { equations, drive, tau, y, ledger })
            }
            EquationKind::UnilateralDriven(equations) => {
                R::call(instructions, CorrectClosed { equations, drive, tau, y, ledger })
            }
            // The states of this formulation are always on the constraints.
            EquationKind::Nullspace(_) | EquationKind::NullspaceDriven(_) => {}
        }
    }
}

impl SceneEquations<f64> {
    /// Calls `work` with the equations of unilateral contact; `None` if these are others.
    pub(crate) fn with_contact<T>(&self, work: impl FnOnce(&dyn ContactEquations) -> T) -> Option<T> {
        match &self.kind {
            EquationKind::Unilateral(equations) => Some(work(&Called(self.instructions, equations))),
            EquationKind::UnilateralDriven(equations) => Some(work(&Called(self.instructions, equations))),
            _ => None,
        }
    }
}
