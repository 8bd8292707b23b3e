//! The equations of a run with their derivatives in directions of the caller's choice: by parameters, inputs and
//! start. Methods take their steps with them in dual numbers.
//!
//! Only bilateral contact is compiled for these numbers, and one evaluation for each kind of equations, which
//! keeps the code small.

use crate::formulation::csm::Csm;
use crate::formulation::equations::{Equations, Evaluation, MAX_COMPONENTS, States};
use crate::formulation::nullspace::Nullspace;
use crate::formulation::projected;
use crate::formulation::scene_equations::{Choice, size_of};
use crate::formulation::system::{Size, StageState, System};
use crate::formulation::table::Formulation;
use crate::model::contact_modes::Contacts;
use crate::model::control::{Actuated, Controller, Driven, Fingers};
use crate::model::drive::{Drive, Input, SegmentDrive};
use crate::model::energy::Energies;
use crate::model::forces::Plant;
use crate::model::motion::Motion;
use crate::model::parameters::Stabilization;
use crate::model::source::{Source, VariedParameters};
use crate::number::dual::Dual;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::real::Real;
use crate::number::simd::level::Instructions;

/// Number of directions: one vector of AVX-512.
pub const DIRECTIONS: usize = 8;

/// A number of a run with its derivatives.
pub type Varied = Dual<f64, DIRECTIONS>;

/// A number with its derivatives, and the derivative of all of these in one more direction.
type Twice = Dual<Varied, 1>;

/// The kinds of equations of bilateral contact.
#[derive(Debug, Clone, Copy)]
enum Bilateral<R> {
    Csm(Csm<R, Actuated<R>>),
    CsmDriven(Csm<R, Driven>),
    Nullspace(Nullspace<R, Actuated<R>>),
    NullspaceDriven(Nullspace<R, Driven>),
}

/// Evaluates one expression with the equations of any kind.
macro_rules! with {
    ($kind:expr, $equations:ident => $body:expr) => {
        match $kind {
            Bilateral::Csm($equations) => $body,
            Bilateral::CsmDriven($equations) => $body,
            Bilateral::Nullspace($equations) => $body,
            Bilateral::NullspaceDriven($equations) => $body,
        }
    };
}

impl<R: Real> Bilateral<R> {
    fn new(choice: Choice, source: &impl Source<R>, gains: &Stabilization) -> Self {
        let Choice { formulation, fingers, .. } = choice;
        let none = Stabilization { alpha: 0.0, beta: 0.0 };
        let gains = if formulation == Formulation::Csm { gains } else { &none };
        let driven = fingers == Fingers::Driven;
        match formulation {
            Formulation::Nullspace if driven => {
                Self::NullspaceDriven(Nullspace::new(Plant::new(source, fingers)))
            }
            Formulation::Nullspace => Self::Nullspace(Nullspace::new(Plant::new(source, fingers))),
            _ if driven => Self::CsmDriven(Csm::new(Plant::new(source, fingers), gains)),
            _ => Self::Csm(Csm::new(Plant::new(source, fingers), gains)),
        }
    }
}

/// The equations of one run, with their derivatives.
#[derive(Debug, Clone, Copy)]
pub struct VariedEquations {
    instructions: Instructions,
    ledger: bool,
    projected: bool,
    kind: Bilateral<Varied>,
    /// The same equations for second derivatives, if they are wanted.
    twice: Option<Bilateral<Twice>>,
}

impl VariedEquations {
    /// Builds the equations of a scene. `twice` says whether second derivatives are wanted.
    #[must_use]
    pub fn new(
        instructions: Instructions,
        choice: Choice,
        source: &VariedParameters<'_, DIRECTIONS>,
        gains: &Stabilization,
        twice: bool,
    ) -> Self {
        Self {
            instructions,
            ledger: choice.ledger,
            projected: choice.formulation == Formulation::Projected,
            kind: Bilateral::new(choice, source, gains),
            twice: twice.then(|| Bilateral::new(choice, source, gains)),
        }
    }

    /// The derivative of the rates at the state `y` and time `tau` along the direction `along` of the states and
    /// `by` of time. Zeros if second derivatives were not wanted.
    #[must_use]
    pub fn along(
        &self,
        drive: &SegmentDrive<Varied>,
        (tau, y): (Varied, &States<Varied>),
        (along, by): (&States<f64>, f64),
    ) -> States<Varied> {
        let mut change = [Varied::zero(); MAX_COMPONENTS];
        let Some(kind) = &self.twice else { return change };
        let mut state = [Twice::zero(); MAX_COMPONENTS];
        for n in 0..MAX_COMPONENTS {
            state[n] = Twice { value: y[n], slope: [Varied::constant(along[n])] };
        }
        let input = drive.at(Twice { value: tau, slope: [Varied::constant(by)] });
        let (state, input, change_of, ledger) = (&state, &input, &mut change, self.ledger);
        with!(kind, equations => {
            f64::call(self.instructions, Along { equations, input, state, change: change_of, ledger });
        });
        change
    }
}

/// Evaluates the derivative of the rates in one direction.
struct Along<'a, E> {
    equations: &'a E,
    input: &'a Input<Twice>,
    state: &'a States<Twice>,
    change: &'a mut States<Varied>,
    ledger: bool,
}

impl<E: Equations<Twice>> LaneTask<f64> for Along<'_, E> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let contacts = Contacts::<Varied>::sticking().lifted();
        let rate = self.equations.evaluate(self.input, &contacts, self.state, self.ledger).rate;
        let all = size_of::<Twice, E>(self.ledger).all();
        for (change, rate) in self.change.iter_mut().zip(rate).take(all) {
            [*change] = rate.slope;
        }
    }
}

/// Evaluates the equations at a state: the rates always, all other results if they are wanted.
struct Evaluate<'a, E> {
    equations: &'a E,
    input: &'a Input<Varied>,
    at: StageState<'a, Varied>,
    rate: &'a mut States<Varied>,
    rest: Option<&'a mut Evaluation<Varied>>,
    ledger: bool,
}

impl<E: Equations<Varied>> LaneTask<f64> for Evaluate<'_, E> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { equations, input, at: StageState { from, by, along }, rate, rest, ledger } = self;
        let mut y = [Varied::zero(); MAX_COMPONENTS];
        for n in 0..E::STATES {
            y[n] = along[n].mul_add(by, from[n]);
        }
        let found = equations.evaluate(input, &Contacts::sticking(), &y, ledger);
        rate[..E::STATES].copy_from_slice(&found.rate[..E::STATES]);
        if ledger {
            let works = E::STATES..E::STATES + E::WORKS;
            rate[works.clone()].copy_from_slice(&found.rate[works]);
        }
        if let Some(now) = rest {
            now.motion = found.motion;
            now.multipliers = found.multipliers;
            now.residuals = found.residuals;
            now.torque = found.torque;
        }
    }
}

/// Puts a state back on the constraints.
struct Correct<'a, K> {
    plant: &'a Plant<Varied, K>,
    input: &'a Input<Varied>,
    y: &'a mut States<Varied>,
    ledger: bool,
}

impl<K: Controller<Varied>> LaneTask<f64> for Correct<'_, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        projected::correct(self.plant, self.input, self.y, self.ledger);
    }
}

/// Applies an impulse, or computes the energies.
struct Jump<'a, E>(&'a E, &'a Input<Varied>, &'a mut States<Varied>, &'a [Varied; 3], bool);

impl<E: Equations<Varied>> LaneTask<f64> for Jump<'_, E> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(equations, input, y, impulse, ledger) = self;
        equations.jump(input, y, impulse, ledger);
    }
}

/// Computes the energies of a motion.
struct Energy<'a, E>(&'a E, &'a Motion<Varied>);

impl<E: Equations<Varied>> LaneTask<f64> for Energy<'_, E> {
    type Output = Energies<Varied>;

    #[inline(always)]
    fn run(self) -> Energies<Varied> {
        self.0.energies(&Contacts::sticking(), self.1)
    }
}

impl System<Varied> for VariedEquations {
    fn size(&self) -> Size {
        fn of<E: Equations<Varied>>(_: &E, ledger: bool) -> Size {
            size_of::<Varied, E>(ledger)
        }
        with!(&self.kind, equations => of(equations, self.ledger))
    }

    fn begin(&self, motion: &Motion<Varied>) -> States<Varied> {
        with!(&self.kind, equations => equations.begin(motion))
    }

    #[inline(always)]
    fn evaluate_into(
        &self,
        drive: &SegmentDrive<Varied>,
        tau: Varied,
        y: &States<Varied>,
        now: &mut Evaluation<Varied>,
    ) {
        let mut rate = now.rate;
        let input = &drive.at(tau);
        let at = StageState { from: y, by: Varied::zero(), along: y };
        let (to, rest, ledger) = (&mut rate, Some(&mut *now), self.ledger);
        with!(&self.kind, equations => {
            f64::call(self.instructions, Evaluate { equations, input, at, rate: to, rest, ledger });
        });
        now.rate = rate;
    }

    #[inline(always)]
    fn rates(
        &self,
        input: &Input<Varied>,
        _: &Contacts<Varied>,
        at: StageState<'_, Varied>,
        rate: &mut States<Varied>,
    ) {
        let (rest, ledger) = (None, self.ledger);
        with!(&self.kind, equations => {
            f64::call(self.instructions, Evaluate { equations, input, at, rate, rest, ledger });
        });
    }

    fn jump(&self, input: &Input<Varied>, y: &mut States<Varied>, impulse: &[Varied; 3]) {
        with!(&self.kind, equations => {
            f64::call(self.instructions, Jump(equations, input, y, impulse, self.ledger));
        });
    }

    fn energies(&self, _: &Contacts<Varied>, motion: &Motion<Varied>) -> Energies<Varied> {
        with!(&self.kind, equations => f64::call(self.instructions, Energy(equations, motion)))
    }

    #[inline(always)]
    fn corrects(&self) -> bool {
        self.projected
    }

    fn correct(&self, drive: &SegmentDrive<Varied>, tau: Varied, y: &mut States<Varied>) {
        if !self.projected {
            return;
        }
        let (input, ledger) = (&drive.at(tau), self.ledger);
        match &self.kind {
            Bilateral::Csm(csm) => {
                f64::call(self.instructions, Correct { plant: &csm.plant, input, y, ledger });
            }
            Bilateral::CsmDriven(csm) => {
                f64::call(self.instructions, Correct { plant: &csm.plant, input, y, ledger });
            }
            // The states of this formulation are always on the constraints.
            Bilateral::Nullspace(_) | Bilateral::NullspaceDriven(_) => {}
        }
    }
}
