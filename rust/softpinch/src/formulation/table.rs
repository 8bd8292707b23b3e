//! The table of the formulations.

use crate::model::Stabilization;
use crate::names::named;

named! {
    /// The formulations of the constraints.
    Formulation;
    FORMULATIONS = {
        /// The constraint stabilisation method (19)-(24).
        Csm = "csm",
        /// Independent velocities (Maggi's equations): no gains, no drift.
        Nullspace = "nullspace",
        /// Accelerations without stabilisation. After each step the state is put back on the constraints.
        Projected = "projected",
    }
}

impl Formulation {
    /// The gains of (19) and (20) that it uses.
    pub fn gains(self, given: &Stabilization) -> Stabilization {
        match self {
            Self::Csm => *given,
            Self::Nullspace | Self::Projected => Stabilization { alpha: 0.0, beta: 0.0 },
        }
    }
}
