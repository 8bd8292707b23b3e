//! The length of the next step from the error of the last: proportional-integral control, shared by all methods with an
//! error estimate (Gustafsson, "Control-theoretic techniques for stepsize selection in explicit Runge-Kutta methods",
//! 1991; Hairer and Wanner, "Solving Ordinary Differential Equations II", IV.2). The powers are the `libm` crate's, plain
//! Rust, so that every machine takes the same steps.

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
            return Err(f64::max(SAFETY * libm::pow(error, -1.0 / self.order), SHRINK));
        }
        if self.fresh && !self.rejected {
            self.fresh = false;
            let growth = SAFETY * libm::pow(error.max(LEAST_GUESS), -1.0 / self.order);
            return Ok(growth.clamp(SHRINK, GROW_GUESS));
        }
        self.fresh = false;
        let error = error.max(LEAST);
        let trend = libm::pow(self.previous, PROPORTIONAL / self.order);
        let growth = SAFETY * libm::pow(error, -INTEGRAL / self.order) * trend;
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
    fn a_step_shrinks_where_it_must_and_grows_where_it_may() {
        let mut control = StepControl::new(4.0, 1.0);
        let mut guess = control;
        assert!((guess.judge(1e-6).unwrap() - 0.9 * 1e-6_f64.powf(-0.25)).abs() < 1e-12);
        assert!(guess.judge(1e-6).unwrap() <= GROW);
        let shorter = control.judge(16.0).unwrap_err();
        assert!((shorter - 0.45).abs() < 1e-15, "{shorter}");
        assert!(control.retries());
        // Not at once longer again, then as the error allows.
        assert!(control.judge(0.1).unwrap() <= 1.0);
        assert!(control.judge(1e-9).unwrap() > 2.0);
        assert_eq!(control.judge(f64::NAN), Err(UNSOLVED));
        assert_eq!(control.judge(f64::INFINITY), Err(UNSOLVED));
    }
}
