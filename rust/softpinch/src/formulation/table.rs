//! The formulations there are.

/// The formulations there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formulation {
    /// The constraint stabilisation method (19)-(24).
    Csm,
    /// Independent velocities (Maggi's equations): no gains, no drift.
    Nullspace,
    /// Accelerations on the constraints, and after each step the state put back on them.
    Projected,
}

/// The formulations by their public names.
pub const FORMULATIONS: [(&str, Formulation); 3] =
    [("csm", Formulation::Csm), ("nullspace", Formulation::Nullspace), ("projected", Formulation::Projected)];
