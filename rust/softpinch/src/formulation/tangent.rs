//! The equations of a scene in dual numbers, and the Jacobians and other derivatives that these give.

use std::marker::PhantomData;

use crate::formulation::equations::{evaluated, size_of};
use crate::formulation::scene_equations::{Load, for_fingers_of};
use crate::formulation::{
    Carried, Choice, EquationKind, Equations, Evaluation, MAX_COMPONENTS, SceneEquations, States, System,
    Unilateral, for_fingers, with,
};
use crate::model::{Constants, Contacts, FrameMotion, Input, Parameters, SegmentDrive, Stabilization};
use crate::number::{
    Dual, LaneKernel, LaneTask, Lanes, Lift, MOST, Real, call_four_lanes, gathered, spread, task,
};

/// The derivatives of a system's rates with respect to its states and to time.
pub trait Linear<R: Lanes> {
    /// Writes the Jacobian at time `tau` of a segment and state `y`. The zeros that fill it are left as they are.
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>);

    fn jacobian(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>) -> Jacobian<R>
    where
        Self: Sized,
    {
        let mut jacobian = Jacobian::zero();
        self.jacobian_into(drive, tau, y, &mut jacobian);
        jacobian
    }

    /// Renews what depends on the runs, after some runs have changed.
    fn renew(&mut self, _runs: Runs<'_>) {}
}

/// The derivatives of a system's rates with respect to its states and to time.
#[derive(Debug, Clone, Copy)]
pub struct Jacobian<R = f64> {
    /// Row by row. The column after the states is the derivative with respect to time.
    pub(crate) rows: [[R; MAX_COMPONENTS]; MAX_COMPONENTS],
}

impl<R: Lanes> Jacobian<R> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self { rows: [[R::zero(); MAX_COMPONENTS]; MAX_COMPONENTS] }
    }
}

/// How many directions are computed at once in lanes of several runs. With three no direction is left over: there are 21, 15
/// or 9 with that of time.
const IN_LANES: usize = 3;

/// The equations of a scene in dual numbers.
pub enum Tangent<R> {
    /// In lanes of runs whose parts, but for laws of the tip, are the paper's.
    InLanes(Box<SceneEquations<Dual<R, IN_LANES>>>),
    /// Of a single run, or of runs with other parts: one direction in each lane takes little code.
    Swept(Box<dyn Linear<R> + Send + Sync>),
}

task! {
    /// Computes a Jacobian in sweeps over the directions.
    ['a, R: Lanes, E: Equations<Dual<R, IN_LANES>>]
    Sweeps<'a, R, E>(equations: &'a E, drive: &'a SegmentDrive<R>, tau: R, y: &'a States<R>, carried: Carried,
        jacobian: &'a mut Jacobian<R>)
    for Dual<R, IN_LANES> => () = {
        let contacts = drive.contacts.map(Dual::lift);
        for_fingers_of!(equations, driven [true] => {
            let size = size_of(equations, driven, carried);
            let (states, all) = (size.states, size.all());
            let (mut first, mut duals, mut loads) = (0, [Dual::constant(0.0); MAX_COMPONENTS], None);
            for n in 0..all {
                duals[n].value = y[n];
            }
            while first <= states {
                // Only the directions of this sweep are set: all slopes anew took a tenth of the time.
                let seeded = first..(first + IN_LANES).min(states);
                for n in seeded.clone() {
                    duals[n].slope[n - first] = R::constant(1.0);
                }
                let tau = Dual::variable(tau, states.wrapping_sub(first));
                let input = drive.at(tau);
                // Unless the hand turns, its forces depend on the time alone.
                if let Some(frame) = &drive.frame
                    && (frame.turns || first == 0 || first + IN_LANES > states)
                {
                    // Only copies are passed on, so that states and inputs of a hand at rest stay in registers.
                    let d = size.degrees;
                    let state = &[duals[0], duals[1], duals[2], duals[d], duals[d + 1], duals[d + 2]];
                    let (tau, force, plant, by) = (&{ tau }, &{ input.force }, equations.plant(), &Dual::zero());
                    let (from, along, degrees) = (state, state, 3);
                    loads = Some(Dual::outlined(Load { frame, plant, tau, force, from, by, along, degrees }));
                }
                let applied = (&input, loads.as_ref());
                // Not called: inlined it is much faster, in unilateral contact too.
                let rate = evaluated(equations, driven, applied, &contacts, &duals, carried).rate;
                for n in 0..all {
                    jacobian.rows[n][first..first + IN_LANES].copy_from_slice(&rate[n].slope);
                }
                for n in seeded {
                    duals[n].slope[n - first] = R::zero();
                }
                first += IN_LANES;
            }
        });
    }
}

/// What is evaluated in numbers with derivatives, whose directions are the caller's.
pub struct Seeded<D> {
    pub input: Input<D>,
    /// The motion of the hand, if it moves.
    pub frame: Option<FrameMotion<D>>,
    pub contacts: Contacts<D>,
    pub y: States<D>,
}

task! {
    ['a, D: Lanes, E: Equations<D>]
    Evaluate<'a, D, E>(equations: &'a E, at: &'a Seeded<D>, carried: Carried) for D => Evaluation<D> = {
        let (plant, driven) = (equations.plant(), equations.plant().driven);
        let Seeded { input, frame, contacts, y } = at;
        let mut moving = None;
        if let Some(frame) = frame {
            let first = equations.degrees(driven);
            let (pose, rates) = ([y[0], y[1], y[2]], [y[first], y[first + 1], y[first + 2]]);
            moving = Some(plant.loads(frame, &input.force, pose, rates));
        }
        equations.evaluate(driven, (input, moving.as_ref()), contacts, y, carried)
    }
}

impl<X: Lanes> SceneEquations<Dual<X, 1>> {
    /// Evaluates a state, with a direction in each lane.
    pub(crate) fn seeded(&self, at: &Seeded<Dual<X, 1>>) -> Evaluation<Dual<X, 1>> {
        let carried = self.carried;
        with!(self.kind, equations [true, true] => Dual::outlined(Evaluate { equations, at, carried }))
    }
}

/// Equations in vectors `X` that hold the lanes of `R` once for each of several directions.
struct Swept<R, X> {
    equations: SceneEquations<Dual<X, 1>>,
    runs: PhantomData<R>,
}

task! {
    /// Computes a Jacobian, a direction in each lane.
    ['a, R: Lanes, X: Lanes]
    SweptJacobian<'a, R, X>(swept: &'a Swept<R, X>, drive: &'a SegmentDrive<R>, tau: R, y: &'a States<R>,
        jacobian: &'a mut Jacobian<R>)
    for R => () = {
        let size = swept.equations.size();
        let (states, all, zero) = (size.states, size.all(), R::zero());
        let tau = Dual::<R, 1>::variable(tau, 0);
        let (input, frame) = (drive.at(tau), drive.frame.as_ref().map(|frame| frame.motion(tau)));
        let mut at = Seeded {
            input: input.map(|own| spread(own.value, |_| zero)),
            frame: frame.map(|frame| frame.map(|own| spread(own.value, |_| zero))),
            contacts: drive.contacts.spread(),
            y: y.map(|own| spread(own, |_| zero)),
        };
        for first in (0..=states).step_by(X::WIDTH / R::WIDTH) {
            let in_time = |own: Dual<R, 1>| {
                spread(own.value, |k| if first + k == states { own.slope[0] } else { zero })
            };
            if first + X::WIDTH / R::WIDTH > states {
                at.input = input.map(in_time);
                at.frame = frame.map(|frame| frame.map(in_time));
            }
            for (n, own) in at.y.iter_mut().enumerate().take(states) {
                let along = |lane: usize| f64::from(first + lane / R::WIDTH == n);
                own.slope = [X::from_fn(along)];
            }
            let found = swept.equations.seeded(&at);
            for n in 0..all {
                for k in 0..X::WIDTH / R::WIDTH {
                    jacobian.rows[n][first + k] = gathered(found.rate[n].slope[0], k);
                }
            }
        }
    }
}

impl<R: Lanes, X: Lanes> Linear<R> for Swept<R, X> {
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>) {
        R::outlined(SweptJacobian { swept: self, drive, tau, y, jacobian });
    }
}

/// Builds equations in vectors, for the runs of which they give derivatives.
struct BuildFor<'a, R>(Runs<'a>, PhantomData<R>);

impl<R: Lanes> LaneKernel for BuildFor<'_, R> {
    type Output = Box<dyn Linear<R> + Send + Sync>;

    #[inline(always)]
    fn run<X: Lanes>(self) -> Self::Output {
        let Self(Runs { choice, parameters, gains }, runs) = self;
        // The lanes of the runs come once for each direction.
        let parameters = &std::array::from_fn(|lane| parameters[lane % R::WIDTH]);
        let equations = SceneEquations::new(choice, &Constants(parameters), gains);
        Box::new(Swept::<R, X> { equations, runs })
    }
}

impl<R: Lanes> Linear<R> for Tangent<R> {
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>) {
        match self {
            Self::InLanes(system) if const { R::WIDTH > 1 } => {
                let carried = system.carried;
                with!(system.kind, equations [true, false] => {
                    Dual::outlined(Sweeps { equations, drive, tau, y, carried, jacobian });
                });
            }
            Self::InLanes(_) => unreachable!("single runs are swept"),
            Self::Swept(swept) => swept.jacobian_into(drive, tau, y, jacobian),
        }
    }

    fn renew(&mut self, runs: Runs<'_>) {
        match self {
            // In place, because they are large.
            Self::InLanes(system) if const { R::WIDTH > 1 } => {
                **system = SceneEquations::new(runs.choice, &Constants(&runs.parameters), runs.gains);
            }
            _ => *self = runs.tangent(),
        }
    }
}

pub type LaneParameters<'a> = [&'a Parameters; MOST];

/// The runs in all lanes, for which equations and methods are made.
#[derive(Clone, Copy)]
pub struct Runs<'a> {
    pub choice: Choice,
    pub parameters: LaneParameters<'a>,
    pub gains: &'a Stabilization,
}

impl Runs<'_> {
    pub fn system<R: Lanes>(&self) -> SceneEquations<R> {
        SceneEquations::new(self.choice, &self.parameters, self.gains)
    }

    /// Builds the equations, and a method for them.
    #[inline(always)]
    pub fn with_method<R: Lanes, M>(
        self,
        make: impl FnOnce(Self, &SceneEquations<R>) -> M,
    ) -> (SceneEquations<R>, M) {
        let system = self.system();
        let method = make(self, &system);
        (system, method)
    }

    /// Builds the same equations in dual numbers.
    pub fn tangent<R: Lanes>(&self) -> Tangent<R> {
        let build = BuildFor(*self, PhantomData);
        if const { R::WIDTH == 1 } {
            Tangent::Swept(call_four_lanes(build))
        } else if const { R::VARIED_PARTS } && !self.parameters[0].has_the_papers_geometry() {
            Tangent::Swept(build.run::<R>())
        } else {
            let source = &Constants(&self.parameters);
            Tangent::InLanes(Box::new(SceneEquations::new(self.choice, source, self.gains)))
        }
    }
}
