//! The errors with which the core refuses input. They name the field, the value and the rule. A run that goes
//! wrong is not an error but a result with a status.

use std::fmt::Display;

use thiserror::Error;

/// Input that breaks a rule. It is found before any computation.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
#[allow(missing_docs)] // of fields that the messages explain
pub enum Error {
    /// A number breaks the rule of its field.
    #[error("{field} = {value:?}: {rule}")]
    Field { field: String, value: f64, rule: &'static str },
    /// A fingertip does not reach the object at the start.
    #[error(
        "the {finger} fingertip does not reach the object: gap {} mm at the start. It touches at {} {unit}: \
         a schedule with larger {what} keeps it in contact, smaller {what} separate it again{}. Otherwise widen the object or give a State",
        brief(*gap_mm), brief(*touches), if *driven { "" } else { "; initial = \"touching\" starts the run there" },
        what = if *unit == "mm" { "travels" } else { "angles" }
    )]
    Gap {
        finger: &'static str,
        gap_mm: f64,
        touches: f64,
        /// The unit of this coordinate: degrees, or mm of a jaw.
        unit: &'static str,
        /// Whether the fingers are driven, so that the schedule sets their initial angles as well.
        driven: bool,
    },
    /// No coordinate of a finger that is not the paper's brings the tip to the object.
    #[error(
        "the {finger} fingertip cannot touch the object, wherever its finger is. Change the object's size, hand.{finger} or the tip's radius"
    )]
    Untouched { finger: &'static str },
    /// No angle of the finger brings the tip to the face.
    #[error(
        "the {finger} fingertip cannot touch the object at any angle: the finger would have to \
         span {} mm from its root towards the face, and it spans at most {} mm. Change grasped.width, hand.{finger}.root_offset or the tip's radius",
        brief(*distance_mm),
        brief(*reach_mm)
    )]
    OutOfReach { finger: &'static str, distance_mm: f64, reach_mm: f64 },
    /// The initial state is off the constraints, and the scene or the formulation does not allow that.
    #[error(
        "initial state is inconsistent: {constraint} = {value:.3e} {unit}, allowed is {allowed:.1e}. \
         State.consistent() makes a consistent one; State(check=False) starts off the constraints"
    )]
    Inconsistent { constraint: &'static str, value: f64, unit: &'static str, allowed: f64 },
    /// A schedule that driven fingers cannot follow: it `steps` or `kinks`.
    #[error(
        "{name} {what} at t = {}: fingers=\"driven\" would need an infinite acceleration there. \
         minimum_jerk moves smoothly; fingers=\"pid\" may follow any schedule",
        seconds(*time)
    )]
    NotSmooth { name: &'static str, time: f64, what: &'static str },
    /// The initial state has driven fingers away from their schedule.
    #[error(
        "{place} = {value:?}: with fingers=\"driven\" must be what the schedule has at the start, {asked:?}"
    )]
    Unscheduled { place: String, value: f64, asked: f64 },
    /// An array of the wrong shape.
    #[error("{field}: {found}; {rule}")]
    Shape { field: String, found: String, rule: &'static str },
    /// The equations of a step that a run took could not be solved again for its derivatives.
    #[error(
        "sensitivities: the equations of the step before t = {} were not solved to round-off, the correction was \
         still {correction:.1e} of the states' sizes: a smaller dt or tolerance may help",
        seconds(*time)
    )]
    NoDerivative { time: f64, correction: f64 },
    /// A name that is not in a table.
    #[error("{field} = {name:?}: must be one of {allowed}")]
    Unknown { field: &'static str, name: String, allowed: String },
    /// A run of an ensemble is refused.
    #[error("run {run}: {error}")]
    Run { run: usize, error: Box<Error> },
    /// The processor lacks the instructions that the code is compiled for.
    #[error(
        "this processor lacks the instructions of {level:?}: softpinch needs AVX2 and FMA, as x86-64 processors since 2013 have them"
    )]
    Processor { level: &'static str },
    /// The operating system cannot start the threads.
    #[error("threads = {threads}: {reason}")]
    Threads { threads: usize, reason: String },
    /// The input asks for more work or memory than a machine can give.
    #[error("{what} would need {needed:.3e}, the limit is {limit:.1e}: {advice}")]
    TooLarge { what: &'static str, needed: f64, limit: f64, advice: &'static str },
}

/// What a function gives that may refuse its input.
pub type Result<T = (), E = Error> = std::result::Result<T, E>;

impl Error {
    /// The error of a number that breaks a rule.
    pub(crate) fn field(field: impl Display, value: f64, rule: &'static str) -> Self {
        Self::Field { field: field.to_string(), value, rule }
    }

    /// The error of an array of the wrong shape.
    pub fn shape(field: impl Display, found: impl Display, rule: &'static str) -> Self {
        Self::Shape { field: field.to_string(), found: found.to_string(), rule }
    }

    /// The error of what is not allowed.
    pub(crate) fn unknown(field: &'static str, name: impl Display, allowed: impl Display) -> Self {
        Self::Unknown { field, name: name.to_string(), allowed: allowed.to_string() }
    }

    /// The error of a run of an ensemble. One that names a run already stays.
    pub fn of_run(self, run: usize) -> Self {
        match self {
            Self::Run { .. } => self,
            error => Self::Run { run, error: Box::new(error) },
        }
    }
}

/// Refuses the number of a field if a rule does not hold. The name of the field is written only then.
pub(crate) fn require(holds: bool, field: impl Display, value: f64, rule: &'static str) -> Result {
    if holds { Ok(()) } else { Err(Error::field(field, value, rule)) }
}

/// Refuses a quantity that is larger than its limit. Errors call it `what` and give the advice.
pub fn require_at_most(what: &'static str, needed: f64, limit: f64, advice: &'static str) -> Result {
    if needed > limit { Err(Error::TooLarge { what, needed, limit, advice }) } else { Ok(()) }
}

/// Rounds a number to six digits for a message.
pub(crate) fn brief(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// A time with six significant digits, for a message.
pub(crate) fn seconds(t: f64) -> String {
    let t = brief(t);
    if t != 0.0 && t.abs() < 1e-4 { format!("{t:e} s") } else { format!("{t} s") }
}

/// Finds `name` in a table of names. The error lists the names of the table.
pub fn lookup<T: Copy>(field: &'static str, name: &str, table: &[(&'static str, T)]) -> Result<T> {
    table.iter().find(|(known, _)| *known == name).map(|&(_, value)| value).ok_or_else(|| {
        let known: Vec<_> = table.iter().map(|(known, _)| format!("{known:?}")).collect();
        Error::unknown(field, name, known.join(", "))
    })
}
