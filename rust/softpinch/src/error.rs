//! What the core refuses, with the field, the value and the rule. A run that goes wrong is no error but a
//! result with a status.

use thiserror::Error;

/// Input that breaks a rule, found before any computing.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A number breaks the rule of its field.
    #[error("{field} = {value:?}: {rule}")]
    Field {
        /// Dotted path of the field.
        field: String,
        /// What was given.
        value: f64,
        /// What is asked.
        rule: &'static str,
    },
    /// The fingers do not reach the object at the start.
    #[error(
        "the {finger} fingertip does not reach the object: gap {} mm at the start. It touches at {} degrees: \
         a schedule with larger angles keeps it there, with smaller ones it opens again{}. Else widen the object or give a State",
        brief(*gap_mm), brief(*touches), if *driven { "" } else { "; initial = \"touching\" starts there" }
    )]
    Gap {
        /// Which finger.
        finger: &'static str,
        /// Distance between tip and face, in millimetres.
        gap_mm: f64,
        /// The finger's angle at which the tip touches, in degrees.
        touches: f64,
        /// Whether the schedule turns the fingers, which starts them, too.
        driven: bool,
    },
    /// No finger angle brings the tip to the face.
    #[error(
        "the {finger} fingertip cannot touch the object at any angle: the face is {} mm from where \
         the fingertip starts, its reach is {} mm. Change grasped.width, hand.{finger}.root_offset or the tip's radius",
        brief(*distance_mm),
        brief(*reach_mm)
    )]
    OutOfReach {
        /// Which finger.
        finger: &'static str,
        /// What the finger would have to reach, in millimetres.
        distance_mm: f64,
        /// What it can reach, in millimetres.
        reach_mm: f64,
    },
    /// A start off the constraints where that was not allowed.
    #[error(
        "initial state is inconsistent: {constraint} = {value:.3e} {unit}, allowed is {allowed:.1e}. \
         State.consistent() makes a consistent one; State(check=False) starts off the constraints"
    )]
    Inconsistent {
        /// Which constraint.
        constraint: &'static str,
        /// Its residual.
        value: f64,
        /// Unit of the residual.
        unit: &'static str,
        /// Largest residual that is taken for round-off.
        allowed: f64,
    },
    /// A schedule that driven fingers cannot follow.
    #[error(
        "{name} {what} at t = {time:?} s: fingers=\"driven\" would need an infinite acceleration there. \
         minimum_jerk moves smoothly; fingers=\"pid\" may follow any schedule"
    )]
    NotSmooth {
        /// Path of the schedule.
        name: &'static str,
        /// When.
        time: f64,
        /// What it does then.
        what: &'static str,
    },
    /// A start that has driven fingers elsewhere than their schedule.
    #[error(
        "{place} = {value:?}: with fingers=\"driven\" must be what the schedule has at the start, {asked:?}"
    )]
    Unscheduled {
        /// Path of the number.
        place: String,
        /// What was given.
        value: f64,
        /// What the schedule has.
        asked: f64,
    },
    /// An array of the wrong shape.
    #[error("{field}: {found}; {rule}")]
    Shape {
        /// Dotted path of the field.
        field: String,
        /// What was given.
        found: String,
        /// What is asked.
        rule: &'static str,
    },
    /// A name that is not in a table.
    #[error("{field} = {name:?}: must be one of {allowed}")]
    Unknown {
        /// Dotted path of the field.
        field: &'static str,
        /// What was given.
        name: String,
        /// What there is.
        allowed: String,
    },
    /// A run of many is refused.
    #[error("run {run}: {error}")]
    Run {
        /// Which.
        run: usize,
        /// Why.
        error: Box<Error>,
    },
    /// A processor without the instructions that the code is compiled for.
    #[error(
        "this processor lacks the instructions of {level:?}: softpinch needs AVX2 and FMA, as x86-64 processors since 2013 have them"
    )]
    Processor {
        /// The level that was asked for.
        level: &'static str,
    },
    /// Threads that the operating system does not give.
    #[error("threads = {threads}: {reason}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What it says.
        reason: String,
    },
    /// More work or memory than a machine can give.
    #[error("{what} would need {needed:.3e}, the limit is {limit:.1e}: {advice}")]
    TooLarge {
        /// What grows too large.
        what: &'static str,
        /// How large it would be.
        needed: f64,
        /// How large it may be.
        limit: f64,
        /// What to change.
        advice: &'static str,
    },
}

/// A number to six digits, for reading.
fn brief(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// Finds `name` in a table of names, or says what there is.
pub fn lookup<T: Copy>(field: &'static str, name: &str, table: &[(&'static str, T)]) -> Result<T, Error> {
    table.iter().find(|(known, _)| *known == name).map(|&(_, value)| value).ok_or_else(|| Error::Unknown {
        field,
        name: name.to_owned(),
        allowed: table.iter().map(|(known, _)| format!("{known:?}")).collect::<Vec<_>>().join(", "),
    })
}
