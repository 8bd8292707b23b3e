//! The implicit midpoint rule, the one-stage Gauss method of order two. It is symmetric, so that energy does
//! not drift, and A-stable. With R(z) = (1 + z/2) / (1 - z/2) it does not damp infinitely stiff modes
//! (Hairer, Lubich and Wanner, "Geometric Numerical Integration", II.1 and V).
//!
//! ```text
//! 1/2 | 1/2
//!     | 1
//! ```

use nalgebra::Complex;

use crate::formulation::{MAX_COMPONENTS, System};
use crate::method::newton::newton;
use crate::method::{Factors, Iteration, Linearization, MethodEntry, Problem, Scheme, Solved, Stats};

pub const ENTRY: MethodEntry = MethodEntry {
    order: 2,
    real_stability_limit: None,
    stability_function: |z| {
        let one = Complex::new(1.0, 0.0);
        (one + z / 2.0) / (one - z / 2.0)
    },
    keeps_jacobian: true,
    alone: |runs, system| Box::new(newton::<_, Factors<f64>>(runs, system, ImplicitMidpoint)),
    adaptive: None,
    error_order: 0.0,
    min_growth: 1.0,
};

pub struct ImplicitMidpoint;

impl<S: System<f64>> Scheme<S> for ImplicitMidpoint {
    type Factors = Factors<f64>;
    const FACTORISATIONS: u64 = 1;

    #[inline(always)]
    fn factor(linearization: &Linearization, h: f64) -> Self::Factors {
        linearization.factor(2.0 / h)
    }

    /// Solves z = h/2 f(y + z). The step ends at y + 2 z.
    #[inline(always)]
    fn solve(&mut self, problem: &Problem<'_, S, Self::Factors>, stats: &mut Stats) -> Solved {
        let step = problem.step;
        let g = 2.0 / step.h;
        let size = step.system.size();
        let mut z = [0.0; MAX_COMPONENTS];
        if problem.is_smooth() {
            for n in 0..size.states {
                z[n] = 0.5 * step.h * step.rate[n];
            }
        }
        let mut iteration = Iteration::new(step.allowed);
        loop {
            stats.iterations += 1;
            let mut residual = problem.rates(0.5, &z, stats);
            for n in 0..size.states {
                residual[n] = g.mul_add(-z[n], residual[n]);
            }
            let correction = problem.linearization.solve(problem.factors, &residual);
            for n in 0..size.states {
                z[n] += correction[n];
            }
            if iteration.judge(problem.size(&correction))? {
                break;
            }
        }
        let mut next = *step.y;
        for n in 0..size.states {
            next[n] = 2.0f64.mul_add(z[n], step.y[n]);
        }
        if size.all() > size.states {
            let powers = problem.rates(0.5, &z, stats);
            for n in size.states..size.all() {
                next[n] = step.h.mul_add(powers[n], step.y[n]);
            }
        }
        Ok((next, iteration.rate))
    }
}
