//! The table of the formulations.

/// The formulations of the constraints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formulation {
    /// The constraint stabilisation method (19)-(24).
    Csm,
    /// Independent velocities (Maggi's equations): no gains, no drift.
    Nullspace,
    /// Accelerations without stabilisation. After each step the state is put back on the constraints.
    Projected,
}

/// The formulations by their public names.
pub const FORMULATIONS: [(&str, Formulation); 3] =
    [("csm", Formulation::Csm), ("nullspace", Formulation::Nullspace), ("projected", Formulation::Projected)];
