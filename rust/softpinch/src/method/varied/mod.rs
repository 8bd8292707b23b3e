//! The derivatives of the steps of methods that solve equations. Explicit methods take their steps in dual numbers
//! themselves; here the step is taken in plain numbers, as in any run, and the equations of its solved stages are
//! differentiated after that.
//!
//! | file | contents |
//! |---|---|
//! | `implicit_midpoint.rs`, `radau5.rs` | the derivatives of the stages, by the Jacobian at each of them |
//! | `rosenbrock.rs` | the same for the linearly implicit stages, with the derivative of the Jacobian |

mod implicit_midpoint;
mod radau5;
mod rosenbrock;

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::scene_equations::SceneEquations;
use crate::formulation::varied_equations::{DIRECTIONS, Varied, VariedEquations};
use crate::method::dop853::Dop853;
use crate::method::linearize::{Factors, Linearization};
use crate::method::rk4::Rk4;
use crate::method::traits::{Integrator, Stats, Step, Unsolved};
use crate::model::drive::SegmentDrive;
use crate::number::real::Real;

/// The inputs of a segment, with and without their derivatives.
pub struct Drives<'a> {
    /// With derivatives.
    pub varied: &'a SegmentDrive<Varied>,
    /// Without derivatives.
    pub own: &'a SegmentDrive,
}

/// A method whose last step can be differentiated.
pub trait Differentiable: Integrator<f64, SceneEquations<f64>> {
    /// Writes the state `end` of the step just taken, with its derivatives, into `next`.
    fn differentiate(
        &self,
        system: &VariedEquations,
        drives: &Drives<'_>,
        step: &Step<'_, Varied>,
        end: &States<f64>,
        next: &mut States<Varied>,
    );
}

/// A method that takes each step in plain numbers and differentiates it after that.
pub struct Solved<M> {
    method: M,
    system: SceneEquations<f64>,
    /// The inputs of the segment without their derivatives.
    drive: SegmentDrive,
}

impl<M> Solved<M> {
    /// The method before its first step.
    pub fn new(method: M, system: SceneEquations<f64>) -> Self {
        Self { method, system, drive: SegmentDrive::still() }
    }
}

/// What a run tells its method at the start of a segment.
pub trait Segments {
    /// Begins a segment with the inputs `drive`. `linearized` is the point of the Jacobian that a resumed run uses.
    /// A method that keeps nothing between steps ignores both.
    fn begin(&mut self, drive: SegmentDrive, linearized: Option<(f64, States<f64>)>) {
        let _ = (drive, linearized);
    }
}

impl Segments for Rk4<Varied> {}
impl Segments for Dop853<Varied> {}

impl<M: Differentiable> Segments for Solved<M> {
    fn begin(&mut self, drive: SegmentDrive, linearized: Option<(f64, States<f64>)>) {
        self.method.restart();
        if let Some((tau, y)) = linearized
            && self.method.keeps_jacobian()
        {
            self.method.take_jacobian(&drive, tau, &y);
        }
        self.drive = drive;
    }
}

/// The values of numbers with derivatives.
#[inline(always)]
#[must_use]
pub fn values(numbers: &States<Varied>) -> States<f64> {
    numbers.map(|number| number.value)
}

impl<M: Differentiable> Integrator<Varied, VariedEquations> for Solved<M> {
    type Failure = Unsolved;

    #[inline(always)]
    fn step(
        &mut self,
        system: &VariedEquations,
        drive: &SegmentDrive<Varied>,
        step: &Step<'_, Varied>,
        next: &mut States<Varied>,
        stats: &mut Stats,
    ) -> Result<(), Unsolved> {
        let (y, rate) = (values(step.y), values(step.rate));
        let own = Step { tau: step.tau.value, h: step.h.value, y: &y, rate: &rate, allowed: None };
        let mut end = [0.0; MAX_COMPONENTS];
        self.method.step(&self.system, &self.drive, &own, &mut end, stats).map_err(Into::into)?;
        let drives = Drives { varied: drive, own: &self.drive };
        self.method.differentiate(system, &drives, step, &end, next);
        Ok(())
    }
}

/// Numbers with these values and with derivatives of zero.
#[inline(always)]
fn constants(values: &States<f64>) -> States<Varied> {
    values.map(Varied::constant)
}

/// For each direction the solution of (g I - J) x = b, where `loads` have the directions' b as derivatives.
#[inline(always)]
fn solve_slopes(
    linearization: &Linearization,
    factors: &Factors<f64>,
    loads: &States<Varied>,
) -> [States<f64>; DIRECTIONS] {
    let mut solutions = [[0.0; MAX_COMPONENTS]; DIRECTIONS];
    for (k, solution) in solutions.iter_mut().enumerate() {
        *solution = linearization.solve_with_works(factors, &loads.map(|load| load.slope[k]));
    }
    solutions
}
