//! The equations of a scene in dual numbers, and the Jacobians and other derivatives that these give.

use std::marker::PhantomData;

use crate::formulation::scene_equations::{Load, for_fingers_of, size_of};
use crate::formulation::{
    AnyParts, Choice, EquationKind, Equations, Evaluation, Jacobian, Linear, MAX_COMPONENTS, SceneEquations,
    StageState, States, Unilateral, for_fingers, with,
};
use crate::model::{
    Carriage, Constants, Contacts, DIRECTIONS, FrameMotion, Input, Parameters, Parts, SegmentDrive,
    Stabilization,
};
use crate::number::{
    Dual, Instructions, LaneKernel, LaneTask, Lanes, MOST, Real, call_four_lanes, gathered, spread, task,
};

/// The equations of a scene in dual numbers with `W` directions.
pub enum Tangent<R, const W: usize> {
    /// With the paper's parts.
    Papers(Box<SceneEquations<Dual<R, W>>>),
    /// With others, in one direction, or in four lanes in four directions, which takes little code.
    Others(Box<dyn Derivatives<R>>),
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

/// The derivatives of a single run's Jacobian that are computed at once.
type Directions = Dual<f64, DIRECTIONS>;

/// What is evaluated in numbers with derivatives, whose directions are the caller's.
pub struct Seeded<D> {
    /// The inputs.
    pub input: Input<D>,
    /// The motion of the hand, if it moves.
    pub frame: Option<FrameMotion<D>>,
    /// The modes of the contacts.
    pub contacts: Contacts<D>,
    /// The state.
    pub y: States<D>,
}

task! {
    /// Evaluates it.
    ['a, D: Lanes, E: Equations<D>]
    Evaluate<'a, D, E>(equations: &'a E, at: &'a Seeded<D>, ledger: bool) for D => Evaluation<D> = {
        let (plant, driven) = (equations.plant(), equations.plant().driven);
        let Seeded { input, frame, contacts, y } = at;
        let mut moving = None;
        if let Some(frame) = frame {
            let first = equations.degrees(driven);
            let (pose, rates) = ([y[0], y[1], y[2]], [y[first], y[first + 1], y[first + 2]]);
            moving = Some(plant.loads(frame, &input.force, pose, rates));
        }
        equations.evaluate(driven, (input, Carriage::Either(moving.as_ref())), contacts, y, ledger)
    }
}

/// Derivatives of the equations of other parts.
pub trait Derivatives<R: Lanes>: Send + Sync {
    /// Writes a Jacobian, as [`Linear::jacobian_into`] does.
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>);

    /// Evaluates a state of a single run that has derivatives, as [`Tangent::evaluate_seeded`] does.
    fn seeded(&self, at: &Seeded<Directions>) -> Option<Evaluation<Directions>>;
}

/// The equations of other parts in vectors that hold the lanes of a run, or of several, once for each of several
/// directions.
struct Swept<X> {
    instructions: Instructions,
    ledger: bool,
    equations: AnyParts<Dual<X, 1>>,
}

impl<X: Lanes> Swept<X> {
    fn evaluate_seeds(&self, at: &Seeded<Directions>) -> Evaluation<Directions> {
        let mut found = Evaluation::nothing();
        for first in (0..DIRECTIONS).step_by(X::WIDTH) {
            let own = |own: Directions| own.spread(first);
            let spread = Seeded {
                input: at.input.map(own),
                frame: at.frame.map(|frame| frame.map(own)),
                contacts: at.contacts.spread(),
                y: at.y.map(own),
            };
            found.gather(first, &self.evaluate(&spread));
        }
        found
    }

    fn evaluate(&self, at: &Seeded<Dual<X, 1>>) -> Evaluation<Dual<X, 1>> {
        let Self { instructions, ledger, equations } = self;
        Dual::call(*instructions, Evaluate { equations, at, ledger: *ledger })
    }
}

/// Computes a Jacobian of other parts.
struct SweptJacobian<'a, R, X> {
    swept: &'a Swept<X>,
    drive: &'a SegmentDrive<R>,
    tau: R,
    y: &'a States<R>,
    jacobian: &'a mut Jacobian<R>,
}

impl<R: Lanes, X: Lanes> LaneTask<R> for SweptJacobian<'_, R, X> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { swept, drive, tau, y, jacobian } = self;
        let size = size_of(&swept.equations, swept.equations.plant().driven, swept.ledger);
        let (states, all, zero) = (size.states, size.all(), R::zero());
        let tau = Dual::<R, 1>::variable(tau, 0);
        let (input, frame) = (drive.at(tau), drive.frame.as_ref().map(|frame| frame.motion(tau)));
        for first in (0..=states).step_by(X::WIDTH / R::WIDTH) {
            let in_time = |own: Dual<R, 1>| {
                spread(own.value, |k| if first + k == states { own.slope[0] } else { zero })
            };
            let mut state = [Dual::constant(0.0); MAX_COMPONENTS];
            for n in 0..all {
                let own = |k| if n < states && first + k == n { R::constant(1.0) } else { zero };
                state[n] = spread(y[n], own);
            }
            let found = swept.evaluate(&Seeded {
                input: input.map(in_time),
                frame: frame.map(|frame| frame.map(in_time)),
                contacts: drive.contacts.spread(),
                y: state,
            });
            for n in 0..all {
                for k in 0..X::WIDTH / R::WIDTH {
                    jacobian.rows[n][first + k] = gathered(found.rate[n].slope[0], k);
                }
            }
        }
    }
}

impl<R: Lanes, X: Lanes> Derivatives<R> for Swept<X> {
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>) {
        R::call(self.instructions, SweptJacobian { swept: self, drive, tau, y, jacobian });
    }

    fn seeded(&self, at: &Seeded<Directions>) -> Option<Evaluation<Directions>> {
        let AnyParts { drifts, opens, .. } = self.equations;
        if drifts && !opens { None } else { Some(self.evaluate_seeds(at)) }
    }
}

/// Builds the equations of other parts in vectors, and for the runs of which they give derivatives.
struct BuildFor<'a, R>(Choice, &'a [&'a Parameters; MOST], &'a Stabilization, PhantomData<R>);

impl<R: Lanes> LaneKernel for BuildFor<'_, R> {
    type Output = Box<dyn Derivatives<R>>;

    #[inline(always)]
    fn run<X: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self(choice, parameters, gains, _) = self;
        // The lanes of the runs come once for each direction.
        let parameters = &std::array::from_fn(|lane| parameters[lane % R::WIDTH]);
        let equations = AnyParts::<Dual<X, 1>>::new(choice, &Constants(parameters), gains);
        Box::new(Swept { instructions, ledger: choice.ledger, equations })
    }
}

impl<R: Lanes, const W: usize> Linear<R> for Tangent<R, W> {
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>) {
        let system = match self {
            Self::Papers(system) => system,
            Self::Others(others) => return others.jacobian_into(drive, tau, y, jacobian),
        };
        let (instructions, ledger) = (system.instructions, system.ledger);
        with!(system.kind, equations [true, false] => {
            Dual::call(instructions, Sweeps::<R, _, W> { equations, drive, tau, y, ledger, jacobian });
        });
    }
}

impl<R: Lanes, const W: usize> Tangent<R, W> {
    /// Builds the equations of a scene, or of one scene for each lane.
    pub fn new(
        instructions: Instructions,
        choice: Choice,
        parameters: &[&Parameters; MOST],
        gains: &Stabilization,
    ) -> Self {
        if !R::ANY_PARTS || parameters[0].has_the_papers_parts() {
            return Self::Papers(Box::new(SceneEquations::new(
                instructions,
                choice,
                &Constants(parameters),
                gains,
            )));
        }
        let build = BuildFor(choice, parameters, gains, PhantomData);
        Self::Others(if R::WIDTH == 1 {
            call_four_lanes(instructions, build)
        } else {
            build.run::<R>(instructions)
        })
    }

    /// Builds them anew for runs with parts of the same kinds, in the same place.
    pub fn renew(
        &mut self,
        instructions: Instructions,
        choice: Choice,
        parameters: &[&Parameters; MOST],
        gains: &Stabilization,
    ) {
        match self {
            Self::Papers(system) => {
                **system = SceneEquations::new(instructions, choice, &Constants(parameters), gains);
            }
            Self::Others(_) => *self = Self::new(instructions, choice, parameters, gains),
        }
    }
}

impl Tangent<f64, DIRECTIONS> {
    /// Evaluates a state of a single run, without the works of the ledger. The directions are the caller's, so this
    /// differentiates every result by whatever is wanted. `None` for bilateral formulations other than `nullspace`: only its
    /// minimal coordinates are linearised with inputs and outputs, and this code is not compiled for the other
    /// formulations. For unilateral contact it is compiled in the equations of any parts alone.
    pub fn evaluate_seeded(&self, at: &Seeded<Directions>) -> Option<Evaluation<Directions>> {
        match self {
            Self::Others(others) => others.seeded(at),
            Self::Papers(system) => {
                let EquationKind::Nullspace(equations) = &system.kind else { return None };
                Some(Dual::call(system.instructions, Evaluate { equations, at, ledger: false }))
            }
        }
    }
}
