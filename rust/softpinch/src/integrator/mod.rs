//! How time is stepped: one file a method, each with its tableau and its paper.
//!
//! A new method is one file beside `rk4.rs` and one line in each table below.

pub mod dop853;
pub mod rk4;

use crate::formulation::System;
use crate::inputs::Drive;
use crate::real::Real;

/// The methods there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The classical Runge-Kutta method of order four.
    Rk4,
    /// Dormand and Prince's explicit method of order eight.
    Dop853,
}

/// The methods by their public names.
pub const METHODS: [(&str, Method); 2] = [("rk4", Method::Rk4), ("dop853", Method::Dop853)];

impl Method {
    /// Its public name.
    #[must_use]
    pub fn name(self) -> &'static str {
        METHODS.iter().find(|(_, method)| *method == self).map_or("", |&(name, _)| name)
    }

    /// Where the method's stability region ends on the negative real axis; `None` where it does not end.
    #[must_use]
    pub fn real_stability_limit(self) -> Option<f64> {
        match self {
            Self::Rk4 => Some(rk4::REAL_STABILITY_LIMIT),
            Self::Dop853 => Some(dop853::REAL_STABILITY_LIMIT),
        }
    }
}

/// A one-step method.
pub trait Integrator {
    /// Evaluations of the right-hand side in one step, the one at its start included.
    const EVALUATIONS: u64;

    /// One step of length `h` from `y`, which is at time `tau` of its segment and has the derivative `k1`.
    fn step<R: Real, const N: usize, S: System<R, N>, D: Drive<R>>(
        system: &S,
        drive: &D,
        tau: R,
        h: R,
        y: &[R; N],
        k1: &[R; N],
    ) -> [R; N];
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::Energies;
    use crate::formulation::{Evaluation, Motion};
    use crate::inputs::Input;

    /// One equation y' = f(t, y), to see a method alone.
    struct Scalar<F>(F);

    /// Hands the time through as a target angle.
    struct Clock;

    impl Drive<f64> for Clock {
        fn at(&self, tau: f64) -> Input<f64> {
            Input { target: [tau, 0.0], force: [0.0; 3] }
        }
    }

    impl<F: Fn(f64, f64) -> f64> System<f64, 1> for Scalar<F> {
        const STATES: usize = 1;

        fn begin(&self, motion: &Motion<f64>) -> [f64; 1] {
            [motion.q[0]]
        }

        fn evaluate(&self, input: &Input<f64>, y: &[f64; 1]) -> Evaluation<f64, 1> {
            Evaluation {
                rate: [self.0(input.target[0], y[0])],
                motion: Motion { q: [0.0; 9], p: [0.0; 9], memory: [0.0; 2] },
                multipliers: [0.0; 4],
                residuals: [0.0; 4],
                sin_tilt: [0.0; 2],
            }
        }

        fn jump(&self, _: &mut [f64; 1], _: &[f64; 3]) {}

        fn energies(&self, _: &Motion<f64>) -> Energies<f64> {
            Energies { kinetic: 0.0, elastic: 0.0, gravity: 0.0 }
        }
    }

    fn one_step<I: Integrator, F: Fn(f64, f64) -> f64>(f: F, t: f64, h: f64, y: f64) -> f64 {
        let system = Scalar(f);
        let slope = system.evaluate(&Clock.at(t), &[y]).rate;
        I::step(&system, &Clock, t, h, &[y], &slope)[0]
    }

    /// The observed order on y' = -2 t y^2, y = 1 / (1 + t^2), from 0 to 2: the errors at `steps` and twice as many.
    fn order<I: Integrator>(steps: u32) -> f64 {
        let error = |steps: u32| {
            let h = 2.0 / f64::from(steps);
            let end = (0..steps)
                .fold(1.0, |y, k| one_step::<I, _>(|t, y| -2.0 * t * y * y, h * f64::from(k), h, y));
            (end - 0.2_f64).abs()
        };
        (error(steps) / error(2 * steps)).log2()
    }

    #[test]
    fn each_method_has_its_order() {
        assert!((order::<rk4::Rk4>(80) - 4.0).abs() < 0.2, "{}", order::<rk4::Rk4>(80));
        assert!((order::<dop853::Dop853>(12) - 8.0).abs() < 0.5, "{}", order::<dop853::Dop853>(12));
    }

    /// R(z) of an explicit method of order p agrees with e^z in its first p + 1 terms.
    #[test]
    fn stability_functions_are_the_exponential_series_to_the_order() {
        for z in [-0.3, -0.1, 0.1, 0.3_f64] {
            let rk4 = one_step::<rk4::Rk4, _>(|_, y| z * y, 0.0, 1.0, 1.0);
            assert!((rk4 - (1.0 + z + z * z / 2.0 + z.powi(3) / 6.0 + z.powi(4) / 24.0)).abs() < 4e-16);
            let dop = one_step::<dop853::Dop853, _>(|_, y| z * y, 0.0, 1.0, 1.0);
            assert!((dop - z.exp()).abs() < 1e-7 * z.abs().powi(9) / 1e-5 + 4e-16, "{z} {dop}");
        }
    }

    /// Just inside the stated limit a mode decays, just outside it grows.
    #[test]
    fn the_real_stability_limits_are_sharp() {
        let growth = |method: Method, z: f64| match method {
            Method::Rk4 => one_step::<rk4::Rk4, _>(|_, y| z * y, 0.0, 1.0, 1.0),
            Method::Dop853 => one_step::<dop853::Dop853, _>(|_, y| z * y, 0.0, 1.0, 1.0),
        };
        for (_, method) in METHODS {
            let limit = method.real_stability_limit().unwrap();
            assert!(growth(method, -0.9999 * limit).abs() < 1.0, "{method:?}");
            assert!(growth(method, -1.0001 * limit).abs() > 1.0, "{method:?}");
        }
    }
}
