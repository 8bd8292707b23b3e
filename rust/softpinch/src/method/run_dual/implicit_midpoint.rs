//! The derivative of a step of the implicit midpoint rule.

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::run_dual::{RunDual, RunDualEquations};
use crate::formulation::system::{Linear, StageState, System};
use crate::method::implicit_midpoint::ImplicitMidpoint;
use crate::method::linearize::{Factors, Linearization};
use crate::method::newton::Newton;
use crate::method::run_dual::{Differentiable, add_scaled, constants, solve_slopes, values};
use crate::method::traits::Step;
use crate::model::drive::SegmentDrive;
use crate::number::lanes::Lanes;
use crate::number::linear::LaneEntry;
use crate::number::real::Real;

impl<R: Lanes, T: Linear<f64>> Differentiable<R> for Newton<ImplicitMidpoint, Factors<f64>, T> {
    /// The stage is y + z with z = h/2 f(y + z), so (2/h I - J) dz is the derivative of f(y + z) for constant z.
    #[inline(always)]
    fn differentiate(
        &self,
        equations: &RunDualEquations<R>,
        drive: &SegmentDrive<RunDual<R>>,
        step: &Step<'_, RunDual<R>>,
        end: &States<f64>,
        next: &mut States<RunDual<R>>,
    ) {
        let system = &equations.system;
        let size = system.size();
        let y = values(step.y);
        let mut z = [0.0; MAX_COMPONENTS];
        let mut middle = y;
        for n in 0..size.states {
            z[n] = 0.5 * (end[n] - y[n]);
            middle[n] += z[n];
        }
        let input = drive.at(step.tau + RunDual::constant(0.5) * step.h);
        let at = StageState { from: step.y, by: RunDual::constant(1.0), along: &constants(&z) };
        let mut loads = [RunDual::zero(); MAX_COMPONENTS];
        system.rates(&input, &drive.contacts, at, &mut loads);
        let linearization = Linearization::of(size, equations.jacobian(&input, &middle).everywhere());
        let factors = linearization.factor(LaneEntry(R::constant(2.0 / step.h.lane(0))));
        let dz = solve_slopes(&linearization, &factors, &loads);
        *next = constants(end);
        for n in 0..size.all() {
            let mut sum = step.y[n];
            add_scaled(&mut sum, R::constant(2.0), &dz[n]);
            next[n].slope = sum.slope;
        }
    }
}
