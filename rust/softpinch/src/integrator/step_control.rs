//! The length of the next step from the error of the last: proportional-integral control, shared by all methods with an
//! error estimate (Gustafsson, "Control-theoretic techniques for stepsize selection in explicit Runge-Kutta methods",
//! 1991; Hairer and Wanner, "Solving Ordinary Differential Equations II", IV.2). Its powers are our own, so that every machine takes
//! the same steps, and short: a library's, exact to the last bit, would take as long as a lane's share of a step.

/// Aims below the allowed error by this factor of the length.
const SAFETY: f64 = 0.9;
/// A step is at most this much shorter than the one before, and at most this much longer.
const SHRINK: f64 = 0.2;
const GROW: f64 = 6.0;
/// After an iteration that did not converge, or a number that overflowed.
const UNSOLVED: f64 = 0.25;
/// The control's gains, over the order of the error.
const INTEGRAL: f64 = 0.7;
const PROPORTIONAL: f64 = 0.4;
/// An error below this share of the allowed one counts as this much: next to nothing says nothing of its trend.
const LEAST: f64 = 1e-8;
/// The first step of a stretch is a cautious guess, and what follows it may be so much longer.
const GROW_GUESS: f64 = 100.0;
const LEAST_GUESS: f64 = 1e-18;
/// What is taken for the error before the first step.
const BEFORE: f64 = 1e-4;

/// x^y for a normal x > 0 and |y| <= 1, to eight digits: log2 by the series of artanh about 1, 2^t by that of exp.
#[inline(always)]
fn power(x: f64, y: f64) -> f64 {
    const FRACTION: u64 = (1 << 52) - 1;
    // x = 2^e m with m from 1/sqrt(2) to sqrt(2).
    let bits = x.to_bits() + (1.0f64.to_bits() - std::f64::consts::FRAC_1_SQRT_2.to_bits());
    #[allow(clippy::cast_precision_loss)] // 11 bits
    let e = (bits >> 52) as f64 - 1023.0;
    let m = f64::from_bits((bits & FRACTION) + std::f64::consts::FRAC_1_SQRT_2.to_bits());
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let series = z.mul_add(z.mul_add(z.mul_add(z.mul_add(1.0 / 9.0, 1.0 / 7.0), 0.2), 1.0 / 3.0), 1.0);
    let t = y * (2.0 * std::f64::consts::LOG2_E * s).mul_add(series, e);
    // t = k + f with f from -1/2 to 1/2.
    let rounded = t + ROUNDER;
    let f = (t - (rounded - ROUNDER)) * std::f64::consts::LN_2;
    let mut exp = 1.0 / 5040.0;
    for coefficient in [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        exp = f.mul_add(exp, coefficient);
    }
    // The lowest bits of `rounded` are k: behind the exponent's place it multiplies by 2^k.
    f64::from_bits(exp.to_bits().wrapping_add(rounded.to_bits() << 52))
}

/// Adding it rounds to a whole number and leaves that in the lowest bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// The control of one run.
#[derive(Debug, Clone, Copy)]
pub struct StepControl {
    /// The error grows with this power of the length.
    order: f64,
    /// Growth by less is not worth a change.
    worth: f64,
    /// Error of the last accepted step.
    previous: f64,
    /// Whether the step before this attempt was rejected.
    rejected: bool,
    /// Whether no step of the stretch stands yet.
    fresh: bool,
}

impl StepControl {
    /// For a method whose error grows with the power `order`.
    #[must_use]
    #[inline(always)]
    pub fn new(order: f64, worth: f64) -> Self {
        Self { order, worth, previous: BEFORE, rejected: false, fresh: true }
    }

    /// Begins a stretch, whose first step is a guess.
    #[inline(always)]
    pub fn restart(&mut self) {
        (self.fresh, self.rejected, self.previous) = (true, false, BEFORE);
    }

    /// Whether the attempt follows a rejected one.
    #[must_use]
    #[inline(always)]
    pub fn retries(&self) -> bool {
        self.rejected
    }

    /// By how much the next attempt is shorter after an iteration that did not converge.
    #[inline(always)]
    pub fn unsolved(&mut self) -> f64 {
        self.rejected = true;
        UNSOLVED
    }

    /// By how much the step after one of this error, in allowed errors, is longer; or the next attempt shorter.
    #[inline(always)]
    pub fn judge(&mut self, error: f64) -> Result<f64, f64> {
        if !error.is_finite() {
            return Err(self.unsolved());
        }
        if error > 1.0 {
            self.rejected = true;
            return Err(f64::max(SAFETY * power(error, -1.0 / self.order), SHRINK));
        }
        if self.fresh && !self.rejected {
            self.fresh = false;
            let growth = SAFETY * power(error.max(LEAST_GUESS), -1.0 / self.order);
            return Ok(growth.clamp(SHRINK, GROW_GUESS));
        }
        self.fresh = false;
        let error = error.max(LEAST);
        let trend = power(self.previous, PROPORTIONAL / self.order);
        let growth = SAFETY * power(error, -INTEGRAL / self.order) * trend;
        let most = if self.rejected { 1.0 } else { GROW };
        let growth = growth.clamp(SHRINK, most);
        self.previous = error;
        self.rejected = false;
        Ok(if (1.0..self.worth).contains(&growth) { 1.0 } else { growth })
    }

    /// The first step for a relative `tolerance`, from how fast the states change (`rate`, 1/s) and how fast their rates do
    /// (`curvature`, 1/s^2), as shares of their sizes: where the shorter of these times is h of order one, the error would be
    /// a hundredth of what is allowed.
    #[must_use]
    #[inline(always)]
    pub fn first(&self, tolerance: f64, rate: f64, curvature: f64) -> f64 {
        libm::pow(0.01 * tolerance, 1.0 / self.order) / rate.max(curvature.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn a_step_shrinks_where_it_must_and_grows_where_it_may() {
        let mut control = StepControl::new(4.0, 1.0);
        let mut guess = control;
        assert!((guess.judge(1e-6).unwrap() - 0.9 * 1e-6_f64.powf(-0.25)).abs() < 1e-6);
        assert!(guess.judge(1e-6).unwrap() <= GROW);
        let shorter = control.judge(16.0).unwrap_err();
        assert!((shorter - 0.45).abs() < 1e-8, "{shorter}");
        assert!(control.retries());
        // Not at once longer again, then as the error allows.
        assert!(control.judge(0.1).unwrap() <= 1.0);
        assert!(control.judge(1e-9).unwrap() > 2.0);
        assert_eq!(control.judge(f64::NAN), Err(UNSOLVED));
        assert_eq!(control.judge(f64::INFINITY), Err(UNSOLVED));
    }
}
