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
use crate::formulation::system::{Jacobian, Size, StageState, System};
use crate::formulation::table::Formulation;
use crate::model::contact_modes::Contacts;
use crate::model::control::{Actuated, Controller, Driven, Fingers};
use crate::model::drive::{Drive, Input, SegmentDrive};
use crate::model::energy::Energies;
use crate::model::forces::Plant;
use crate::model::motion::Motion;
use crate::model::parameters::Stabilization;
use crate::model::source::{Constants, DIRECTIONS, Source, VariedParameters};
use crate::number::dual::Dual;
use crate::number::lanes::{LaneTask, Lanes, Lift};
use crate::number::real::Real;
use crate::number::simd::level::Instructions;

/// A number of a run, the same in every lane, with its derivatives in [`DIRECTIONS`]
/// directions, for vectors of four lanes.
pub type Varied<R> = Dual<R, 2>;

/// A number with its derivatives, and the derivative of all of these in one more direction.
type Twice<R> = Dual<Varied<R>, 1>;

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
pub struct VariedEquations<R> {
    instructions: Instructions,
    ledger: bool,
    projected: bool,
    kind: Bilateral<Varied<R>>,
    /// The same equations without derivatives by parameters.
    own: Bilateral<Varied<R>>,
    /// The same equations for second derivatives, if they are wanted.
    twice: Option<Bilateral<Twice<R>>>,
}

impl<R: Lanes> VariedEquations<R> {
    /// Builds the equations of a scene. `twice` says whether second derivatives are wanted.
    #[must_use]
    pub fn new(
        instructions: Instructions,
        choice: Choice,
        source: &VariedParameters<'_>,
        gains: &Stabilization,
        twice: bool,
    ) -> Self {
        Self {
            instructions,
            ledger: choice.ledger,
            projected: choice.formulation == Formulation::Projected,
            kind: Bilateral::new(choice, source, gains),
            own: Bilateral::new(choice, &Constants(source.parameters), gains),
            twice: twice.then(|| Bilateral::new(choice, &Constants(source), gains)),
        }
    }

    /// The Jacobian of the rates by the states, under the inputs of an instant.
    #[must_use]
    #[inline(always)]
    pub fn jacobian(&self, input: &Input<Varied<R>>, y: &States<f64>) -> Jacobian {
        let size = self.size();
        let constant = |number: Varied<R>| Varied::lift(number.value);
        let input = &Input {
            target: input.target.map(constant),
            target_rate: input.target_rate.map(constant),
            target_acceleration: input.target_acceleration.map(constant),
            force: input.force.map(constant),
        };
        let mut jacobian = Jacobian::zero();
        let mut rate = [Varied::zero(); MAX_COMPONENTS];
        for first in (0..size.states).step_by(DIRECTIONS) {
            let mut state = y.map(Varied::<R>::constant);
            for n in first..size.states.min(first + DIRECTIONS) {
                let (vector, lane) = ((n - first) / R::WIDTH, (n - first) % R::WIDTH);
                state[n].slope[vector].set(lane, 1.0);
            }
            let at = StageState { from: &state, by: Varied::zero(), along: &state };
            let (to, rest, ledger) = (&mut rate, None, self.ledger);
            with!(&self.own, equations => {
                R::call(self.instructions, Evaluate { equations, input, at, rate: to, rest, ledger });
            });
            for row in 0..size.all() {
                for n in first..size.states.min(first + DIRECTIONS) {
                    jacobian.rows[row][n] = rate[row].direction(n - first);
                }
            }
        }
        jacobian
    }

    /// The derivative of the rates at the state `y` and time `tau` along the direction `along` of the states and
    /// `by` of time. Zeros if second derivatives were not wanted.
    #[must_use]
    #[inline(always)]
    pub fn along(
        &self,
        drive: &SegmentDrive<Varied<R>>,
        (tau, y): (Varied<R>, &States<Varied<R>>),
        (along, by): (&States<f64>, f64),
    ) -> States<Varied<R>> {
        let mut change = [Varied::zero(); MAX_COMPONENTS];
        let Some(kind) = &self.twice else { return change };
        let mut state = [Twice::zero(); MAX_COMPONENTS];
        for n in 0..MAX_COMPONENTS {
            state[n] = Twice { value: y[n], slope: [Varied::constant(along[n])] };
        }
        let input = drive.at(Twice { value: tau, slope: [Varied::constant(by)] });
        let (state, input, change_of, ledger) = (&state, &input, &mut change, self.ledger);
        with!(kind, equations => {
            R::call(self.instructions, Along { equations, input, state, change: change_of, ledger });
        });
        change
    }
}

/// Evaluates the derivative of the rates in one direction.
struct Along<'a, R, E> {
    equations: &'a E,
    input: &'a Input<Twice<R>>,
    state: &'a States<Twice<R>>,
    change: &'a mut States<Varied<R>>,
    ledger: bool,
}

impl<R: Lanes, E: Equations<Twice<R>>> LaneTask<R> for Along<'_, R, E> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let contacts = Contacts::<Varied<R>>::sticking().lifted();
        let rate = self.equations.evaluate(self.input, &contacts, self.state, self.ledger).rate;
        let all = size_of::<Twice<R>, E>(self.ledger).all();
        for (change, rate) in self.change.iter_mut().zip(rate).take(all) {
            [*change] = rate.slope;
        }
    }
}

/// Evaluates the equations at a state: the rates always, all other results if they are wanted.
struct Evaluate<'a, R, E> {
    equations: &'a E,
    input: &'a Input<Varied<R>>,
    at: StageState<'a, Varied<R>>,
    rate: &'a mut States<Varied<R>>,
    rest: Option<&'a mut Evaluation<Varied<R>>>,
    ledger: bool,
}

impl<R: Lanes, E: Equations<Varied<R>>> LaneTask<R> for Evaluate<'_, R, E> {
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
struct Correct<'a, R, K> {
    plant: &'a Plant<Varied<R>, K>,
    input: &'a Input<Varied<R>>,
    y: &'a mut States<Varied<R>>,
    ledger: bool,
}

impl<R: Lanes, K: Controller<Varied<R>>> LaneTask<R> for Correct<'_, R, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        projected::correct(self.plant, self.input, self.y, self.ledger);
    }
}

/// Applies an impulse, or computes the energies.
struct Jump<'a, R, E>(&'a E, &'a Input<Varied<R>>, &'a mut States<Varied<R>>, &'a [Varied<R>; 3], bool);

impl<R: Lanes, E: Equations<Varied<R>>> LaneTask<R> for Jump<'_, R, E> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(equations, input, y, impulse, ledger) = self;
        equations.jump(input, y, impulse, ledger);
    }
}

/// Computes the energies of a motion.
struct Energy<'a, R, E>(&'a E, &'a Motion<Varied<R>>);

impl<R: Lanes, E: Equations<Varied<R>>> LaneTask<R> for Energy<'_, R, E> {
    type Output = Energies<Varied<R>>;

    #[inline(always)]
    fn run(self) -> Energies<Varied<R>> {
        self.0.energies(&Contacts::sticking(), self.1)
    }
}

impl<R: Lanes> System<Varied<R>> for VariedEquations<R> {
    fn size(&self) -> Size {
        fn of<R: Real, E: Equations<R>>(_: &E, ledger: bool) -> Size {
            size_of::<R, E>(ledger)
        }
        with!(&self.kind, equations => of(equations, self.ledger))
    }

    fn begin(&self, motion: &Motion<Varied<R>>) -> States<Varied<R>> {
        with!(&self.kind, equations => equations.begin(motion))
    }

    #[inline(always)]
    fn evaluate_into(
        &self,
        drive: &SegmentDrive<Varied<R>>,
        tau: Varied<R>,
        y: &States<Varied<R>>,
        now: &mut Evaluation<Varied<R>>,
    ) {
        let mut rate = now.rate;
        let input = &drive.at(tau);
        let at = StageState { from: y, by: Varied::zero(), along: y };
        let (to, rest, ledger) = (&mut rate, Some(&mut *now), self.ledger);
        with!(&self.kind, equations => {
            R::call(self.instructions, Evaluate { equations, input, at, rate: to, rest, ledger });
        });
        now.rate = rate;
    }

    #[inline(always)]
    fn rates(
        &self,
        input: &Input<Varied<R>>,
        _: &Contacts<Varied<R>>,
        at: StageState<'_, Varied<R>>,
        rate: &mut States<Varied<R>>,
    ) {
        let (rest, ledger) = (None, self.ledger);
        with!(&self.kind, equations => {
            R::call(self.instructions, Evaluate { equations, input, at, rate, rest, ledger });
        });
    }

    fn jump(&self, input: &Input<Varied<R>>, y: &mut States<Varied<R>>, impulse: &[Varied<R>; 3]) {
        with!(&self.kind, equations => {
            R::call(self.instructions, Jump(equations, input, y, impulse, self.ledger));
        });
    }

    fn energies(&self, _: &Contacts<Varied<R>>, motion: &Motion<Varied<R>>) -> Energies<Varied<R>> {
        with!(&self.kind, equations => R::call(self.instructions, Energy(equations, motion)))
    }

    #[inline(always)]
    fn corrects(&self) -> bool {
        self.projected
    }

    fn correct(&self, drive: &SegmentDrive<Varied<R>>, tau: Varied<R>, y: &mut States<Varied<R>>) {
        if !self.projected {
            return;
        }
        let (input, ledger) = (&drive.at(tau), self.ledger);
        match &self.kind {
            Bilateral::Csm(csm) => {
                R::call(self.instructions, Correct { plant: &csm.plant, input, y, ledger });
            }
            Bilateral::CsmDriven(csm) => {
                R::call(self.instructions, Correct { plant: &csm.plant, input, y, ledger });
            }
            // The states of this formulation are always on the constraints.
            Bilateral::Nullspace(_) | Bilateral::NullspaceDriven(_) => {}
        }
    }
}
