//! The derivative of a step of the implicit midpoint rule.

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::system::{Linear, StageState, System};
use crate::formulation::varied_equations::{DIRECTIONS, Varied, VariedEquations};
use crate::method::implicit_midpoint::ImplicitMidpoint;
use crate::method::linearize::{Factors, Linearization};
use crate::method::newton::Newton;
use crate::method::traits::Step;
use crate::method::varied::{Differentiable, Drives, constants, solve_slopes, values};
use crate::model::drive::Drive;
use crate::number::lanes::Lanes;
use crate::number::real::Real;

impl<T: Linear<f64>> Differentiable for Newton<ImplicitMidpoint, Factors<f64>, T> {
    /// The stage is y + z with z = h/2 f(y + z), so (2/h I - J) dz is the derivative of f(y + z) for constant z.
    #[inline(always)]
    fn differentiate(
        &self,
        system: &VariedEquations,
        drives: &Drives<'_>,
        step: &Step<'_, Varied>,
        end: &States<f64>,
        next: &mut States<Varied>,
    ) {
        let size = system.size();
        let half = 0.5 * step.h.value;
        let mut z = [0.0; MAX_COMPONENTS];
        for n in 0..size.states {
            z[n] = 0.5 * (end[n] - step.y[n].value);
        }
        let along = constants(&z);
        let at = StageState { from: step.y, by: Varied::constant(1.0), along: &along };
        let tau = step.tau + Varied::constant(half);
        let mut loads = [Varied::zero(); MAX_COMPONENTS];
        system.rates(&drives.varied.at(tau), &drives.varied.contacts, at, &mut loads);

        let mut middle = values(step.y);
        for n in 0..size.states {
            middle[n] += z[n];
        }
        let mut linearization = Linearization::new(size);
        linearization.take(self.tangent(), drives.own, tau.lane(0), &middle);
        let factors = linearization.factor(2.0 / step.h.value);
        let dz = solve_slopes(&linearization, &factors, &loads);
        *next = constants(end);
        for n in 0..size.all() {
            for k in 0..DIRECTIONS {
                next[n].slope[k] = 2.0f64.mul_add(dz[k][n], step.y[n].slope[k]);
            }
        }
    }
}
