//! The ways in which a run ends.

use crate::stepping::monitor::Violation;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// The run reached its end.
    Completed,
    /// A tip left the object.
    Separated,
    /// A tip was pressed flat.
    Crushed,
    /// A tip was tilted by 90 degrees.
    Folded,
    /// A tip pulled, and the run was to end there.
    Pulling,
    /// A tip needed more friction than there is, and the run was to end there.
    Slipping,
    /// A contact reached the rim of its tip, and the run was to end there.
    Rim,
    /// A contact left its face, and the run was to end there.
    OffFace,
    /// A tip opened, and the run was to end there.
    Opened,
    /// Unilateral contact: a contact left its face, or the object is beside neither tip.
    Lost,
    /// Unilateral contact: the modes changed too often within one step.
    Chattering,
    /// Unilateral contact: no modes were admissible.
    NoMode,
    /// A number overflowed.
    NotFinite,
    /// The steps were beyond the stability limit of the method.
    Unstable,
    /// The equations of an implicit step were not solved.
    NewtonFailed,
    /// No step was short enough for the allowed error.
    StepTooSmall,
    /// The run used up its steps.
    TooManySteps,
    /// The caller stopped the run.
    Interrupted,
}

impl Status {
    /// The status of a run that ends because of a violation.
    pub(crate) fn of(violation: Violation) -> Self {
        match violation {
            Violation::Separated => Self::Separated,
            Violation::Crushed => Self::Crushed,
            Violation::Folded => Self::Folded,
            Violation::Pulling => Self::Pulling,
            Violation::Slipping => Self::Slipping,
            Violation::Rim => Self::Rim,
            Violation::OffFace => Self::OffFace,
            Violation::Opened => Self::Opened,
        }
    }

    /// The public name of the status.
    #[must_use]
    pub fn name(self) -> &'static str {
        STATUSES.iter().find(|(_, status)| *status == self).map_or("", |&(name, _)| name)
    }
}

/// The statuses by their public names.
pub const STATUSES: [(&str, Status); 18] = [
    ("completed", Status::Completed),
    ("separated", Status::Separated),
    ("crushed", Status::Crushed),
    ("folded", Status::Folded),
    ("pulling", Status::Pulling),
    ("slipping", Status::Slipping),
    ("rim", Status::Rim),
    ("off_face", Status::OffFace),
    ("opened", Status::Opened),
    ("lost", Status::Lost),
    ("chattering", Status::Chattering),
    ("no_mode", Status::NoMode),
    ("not_finite", Status::NotFinite),
    ("newton_failed", Status::NewtonFailed),
    ("step_too_small", Status::StepTooSmall),
    ("too_many_steps", Status::TooManySteps),
    ("interrupted", Status::Interrupted),
    ("unstable", Status::Unstable),
];
