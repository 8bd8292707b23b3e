//! A discrete linear controller of the fingers, which measures at every period and sets torques that are held.
//!
//! With the measurements y_k at the instant t_k = origin + k period:
//!
//! u_k = C xi_k + D y_k, limited to v_k; xi_(k+1) = A xi_k + B y_k.
//!
//! v_k acts from t_k + delay until v_(k+1) does. With a delay that is longer than a period several v are under way.

use crate::error::{Error, Result, require, require_at_most};
use crate::model::noise::MOST_SAMPLES;
use crate::model::{Measure, Rule};

/// Largest number of outputs that are under way at a time.
const MOST_UNDER_WAY: f64 = 1e4;

/// A discrete linear controller. Matrices are stored row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledController {
    /// Time between samples, s.
    pub period: f64,
    /// Time from a sample until its torques act, s.
    pub delay: f64,
    /// A, (n, n).
    pub a: Vec<f64>,
    /// B, (n, m).
    pub b: Vec<f64>,
    /// C, (2, n).
    pub c: Vec<f64>,
    /// D, (2, m).
    pub d: Vec<f64>,
    /// The measures; their numbers in a row are y, (m,).
    pub measures: Vec<Measure>,
    /// Smallest and largest torque of each finger, N m; infinite where there is no limit.
    pub limits: [[f64; 2]; 2],
    /// Whether a state is held that would drive a limited torque further beyond its limit.
    pub anti_windup: bool,
    /// Torques until the first sample acts, N m.
    pub initial_torque: [f64; 2],
    /// xi_0, (n,).
    pub initial_state: Vec<f64>,
    /// Standard deviation of each measured number, (m,).
    pub noise: Vec<f64>,
    /// Step of each measured number, (m,); 0 for one that is not rounded.
    pub resolution: Vec<f64>,
    /// Seed, and number of the run.
    pub key: [u64; 2],
}

impl SampledController {
    /// Number of states.
    pub fn states(&self) -> usize {
        self.c.len() / 2
    }

    /// Number of measured numbers.
    pub fn inputs(&self) -> usize {
        self.measures.iter().map(|measure| measure.width()).sum()
    }

    /// Checks numbers and sizes.
    pub fn check(&self) -> Result {
        Rule::Positive.check("control.period", self.period)?;
        Rule::NonNegative.check("control.delay", self.delay)?;
        let under_way = self.delay / self.period;
        let what = "the samples under way (delay / period)";
        require_at_most(what, under_way, MOST_UNDER_WAY, "shorten the delay")?;
        let (n, m) = (self.states(), self.inputs());
        for (field, values, length, rule) in [
            ("A", &self.a, n * n, Rule::Finite),
            ("B", &self.b, n * m, Rule::Finite),
            ("C", &self.c, 2 * n, Rule::Finite),
            ("D", &self.d, 2 * m, Rule::Finite),
            ("initial_state", &self.initial_state, n, Rule::Finite),
            ("measure_noise", &self.noise, m, Rule::NonNegative),
            ("resolution", &self.resolution, m, Rule::NonNegative),
        ] {
            let field = format_args!("control.{field}");
            if values.len() != length {
                let found = format!("{} numbers", values.len());
                return Err(Error::shape(field, found, "must fit the numbers of states and measures"));
            }
            rule.check_all(field, values)?;
        }
        for [low, high] in self.limits {
            require(low <= high, "control.limits", low, "must not be above the largest torque")?;
        }
        Rule::Finite.check_all("control.initial_torque", &self.initial_torque)
    }

    /// Refuses more samples than a run can be divided into, and samples that the clock cannot tell apart.
    pub fn require_countable(&self, from: f64, until: f64) -> Result {
        let needed = (until - from) / self.period;
        let what = "the controller's samples (duration / period)";
        require_at_most(what, needed, MOST_SAMPLES, "lengthen the period or shorten the run")?;
        let size = from.abs().max(until.abs());
        let rule = "must be more than round-off of the times of the run";
        require(size + 0.25 * self.period != size, "control.period", self.period, rule)
    }

    /// The instant of a sample.
    pub(super) fn sampled(&self, origin: f64, number: u64) -> f64 {
        number as f64 * self.period + origin
    }

    /// The instant from which a sample's torques act.
    pub(super) fn applied(&self, origin: f64, number: u64) -> f64 {
        match self.whole_periods() {
            Some(periods) => self.sampled(origin, number + periods),
            None => self.sampled(origin, number) + self.delay,
        }
    }

    /// The delay in periods, if it is a multiple of them but for round-off. Torques then act at the instants of
    /// samples exactly, and after these.
    fn whole_periods(&self) -> Option<u64> {
        let periods = (self.delay / self.period).round();
        let whole = (self.delay - periods * self.period).abs() <= 1e-9 * self.period;
        whole.then_some(periods as u64)
    }

    /// The first instant after `t` at which a sample is taken or acts.
    pub fn next_break(&self, origin: f64, t: f64) -> f64 {
        let sample = self.first_after(origin, 0.0, t);
        match self.whole_periods() {
            Some(_) => sample,
            None => sample.min(self.first_after(origin, self.delay, t)),
        }
    }

    /// The first instant after `t` that is later than a sample by `delay`.
    fn first_after(&self, origin: f64, delay: f64, t: f64) -> f64 {
        let mut number = ((t - origin - delay) / self.period) as u64; // a whole number, saturating
        // Quotient and product are rounded, so the right number may be one lower or higher.
        while number > 0 && self.sampled(origin, number - 1) + delay > t {
            number -= 1;
        }
        while self.sampled(origin, number) + delay <= t {
            number += 1;
        }
        self.sampled(origin, number) + delay
    }

    /// Largest number of outputs that are under way at a time.
    pub(super) fn under_way(&self) -> usize {
        (self.delay / self.period).ceil() as usize + 1
    }

    /// The length of `ControllerState::row`.
    pub fn width(&self) -> usize {
        5 + self.states() + 2 * self.under_way()
    }
}

#[cfg(test)]
pub(crate) mod tests;
