//! Gaussian forces, each held until the next sample. The random numbers are functions of a counter, so that a
//! sample does not depend on the order in which samples are drawn, or on the process that draws it.
//!
//! The generator is Philox 4x64 with ten rounds (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1,
//! 2, 3", 2011), with the seed and the run's number as its key. Box and Muller's transform makes its numbers normal.

use std::fmt::Display;

use crate::error::{Result, require, require_at_most};
use crate::model::Rule;
use crate::number::sin_cos;

/// Largest number of a sample. Beyond it not every integer is a double.
const MOST_COUNTED: f64 = 9_007_199_254_740_992.0;
/// Largest number of samples in one run, of noise or of a discrete controller.
pub(super) const MOST_SAMPLES: f64 = 1e7;

/// Noise on the object, held between samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviations of F_x, F_y, N, and moment, N m.
    pub std: [f64; 3],
    /// Standard deviations of the acceleration of the hand's frame along fixed axes, m/s^2; for a hand that moves.
    pub acceleration: [f64; 2],
    /// Samples a second, 1/s.
    pub rate: f64,
    /// First instant, s.
    pub start: f64,
    /// Last instant, s; may be infinite.
    pub end: f64,
    /// Seed, and number of the run.
    pub key: [u64; 2],
    /// Number of this noise among the noises of a run.
    pub stream: u64,
}

/// The multipliers of Philox and the increments of its key, as published.
const MULTIPLIERS: [u64; 2] = [0xD2E7_470E_E14C_6C93, 0xCA5A_8263_9512_1157];
const WEYL: [u64; 2] = [0x9E37_79B9_7F4A_7C15, 0xBB67_AE85_84CA_A73B];

fn philox(mut counter: [u64; 4], mut key: [u64; 2]) -> [u64; 4] {
    for _ in 0..10 {
        let wide = |k: usize| u128::from(MULTIPLIERS[k]) * u128::from(counter[2 * k]);
        let [(high0, low0), (high1, low1)] = [0, 1].map(|k| ((wide(k) >> 64) as u64, wide(k) as u64));
        counter = [high1 ^ counter[1] ^ key[0], low1, high0 ^ counter[3] ^ key[1], low0];
        key = [key[0].wrapping_add(WEYL[0]), key[1].wrapping_add(WEYL[1])];
    }
    counter
}

pub(crate) fn normal(a: f64, b: f64) -> (f64, f64) {
    // 1 - a is in (0, 1], where the logarithm is finite.
    let radius = (-2.0 * libm::log(1.0 - a)).sqrt();
    let (sin, cos) = sin_cos(std::f64::consts::TAU * b);
    (radius * cos, radius * sin)
}

/// Four independent numbers of a counter and a key that are uniform from 0, included, to 1. They have 53 bits.
pub fn uniforms(counter: [u64; 4], key: [u64; 2]) -> [f64; 4] {
    philox(counter, key).map(|bits| (bits >> 11) as f64 * (0.5 * f64::EPSILON))
}

/// Four independent standard normal numbers of a counter and a key.
pub fn normals(counter: [u64; 4], key: [u64; 2]) -> [f64; 4] {
    let [a, b, c, d] = uniforms(counter, key);
    let ((x, y), (z, w)) = (normal(a, b), normal(c, d));
    [x, y, z, w]
}

impl Noise {
    /// Checks the noise, which has the number `k` in its scene.
    pub fn check(&self, k: usize) -> Result {
        Rule::NonNegative.check_all(format_args!("noises[{k}].std"), &self.std)?;
        Rule::NonNegative.check_all(format_args!("noises[{k}].acceleration"), &self.acceleration)?;
        Rule::Positive.check(format_args!("noises[{k}].rate"), self.rate)?;
        Rule::Finite.check(format_args!("noises[{k}].start"), self.start)?;
        require_end(format_args!("noises[{k}].end"), self.start, self.end)
    }

    /// The force and moment of a sample.
    pub fn sample(&self, number: u64) -> [f64; 3] {
        let [x, y, moment, _] = normals([number, self.stream, 0, 0], self.key);
        [self.std[0] * x, self.std[1] * y, self.std[2] * moment]
    }

    /// The acceleration that the noise adds to that of the hand's frame from `t` until the next sample.
    pub fn acceleration_at(&self, t: f64) -> [f64; 2] {
        let [std_x, std_y] = self.acceleration;
        if (std_x == 0.0 && std_y == 0.0) || t < self.start || t >= self.end {
            return [0.0; 2];
        }
        let [x, y, ..] = normals([self.number(t), self.stream, 1, 0], self.key);
        [std_x * x, std_y * y]
    }

    fn time(&self, number: u64) -> f64 {
        number as f64 / self.rate + self.start
    }

    /// The number of the sample that holds at `t`. `t` must not be before the start.
    fn number(&self, t: f64) -> u64 {
        let near = ((t - self.start) * self.rate).floor() as u64; // a whole number, saturating
        // Division and product are rounded, so the right number may be one lower or higher.
        let first = near.saturating_sub(1);
        (first..=near.saturating_add(1)).rev().find(|&number| self.time(number) <= t).unwrap_or(first)
    }

    /// The force and moment that the noise adds from `t` until the next sample.
    pub fn at(&self, t: f64) -> [f64; 3] {
        if self.start <= t && t < self.end { self.sample(self.number(t)) } else { [0.0; 3] }
    }

    /// The first instant after `t` at which the noise jumps, or infinity if there is none. Many samples may begin at the same
    /// instant, because their times round to the same double.
    pub fn next_break(&self, t: f64) -> f64 {
        if t < self.start {
            return self.time(0);
        }
        if t >= self.end {
            return f64::INFINITY;
        }
        let mut next = self.number(t);
        while next > 0 && self.time(next) > t {
            next -= 1;
        }
        while self.time(next) <= t {
            next += 1;
        }
        self.time(next).min(self.end)
    }
}

/// Refuses an `end` before the `start`. It may be infinite.
pub(super) fn require_end(field: impl Display, start: f64, end: f64) -> Result {
    require(start <= end, field, end, "must not be before the start")
}

/// Refuses more samples than a run can be cut into, and samples whose number since the noise's start is not exact.
pub fn require_countable(noises: &[Noise], from: f64, until: f64) -> Result {
    let count = |noise: &Noise| (until.min(noise.end) - from.max(noise.start)) * noise.rate;
    let needed: f64 = noises.iter().map(|noise| count(noise).max(0.0)).sum();
    let (what, advice) = ("the noise's samples (duration * rate_hz)", "lower rate_hz or shorten the noise");
    require_at_most(what, needed, MOST_SAMPLES, advice)?;
    let numbers = noises.iter().map(|noise| (until.min(noise.end) - noise.start) * noise.rate);
    let last = numbers.max_by(f64::total_cmp).unwrap_or(0.0);
    let what = "the number of the noise's last sample ((time - Noise.time) * rate_hz)";
    require_at_most(what, last, MOST_COUNTED, "let the noise begin later")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known answers of Philox's reference implementation. NumPy's `np.random.Philox` gives them too.
    #[test]
    fn philox_gives_the_published_answers() {
        assert_eq!(
            philox([0; 4], [0; 2]),
            [0x1655_4d9e_ca36_314c, 0xdb20_fe9d_672d_0fdc, 0xd7e7_72ce_e186_176b, 0x7e68_b68a_ec7b_a23b]
        );
        assert_eq!(
            philox([u64::MAX; 4], [u64::MAX; 2]),
            [0x87b0_92c3_013f_e90b, 0x438c_3c67_be8d_0224, 0x9cc7_d7c6_9cd7_77b6, 0xa09c_aebf_594f_0ba0]
        );
    }

    #[test]
    fn each_sample_holds_from_one_break_to_the_next() {
        let noise = Noise {
            std: [1.0; 3],
            acceleration: [0.0; 2],
            rate: 700.0,
            start: 0.1,
            end: 0.9,
            key: [3, 4],
            stream: 0,
        };
        assert_eq!(noise.at(0.0999), [0.0; 3]);
        assert_eq!(noise.at(0.9), [0.0; 3]);
        let next = |t: &f64| Some(noise.next_break(*t)).filter(|time| time.is_finite());
        let breaks: Vec<f64> = std::iter::successors(next(&0.0), next).collect();
        assert_eq!((breaks[0], *breaks.last().unwrap()), (0.1, 0.9));
        for (k, pair) in breaks.windows(2).enumerate() {
            let sample = noise.sample(k as u64);
            assert_eq!((noise.at(pair[0]), noise.at(pair[1].next_down())), (sample, sample), "{k}");
        }
        assert_eq!(breaks.len(), 561);
    }

    /// Ten samples begin at each instant that a double can represent.
    #[test]
    fn samples_that_begin_at_the_same_instant_are_skipped_together() {
        let spacing = 1e8_f64.next_up() - 1e8;
        let noise = Noise {
            std: [1.0; 3],
            acceleration: [0.0; 2],
            rate: 10.0 / spacing,
            start: 1e8,
            end: 1e8 + 64.0 * spacing,
            key: [3, 4],
            stream: 0,
        };
        let next = |t: &f64| Some(noise.next_break(*t)).filter(|time| time.is_finite());
        let breaks: Vec<f64> = std::iter::successors(next(&0.0), next).collect();
        assert_eq!(breaks, (0..=64).map(|k| 1e8 + spacing * f64::from(k)).collect::<Vec<_>>());
    }
}
