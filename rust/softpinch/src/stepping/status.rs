//! The ways in which a run ends.

use crate::names::named;
use crate::stepping::monitor::Violation;

named! {
    /// How a run ended.
    Status;
    /// The statuses by their public names.
    STATUSES = {
        /// The run reached its end.
        Completed = "completed",
        /// A tip left the object.
        Separated = "separated",
        /// A tip was pressed flat.
        Crushed = "crushed",
        /// A tip was tilted by 90 degrees.
        Folded = "folded",
        /// A tip pulled, and the run was to end there.
        Pulling = "pulling",
        /// A tip needed more friction than there is, and the run was to end there.
        Slipping = "slipping",
        /// A contact reached the rim of its tip, and the run was to end there.
        Rim = "rim",
        /// A contact left its face, and the run was to end there.
        OffFace = "off_face",
        /// A tip opened, and the run was to end there.
        Opened = "opened",
        /// Unilateral contact: a contact left its face, or the object is beside neither tip.
        Lost = "lost",
        /// Unilateral contact: the modes changed too often within one step.
        Chattering = "chattering",
        /// Unilateral contact: no modes were admissible.
        NoMode = "no_mode",
        /// A number overflowed.
        NotFinite = "not_finite",
        /// The equations of an implicit step were not solved.
        NewtonFailed = "newton_failed",
        /// No step was short enough for the allowed error.
        StepTooSmall = "step_too_small",
        /// The run used up its steps.
        TooManySteps = "too_many_steps",
        /// The caller stopped the run.
        Interrupted = "interrupted",
        /// The steps were beyond the stability limit of the method.
        Unstable = "unstable",
    }
}

impl Status {
    /// The status of a run that ends because of a violation. The violations follow `Completed` in their own order.
    pub(crate) fn of(violation: Violation) -> Self {
        STATUSES[1 + violation as usize].1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stepping::monitor::VIOLATIONS;

    #[test]
    fn a_run_that_a_violation_ends_has_its_name() {
        for (name, violation) in VIOLATIONS {
            assert_eq!(Status::of(violation).name(), name);
        }
    }
}
