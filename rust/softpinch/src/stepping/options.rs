//! The options of a simulation.

use crate::formulation::scene_equations::Choice;
use crate::formulation::table::Formulation;
use crate::method::table::Method;
use crate::model::contact_modes::ContactModel;
use crate::model::control::Fingers;
use crate::model::parameters::Stabilization;
use crate::number::simd::level::Level;
use crate::stepping::monitor::{STOP_ON, Set};
use crate::stepping::record::Selection;
use crate::stepping::summary::{Summary, Wanted};

/// The length of the steps.
#[derive(Debug, Clone, PartialEq)]
pub enum Steps {
    /// Equal steps between breakpoints, at most this long, s.
    Fixed(f64),
    /// Steps that are as long as the error allows.
    Free {
        /// Largest error of a step, as a share of each state's magnitude.
        tolerance: f64,
        /// Instants to record, s; `None` to record the ends of steps.
        times: Option<Vec<f64>>,
    },
}

/// Default limit to the attempted steps of a run with free steps, which take seconds. A run that needs more
/// has a stiff scene and an explicit method.
pub const MAX_STEPS: u64 = 10_000_000;

/// The options of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The length of the steps.
    pub steps: Steps,
    /// The method that steps time.
    pub method: Method,
    /// The formulation of the constraints.
    pub formulation: Formulation,
    /// What the contacts can do.
    pub contact: ContactModel,
    /// Gains of (19) and (20).
    pub stabilization: Stabilization,
    /// The quantities to record.
    pub record: Selection,
    /// Number of steps between rows. The last instant is always recorded.
    pub every: u64,
    /// Violations that end the run.
    pub stop_on: Set,
    /// The summaries to compute.
    pub summaries: Wanted,
    /// Largest number of attempted steps in a run with free steps.
    pub max_steps: u64,
    /// Number of equal parts into which each step of a fixed grid is divided.
    pub refine: u32,
    /// Instructions to use.
    pub simd: Level,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            steps: Steps::Fixed(1e-4),
            method: Method::Rk4,
            formulation: Formulation::Csm,
            contact: ContactModel::Bilateral,
            stabilization: Stabilization { alpha: 1000.0, beta: 1000.0 },
            record: Selection { state: true, ..Selection::default() },
            every: 1,
            stop_on: STOP_ON.iter().map(|&(_, violation)| violation).collect(),
            summaries: Wanted::default(),
            max_steps: MAX_STEPS,
            refine: 1,
            simd: Level::detect(),
        }
    }
}

impl Options {
    /// Whether the state carries the works of the ledger.
    pub(crate) fn carries_ledger(&self) -> bool {
        self.record.energy || self.summaries.contains(Summary::EnergyClosure)
    }

    /// The choice of equations for a scene with these fingers.
    pub(crate) fn choice(&self, fingers: Fingers) -> Choice {
        let Self { formulation, contact, .. } = *self;
        Choice { formulation, contact, fingers, ledger: self.carries_ledger() }
    }
}
