//! The length of the next step from the error of the last one: proportional-integral control, which all
//! methods with an error estimate share (Gustafsson, "Control-theoretic techniques for stepsize selection in
//! explicit Runge-Kutta methods", 1991; Hairer and Wanner, "Solving Ordinary Differential Equations II",
//! IV.2). The power function is our own, so that every machine takes the same steps. It is short: a library's
//! function, exact to the last bit, would take as long as a lane's share of a step.

use crate::number::powers::{ROUNDER, bits, split};
use crate::number::{Bits, Lanes};

/// The next length is this much shorter than the control asks for, so that the error stays below the allowed one.
const SAFETY: f64 = 0.9;
/// Smallest and largest ratio of the length of a step to that of the step before it.
const SHRINK: f64 = 0.2;
const GROW: f64 = 6.0;
/// The ratio after an iteration that did not converge, or after an overflow.
const UNSOLVED: f64 = 0.25;
/// The gains of the control, times the order of the error.
const INTEGRAL: f64 = 0.7;
const PROPORTIONAL: f64 = 0.4;
/// An error below this share of the allowed one counts as this share: very small errors say nothing about the trend.
const LEAST: f64 = 1e-8;
/// The first step of a segment is a cautious guess. The step after it may be longer by the first factor, and
/// the error of the guess counts as no smaller than the second number.
const GROW_GUESS: f64 = 100.0;
const LEAST_GUESS: f64 = 1e-18;
/// The value that replaces the previous error before the first step.
const BEFORE: f64 = 1e-4;

/// x^y for a normal x > 0 and |y| <= 1, with a relative error below 5e-8. log2 uses the series of artanh
/// about 1, and 2^t uses the series of exp.
#[inline(always)]
fn power<R: Lanes>(x: R, y: f64) -> R {
    let c = R::constant;
    let (e, m) = split(x);
    let s = (m - c(1.0)) / (m + c(1.0));
    let z = s * s;
    let series =
        z.mul_add(z.mul_add(z.mul_add(z.mul_add(c(1.0 / 9.0), c(1.0 / 7.0)), c(0.2)), c(1.0 / 3.0)), c(1.0));
    let t = c(y) * (c(2.0 * std::f64::consts::LOG2_E) * s).mul_add(series, e);
    // t = k + f with f from -1/2 to 1/2.
    let rounded = t + c(ROUNDER);
    let f = (t - (rounded - c(ROUNDER))) * c(std::f64::consts::LN_2);
    let mut exp = c(1.0 / 5040.0);
    for coefficient in [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        exp = f.mul_add(exp, c(coefficient));
    }
    // `rounded` has k in its lowest bits. Shifted to the place of the exponent, they multiply by 2^k.
    bits(exp, rounded, |exp, k| exp.wrapping_add(k << 52))
}

/// The step control of the runs in all lanes.
#[derive(Debug, Clone, Copy)]
pub struct StepControl<R = f64> {
    order: f64,
    min_growth: f64,
    /// The errors of the last accepted steps.
    previous: R,
    /// Lanes in which the attempt before this one was rejected.
    pub rejected: Bits,
    /// Lanes in which no step of the segment has been accepted yet.
    starting: Bits,
}

impl<R: Lanes> StepControl<R> {
    #[inline(always)]
    pub fn new(order: f64, min_growth: f64) -> Self {
        Self { order, min_growth, previous: R::constant(BEFORE), rejected: 0, starting: R::ALL }
    }

    /// Begins segments in these lanes. Their first steps are guesses.
    #[inline(always)]
    pub fn restart(&mut self, lanes: Bits) {
        self.starting |= lanes;
        self.rejected &= !lanes;
        self.previous = R::select(lanes, R::constant(BEFORE), self.previous);
    }

    /// The factor by which the next attempt is shorter after an iteration that did not converge.
    #[inline(always)]
    pub fn unsolved(&mut self) -> R {
        self.rejected = R::ALL;
        R::constant(UNSOLVED)
    }

    /// Takes the errors of the steps in all lanes, in units of the allowed error. Returns the lanes whose
    /// steps are accepted, and the factors by which the next steps are longer or the next attempts shorter.
    #[inline(always)]
    pub fn judge(&mut self, errors: R) -> (Bits, R) {
        let c = R::constant;
        let allowed = errors.at_most(c(1.0));
        let (guessed, retried) = (self.starting & !self.rejected & allowed, self.rejected);
        let error = errors.max_in(c(LEAST), R::ALL);
        let trend = power(self.previous, PROPORTIONAL / self.order);
        let mut growth = c(SAFETY) * power(error, -INTEGRAL / self.order) * trend;
        growth = growth.max_in(c(SHRINK), R::ALL).min_in(R::select(retried, c(1.0), c(GROW)), R::ALL);
        // Growth by less than `min_growth` is left out.
        let small = c(1.0).at_most(growth) & growth.less(c(self.min_growth));
        growth = R::select(small, c(1.0), growth);
        let regular = allowed & !guessed;
        self.previous = R::select(regular, error, self.previous);
        let rare = guessed | !allowed;
        if rare & R::ALL != 0 {
            let guess = power(errors.max_in(c(LEAST_GUESS), R::ALL), -1.0 / self.order) * c(SAFETY);
            let guess = guess.max_in(c(SHRINK), R::ALL);
            growth = R::select(guessed, guess.min_in(c(GROW_GUESS), R::ALL), growth);
            growth = R::select(!allowed, guess, growth);
            let overflowed = !errors.less(c(f64::INFINITY));
            growth = R::select(overflowed, c(UNSOLVED), growth);
        }
        (self.starting, self.rejected) = (self.starting & !allowed, R::ALL & !allowed);
        (R::ALL & allowed, growth)
    }

    /// The first step for a relative `tolerance`. `rate` (1/s) says how fast the states change, and
    /// `curvature` (1/s^2) how fast their rates change, both as shares of the magnitudes. With T, the shorter
    /// of the times 1 / rate and 1 / sqrt(curvature), the error of a step h is taken as (h / T)^order; for
    /// the first step this is a hundredth of the tolerance.
    #[inline(always)]
    pub fn first(&self, tolerance: f64, rate: f64, curvature: f64) -> f64 {
        libm::pow(0.01 * tolerance, 1.0 / self.order) / rate.max(curvature.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::number::row::Row4;

    #[test]
    fn powers_agree_with_libm() {
        for k in -600..600_i32 {
            let x = libm::pow(10.0, f64::from(k) / 40.0) * 1.234;
            for y in [-1.0, -0.25, -0.125, 0.05, -0.0875, 0.1, 1.0] {
                let (ours, theirs) = (power(x, y), libm::pow(x, y));
                assert!((ours / theirs - 1.0).abs() < 5e-8, "{x}^{y}: {ours} {theirs}");
            }
        }
    }

    /// The result of the control for one run: the factor, as an `Err` if the step is rejected.
    fn judged(control: &mut StepControl, error: f64) -> Result<f64, f64> {
        let (accepted, factor) = control.judge(error);
        if accepted == 0 { Err(factor) } else { Ok(factor) }
    }

    #[test]
    fn steps_shrink_after_large_errors_and_grow_after_small_ones() {
        let mut control = StepControl::new(4.0, 1.0);
        let mut guess = control;
        assert!((judged(&mut guess, 1e-6).unwrap() - 0.9 * 1e-6_f64.powf(-0.25)).abs() < 1e-6);
        assert!(judged(&mut guess, 1e-6).unwrap() <= GROW);
        let shorter = judged(&mut control, 16.0).unwrap_err();
        assert!((shorter - 0.45).abs() < 1e-8, "{shorter}");
        assert_eq!(control.rejected, 1);
        // The step after a rejected one does not grow. The steps after it grow as the error allows.
        assert!(judged(&mut control, 0.1).unwrap() <= 1.0);
        assert!(judged(&mut control, 1e-9).unwrap() > 2.0);
        assert_eq!(judged(&mut control, f64::NAN), Err(UNSOLVED));
        assert_eq!(judged(&mut control, f64::INFINITY), Err(UNSOLVED));
    }

    #[test]
    fn every_lane_has_the_step_control_of_a_lone_run() {
        let errors = [1e-3, 0.5, 3.0, 1e-30, f64::NAN, 1.0, 0.99, 40.0, f64::INFINITY, 1e-9, 0.0];
        let mut together = StepControl::<Row4>::new(8.0, 1.2);
        let mut alone: [StepControl; 4] = [StepControl::new(8.0, 1.2); 4];
        for step in 0..40 {
            let own = |lane: usize| errors[(step * (lane + 3) + lane) % errors.len()];
            let (accepted, factor) = together.judge(Row4::from_fn(own));
            for lane in 0..4 {
                let (ours, growth) = alone[lane].judge(own(lane));
                assert_eq!((accepted >> lane & 1, factor.lane(lane).to_bits()), (ours, growth.to_bits()));
                assert_eq!(together.rejected >> lane & 1, alone[lane].rejected);
            }
            if step % 9 == 8 {
                together.restart(0b0100);
                alone[2].restart(1);
            }
        }
    }
}
