//! The derivative of a step of the implicit midpoint rule.

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::run_dual::RunDual;
use crate::formulation::system::{Linear, System};
use crate::method::implicit_midpoint::ImplicitMidpoint;
use crate::method::linearize::{Factors, Linearization};
use crate::method::newton::Newton;
use crate::method::run_dual::{Differentiable, SolvedStep, add_scaled, solve_slopes, values};
use crate::number::lanes::Lanes;
use crate::number::linear::LaneEntry;

impl<R: Lanes, T: Linear<f64>> Differentiable<R> for Newton<ImplicitMidpoint, Factors<f64>, T> {
    /// The stage is y + z with z = h/2 f(y + z), so (2/h I - J) dz is the derivative of f(y + z) for constant z.
    #[inline(always)]
    fn differentiate(&self, solved: &SolvedStep<'_, R>) -> States<RunDual<R>> {
        let SolvedStep { equations, step, end, .. } = solved;
        let size = equations.system.size();
        let y = values(step.y);
        let mut z = [0.0; MAX_COMPONENTS];
        for n in 0..size.states {
            z[n] = 0.5 * (end[n] - y[n]);
        }
        let (loads, jacobian) = solved.stage(&self.tangent, 0.5, &z);
        let linearization = Linearization::of(size, jacobian.everywhere());
        let factors = linearization.factor(LaneEntry(R::constant(2.0 / step.h.lane(0))));
        let dz = solve_slopes(&linearization, &factors, &loads);
        let mut next = *step.y;
        for n in 0..size.all() {
            add_scaled(&mut next[n], R::constant(2.0), &dz[n]);
        }
        next
    }
}
