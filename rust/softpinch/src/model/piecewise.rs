//! Piecewise polynomials: schedules and forces.

use crate::error::{Error, Result, require};
use crate::model::drive::COEFFICIENTS;
use crate::model::{MAX_DEGREE, Rule};

/// Jumps below this share of a polynomial's terms count as round-off.
const SMOOTH: f64 = 1e-9;
/// `C` channels, each a polynomial of degree five or less on every piece. Row 0 holds before the first break
/// and has only a constant. Row k + 1 holds from break k on, in ascending powers of the time since that break.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PiecewisePolynomial<const C: usize> {
    breaks: Vec<f64>,
    rows: Vec<[[f64; COEFFICIENTS]; C]>,
}

impl<const C: usize> PiecewisePolynomial<C> {
    /// Checks breaks and rows. Errors use `name` for the polynomial.
    pub fn new(name: &str, breaks: Vec<f64>, rows: Vec<[[f64; COEFFICIENTS]; C]>) -> Result<Self> {
        for (k, &time) in breaks.iter().enumerate() {
            let field = format_args!("{name}.times[{k}]");
            Rule::Finite.check(field, time)?;
            require(k == 0 || time > breaks[k - 1], field, time, "must be greater than the time before it")?;
        }
        if rows.len() != breaks.len() + 1 {
            let found = format!("{} rows for {} breaks", rows.len(), breaks.len());
            let (field, rule) =
                (format_args!("{name}.coefficients"), "there must be one row more than breaks");
            return Err(Error::shape(field, found, rule));
        }
        for (k, value) in rows.iter().flatten().flatten().enumerate() {
            Rule::Finite.check(format_args!("{name}.coefficients[{}]", k / (C * COEFFICIENTS)), *value)?;
        }
        Ok(Self { breaks, rows })
    }

    /// Values that are constant at all times.
    pub fn constant(values: [f64; C]) -> Self {
        let row = values.map(|value| std::array::from_fn(|k| if k == 0 { value } else { 0.0 }));
        Self { breaks: Vec::new(), rows: vec![row] }
    }

    /// Steps to `values[k]` at `times[k]`, with the value `before` until the first step.
    pub fn steps(name: &str, before: [f64; C], times: &[f64], values: &[[f64; C]]) -> Result<Self> {
        let rows = std::iter::once(&before).chain(values).map(|row| Self::constant(*row).rows[0]).collect();
        Self::new(name, times.to_vec(), rows)
    }

    /// Refuses a jump or a kink between `from` and `until`: a finger that follows the polynomials exactly
    /// cannot make one. Round-off of the terms of the pieces is allowed.
    pub(super) fn require_smooth(&self, name: &'static str, from: f64, until: f64) -> Result {
        let mut origin = None;
        for (k, &time) in self.breaks.iter().enumerate() {
            let length = origin.map_or(0.0, |origin: f64| time - origin);
            if from < time && time < until {
                for (before, after) in self.rows[k].iter().zip(&self.rows[k + 1]) {
                    let (mut place, mut pace, mut power) = ([0.0; 2], [0.0; 2], 1.0);
                    for (n, &c) in before.iter().enumerate() {
                        place = [c.mul_add(power, place[0]), (c * power).abs() + place[1]];
                        if let Some(&next) = before.get(n + 1) {
                            let slope = (n + 1) as f64 * next * power;
                            pace = [pace[0] + slope, pace[1] + slope.abs()];
                        }
                        power *= length;
                    }
                    let jumps = |[value, size]: [f64; 2], other: f64| {
                        (value - other).abs() > SMOOTH * (size + other.abs())
                    };
                    let what = match (jumps(place, after[0]), jumps(pace, after[1])) {
                        (true, _) => "steps",
                        (false, true) => "kinks",
                        _ => continue,
                    };
                    return Err(Error::NotSmooth { name, time, what });
                }
            }
            origin = Some(time);
        }
        Ok(())
    }

    /// The first break after `t`, or infinity if there is none.
    pub(super) fn next_break(&self, t: f64) -> f64 {
        let next = self.breaks.partition_point(|&time| time <= t);
        self.breaks.get(next).copied().unwrap_or(f64::INFINITY)
    }

    /// The values at time `t`, and their rates.
    pub(super) fn value_and_rate(&self, t: f64) -> [[f64; C]; 2] {
        let piece = self.breaks.partition_point(|&time| time <= t);
        let tau = piece.checked_sub(1).and_then(|k| self.breaks.get(k)).map_or(0.0, |start| t - start);
        let (mut values, mut rates) = ([0.0_f64; C], [0.0_f64; C]);
        for (channel, row) in self.rows.get(piece).into_iter().flatten().enumerate() {
            // Outside of vector code a fused multiply-add is a call of a function.
            for coefficient in row.iter().rev() {
                rates[channel] = rates[channel] * tau + values[channel];
                values[channel] = values[channel] * tau + coefficient;
            }
        }
        [values, rates]
    }

    /// The polynomials that hold from `anchor` on, in powers of the time since `anchor`.
    pub(super) fn shifted(&self, anchor: f64) -> [[f64; COEFFICIENTS]; C] {
        let piece = self.breaks.partition_point(|&time| time <= anchor);
        let row = self.rows.get(piece).copied().unwrap_or([[0.0; COEFFICIENTS]; C]);
        match piece.checked_sub(1).and_then(|k| self.breaks.get(k)) {
            Some(&origin) if origin != anchor => row.map(|c| taylor_shift(c, anchor - origin)),
            _ => row,
        }
    }
}

/// The coefficients of the same polynomial about an origin that is later by `by` (repeated synthetic division).
fn taylor_shift(mut c: [f64; COEFFICIENTS], by: f64) -> [f64; COEFFICIENTS] {
    for low in 0..MAX_DEGREE {
        for k in (low..MAX_DEGREE).rev() {
            if c[k + 1] != 0.0 {
                c[k] = c[k + 1].mul_add(by, c[k]);
            }
        }
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_shifted_polynomial_has_the_same_values(
            c in prop::array::uniform6(-1.0..1.0_f64), by in -2.0..2.0_f64, t in -2.0..2.0_f64,
        ) {
            let value = |c: &[f64; 6], t: f64| c.iter().rev().fold(0.0, |sum, k| sum * t + k);
            let (a, b) = (value(&taylor_shift(c, by), t), value(&c, t + by));
            prop_assert!((a - b).abs() <= 1e-11, "{a} {b}");
        }
    }
}
