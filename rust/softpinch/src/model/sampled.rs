//! A discrete linear controller of the fingers, which measures at every period and sets torques that are held; or a
//! cascade of them, in which a controller's outputs are the targets of the next one.
//!
//! With the measurements y_k at the instant t_k = origin + first_sample + k period:
//!
//! u_k = C xi_k + D y_k, limited to v_k; xi_(k+1) = A xi_k + B y_k.
//!
//! v_k is computed at t_k + measure_delay and acts `delay` later. With delays above a period several v are under way.

use std::sync::Arc;

use crate::error::{Error, Result, brief, require, require_at_most};
use crate::model::noise::{MOST_SAMPLES, normal, uniforms};
use crate::model::{Measure, Rule};
use crate::number::inlined;

/// Largest number of outputs that are under way at a time.
const MOST_UNDER_WAY: f64 = 1e4;
/// The stream of the last block's noise, jitter and losses; others count down from it, those of disturbances up from 0.
const STREAM: u64 = u64::MAX;
/// Instants of a cascade that are closer than this share of a period are one.
const SAME: f64 = 1e-9;
/// The largest lateness of a sample, in periods, so that no sample overtakes another one.
const LATEST: f64 = 0.999;

/// A discrete linear controller. Matrices are stored row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledController {
    /// Time between samples, s.
    pub period: f64,
    /// Time from the start until the first sample, s.
    pub first_sample: f64,
    /// Time from a sample until its measurements are used, s.
    pub measure_delay: f64,
    /// Time from then until its torques act, s.
    pub delay: f64,
    /// Probability with which the measurements of a sample are lost, so that those before it are used.
    pub loss: f64,
    /// Largest lateness of samples, s; the standard deviation of a normal number whose size it is, if `normal_jitter`.
    pub jitter: f64,
    /// Whether the lateness is the size of a normal number.
    pub normal_jitter: bool,
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
    /// Largest change of a torque in a second, N m/s; infinite where there is no limit.
    pub rate_limit: f64,
    /// The measured rate of a finger, rad/s, at which its motor's limit in this direction is 0; infinite if it is constant.
    pub no_load_rate: f64,
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
    /// Half the width of each measured number's dead zone, (m,).
    pub dead_zone: Vec<f64>,
    /// A second set of gains.
    pub switch: Option<GainSwitch>,
    /// Seed, and number of the run.
    pub key: [u64; 2],
    /// The block before this one in a cascade.
    pub outer: Option<Arc<SampledController>>,
    /// What [`cascade`](Self::cascade) finds.
    pub place: Place,
}

/// A second set of gains, of the sizes of the first one, and when it acts.
#[derive(Debug, Clone, PartialEq)]
pub struct GainSwitch {
    /// The instant from which on it acts, s, or infinity.
    pub at: f64,
    /// The numbers of y that decide: the first of them, and the one after the last.
    pub entries: [usize; 2],
    /// It acts if one of them is above this threshold,
    pub above: f64,
    /// or below this one.
    pub below: f64,
    /// Whether it stays once it acts.
    pub latched: bool,
    /// A, B, C and D.
    pub gains: [Vec<f64>; 4],
}

/// The place of a block in its cascade, and its instants after a sample.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Place {
    /// Number of blocks after this one.
    after: u64,
    /// Period and first sample of the last block, s.
    grid: [f64; 2],
    /// From a sample until its measurements are used and its torques act, and from the one until the other.
    used: Delay,
    acts: Delay,
    waits: Delay,
}

/// A time, s, and its number of periods, if it is a multiple of them but for round-off. It then ends at a sample
/// exactly, and after it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Delay(f64, Option<u64>);

impl SampledController {
    /// The last one of these blocks, each of which gives the next its targets, with the run's number as its key.
    pub fn cascade(blocks: Vec<Arc<Self>>, number: u64) -> Option<Arc<Self>> {
        let last = blocks.last()?;
        let (grid, key, mut after) =
            ([last.period, last.first_sample], [last.key[0], number], blocks.len() as u64);
        blocks.into_iter().fold(None, |outer, block| {
            after -= 1;
            let SampledController { measure_delay, delay, .. } = *block;
            let [used, acts, waits] =
                [measure_delay, measure_delay + delay, delay].map(|time| block.of(time));
            let place = Place { after, grid, used, acts, waits };
            Some(Arc::new(Self { key, outer, place, ..(*block).clone() }))
        })
    }

    inlined! {
        /// The blocks of the cascade, the last one first.
        pub blocks(&self) -> impl Iterator<Item = &Self> =
            std::iter::successors(Some(self), |block| block.outer.as_deref());
        /// Number of states.
        pub states(&self) -> usize = self.c.len() / 2;
        /// Number of measured numbers.
        pub inputs(&self) -> usize = self.measures.iter().map(|measure| measure.width()).sum();
    }

    /// Checks numbers and sizes.
    pub fn check(&self) -> Result {
        self.blocks().try_for_each(Self::check_own)
    }

    fn check_own(&self) -> Result {
        let control = format!("control{}", ".outer".repeat(self.place.after as usize));
        Rule::Positive.check(format_args!("{control}.period"), self.period)?;
        for (field, value, rule) in [
            ("first_sample", self.first_sample, Rule::NonNegative),
            ("measure_delay", self.measure_delay, Rule::NonNegative),
            ("delay", self.delay, Rule::NonNegative),
            ("jitter", self.jitter, Rule::NonNegative),
            ("rate_limit", self.rate_limit, Rule::PositiveOrInfinite),
            ("no_load_rate", self.no_load_rate, Rule::PositiveOrInfinite),
        ] {
            rule.check(format_args!("{control}.{field}"), value)?;
        }
        let late = format_args!("{control}.jitter");
        require(self.jitter < self.period, late, self.jitter, "must be below the period")?;
        let rule = "must be >= 0 and < 1";
        require((0.0..1.0).contains(&self.loss), format_args!("{control}.loss"), self.loss, rule)?;
        let under_way = (self.measure_delay + self.delay) / self.period;
        if under_way > MOST_UNDER_WAY {
            let name = if self.delay < self.measure_delay { "measure_delay" } else { "delay" };
            let found =
                format_args!("measure_delay + delay are {} periods of {} s", brief(under_way), self.period);
            return Err(Error::shape(format_args!("{control}.{name}"), found, "must be at most 10 000"));
        }
        let (n, m) = (self.states(), self.inputs());
        for (field, values, length, rule) in [
            ("A", &self.a, n * n, Rule::Finite),
            ("B", &self.b, n * m, Rule::Finite),
            ("C", &self.c, 2 * n, Rule::Finite),
            ("D", &self.d, 2 * m, Rule::Finite),
            ("initial_state", &self.initial_state, n, Rule::Finite),
            ("measure_noise", &self.noise, m, Rule::NonNegative),
            ("resolution", &self.resolution, m, Rule::NonNegative),
            ("dead_zone", &self.dead_zone, m, Rule::NonNegative),
        ] {
            let field = format_args!("{control}.{field}");
            if values.len() != length {
                let found = format!("{} numbers", values.len());
                return Err(Error::shape(field, found, "must fit the numbers of states and measures"));
            }
            rule.check_all(field, values)?;
        }
        for own in self.switch.iter().flat_map(|switch| &switch.gains) {
            Rule::Finite.check_all(format_args!("{control}.switch"), own)?;
        }
        for [low, high] in self.limits {
            let field = format_args!("{control}.limits");
            require(low <= high, field, low, "must not be above the largest torque")?;
            let around = low <= 0.0 && high >= 0.0 && high - low < f64::INFINITY;
            let rule = "must be finite and on both sides of 0, for a motor";
            require(around || self.no_load_rate == f64::INFINITY, field, low, rule)?;
        }
        Rule::Finite.check_all(format_args!("{control}.initial_torque"), &self.initial_torque)
    }

    /// Refuses more samples than a run can be divided into, and samples that the clock cannot tell apart.
    pub fn require_countable(&self, from: f64, until: f64) -> Result {
        let needed: f64 = self.blocks().map(|block| (until - from) / block.period).sum();
        let what = "the controller's samples (duration / period)";
        require_at_most(what, needed, MOST_SAMPLES, "lengthen the period or shorten the run")?;
        let size = from.abs().max(until.abs());
        let rule = "must be more than round-off of the times of the run";
        self.blocks().try_for_each(|block| {
            require(size + 0.25 * block.period != size, "control.period", block.period, rule)
        })
    }

    /// The instant of a sample.
    #[inline(always)]
    pub(super) fn sampled(&self, origin: f64, number: u64) -> f64 {
        let late = if self.jitter == 0.0 { 0.0 } else { self.late(number) };
        self.snapped(origin, number as f64 * self.period + (origin + self.first_sample) + late)
    }

    /// How late a sample is.
    #[cold]
    fn late(&self, number: u64) -> f64 {
        let [_, a, b, _] = self.drawn(number);
        let late = if self.normal_jitter { normal(a, b).0.abs() } else { a };
        (self.jitter * late).min(LATEST * self.period)
    }

    /// The instant, or the sample of the last block that it is but for round-off, which else would set their order.
    #[inline(always)]
    fn snapped(&self, origin: f64, t: f64) -> f64 {
        if self.place.after == 0 { t } else { self.snapped_to_last(origin, t) }
    }

    fn snapped_to_last(&self, origin: f64, t: f64) -> f64 {
        let [period, first_sample] = self.place.grid;
        let first = origin + first_sample;
        let near = ((t - first) / period).round() * period + first;
        if near >= first && (t - near).abs() <= SAME * period { near } else { t }
    }

    /// Whether the measurements of a sample are lost. Those of the first one never are.
    pub(super) fn is_lost(&self, number: u64) -> bool {
        self.loss > 0.0 && number > 0 && self.drawn(number)[0] < self.loss
    }

    /// Uniform numbers of a sample, for its loss and its jitter. Noise of measured numbers has other counters.
    fn drawn(&self, number: u64) -> [f64; 4] {
        uniforms([number, self.stream(), u64::MAX, 0], self.key)
    }

    pub(super) fn stream(&self) -> u64 {
        STREAM - self.place.after
    }

    pub(super) fn used(&self, origin: f64, number: u64) -> f64 {
        self.later(origin, number, self.place.used)
    }

    /// A, B, C and D for the measurements y of a sample; `second` says whether the sample before had the second ones.
    pub(super) fn gains(
        &self,
        origin: f64,
        number: u64,
        y: &[f64],
        second: &mut Option<bool>,
    ) -> [&Vec<f64>; 4] {
        if let Some(GainSwitch { at, entries, above, below, latched, gains }) = &self.switch {
            let crosses = y[entries[0]..entries[1]].iter().any(|value| value > above || value < below);
            let late = self.used(origin, number) + SAME * self.period >= *at;
            *second = Some(late || crosses || (*latched && *second == Some(true)));
            if *second == Some(true) {
                return gains.each_ref();
            }
        }
        [&self.a, &self.b, &self.c, &self.d]
    }

    /// The instant from which a sample's torques act.
    pub(super) fn applied(&self, origin: f64, number: u64) -> f64 {
        match self.place.waits.1 {
            Some(periods) => self.used(origin, number + periods),
            None => self.later(origin, number, self.place.acts),
        }
    }

    fn later(&self, origin: f64, number: u64, Delay(time, periods): Delay) -> f64 {
        match periods {
            Some(periods) => self.sampled(origin, number + periods),
            None => self.after(origin, number, time),
        }
    }

    #[inline(always)]
    fn after(&self, origin: f64, number: u64, delay: f64) -> f64 {
        self.snapped(origin, self.sampled(origin, number) + delay)
    }

    /// With jitter only no delay is a multiple of the period.
    fn of(&self, time: f64) -> Delay {
        let periods = (time / self.period + 0.5) as u64;
        let off = (time - periods as f64 * self.period).abs();
        let whole = time == 0.0 || (self.jitter == 0.0 && off <= SAME * self.period);
        Delay(time, whole.then_some(periods))
    }

    /// The first instant after `t` at which a sample of this block is taken, is used, or acts.
    pub fn next_break(&self, origin: f64, t: f64) -> f64 {
        let Place { used, acts, waits, .. } = self.place;
        let used = used.1.is_none().then_some(used.0);
        let acts = (acts.1.is_none() && waits.1.is_none()).then_some(acts.0);
        let first = |delay: f64| self.first_after(origin, delay, t);
        used.into_iter().chain(acts).map(first).fold(first(0.0), f64::min)
    }

    /// The first instant after `t` that is later than a sample by `delay`.
    fn first_after(&self, origin: f64, delay: f64, t: f64) -> f64 {
        let near = ((t - origin - self.first_sample - delay) / self.period) as u64; // a whole number, saturating
        // Quotient and product are rounded, and samples are late, so the right number may be lower by one or two.
        let from = near.saturating_sub(1 + u64::from(self.jitter > 0.0));
        (from..).map(|number| self.after(origin, number, delay)).find(|&at| at > t).unwrap_or(f64::INFINITY)
    }

    /// Largest number of samples that are under way at a time with a delay.
    pub(super) fn under_way(&self, delay: f64) -> usize {
        (delay / self.period).ceil() as usize + 1 + usize::from(self.jitter > 0.0)
    }

    /// Number of samples whose measurements are kept: those that wait, and the one before, which a lost one repeats.
    pub(super) fn kept(&self) -> usize {
        let keeps = self.measure_delay > 0.0 || self.loss > 0.0;
        if keeps { self.under_way(self.measure_delay) + 1 } else { 0 }
    }

    /// The length of the row of the state of this block.
    pub fn own_width(&self) -> usize {
        let kept = self.kept();
        let flags = usize::from(kept > 0) + usize::from(self.switch.is_some());
        5 + self.states() + 2 * self.under_way(self.delay) + kept * self.inputs() + flags
    }

    /// The length of the rows of all blocks.
    pub fn width(&self) -> usize {
        self.blocks().map(Self::own_width).sum()
    }
}

#[cfg(test)]
pub(crate) mod tests;
