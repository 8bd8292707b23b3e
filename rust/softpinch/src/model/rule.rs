//! The rules that numbers of a scene must keep.

use std::fmt::Display;

use crate::error::{Error, Result};
use crate::model::contact::law::LawKind;
use crate::model::{Counterface, MechanismKind, ShapeKind};

const KIND: &str = "must be the number of a kind";

/// A rule that a number must keep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // of members that `text` explains
pub enum Rule {
    Positive,
    NonNegative,
    Finite,
    /// Zero or above, or infinite, which means that there is no limit.
    NonNegativeOrInfinite,
    /// Above zero, or infinite, which means that there is no end.
    PositiveOrInfinite,
    /// The number of a kind of finger, and so on.
    Mechanism,
    Shape,
    Counterface,
    Law,
    /// 0, 1 or 2.
    Count,
    Tilt,
    Span,
    AboveOne,
    /// A relative error: above round-off and below one.
    Tolerance,
}

impl Rule {
    /// The rule in words, and its test.
    fn entry(self) -> (&'static str, fn(f64) -> bool) {
        match self {
            Self::Positive => ("must be finite and > 0", |x| x.is_finite() && x > 0.0),
            Self::NonNegative => ("must be finite and >= 0", |x| x.is_finite() && x >= 0.0),
            Self::Finite => ("must be finite", f64::is_finite),
            Self::NonNegativeOrInfinite => ("must be >= 0", |x| x >= 0.0),
            Self::PositiveOrInfinite => ("must be > 0", |x| x > 0.0),
            Self::Mechanism => (KIND, MechanismKind::has),
            Self::Shape => (KIND, ShapeKind::has),
            Self::Counterface => (KIND, Counterface::has),
            Self::Law => (KIND, LawKind::has),
            Self::Count => ("must be 0, 1 or 2", |x| (0.0..=2.0).contains(&x) && x.fract() == 0.0),
            Self::Tilt => ("must be between -pi/2 and pi/2", |x| x.abs() < std::f64::consts::FRAC_PI_2),
            Self::Span => ("must be > 0 and <= pi", |x| x > 0.0 && x <= std::f64::consts::PI),
            Self::AboveOne => ("must be finite and > 1", |x| x.is_finite() && x > 1.0),
            Self::Tolerance => ("must be >= 1e-14 and < 1", |x| (1e-14..1.0).contains(&x)),
        }
    }

    /// The rule in words.
    pub fn text(self) -> &'static str {
        self.entry().0
    }

    /// Whether `value` keeps the rule.
    pub fn holds(self, value: f64) -> bool {
        self.entry().1(value)
    }

    /// `value`, or an error that names the field. The name is written only for the error.
    #[inline]
    pub fn check(self, field: impl Display, value: f64) -> Result<f64> {
        if self.holds(value) { Ok(value) } else { Err(Error::field(field, value, self.text())) }
    }

    /// The same check of all values of a field.
    pub fn check_all(self, field: impl Display, values: &[f64]) -> Result {
        values.iter().try_for_each(|&value| self.check(&field, value).map(|_| ()))
    }
}
