//! The table of the formulations.

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
