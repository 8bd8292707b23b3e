//! How a run is simulated.

use crate::formulation::chosen::Choice;
use crate::formulation::table::Formulation;
use crate::method::table::Method;
use crate::model::control::Fingers;
use crate::model::parameters::Stabilization;
use crate::number::simd::level::Level;
use crate::stepping::monitor::{STOPPABLE, Set};
use crate::stepping::record::Selection;
use crate::stepping::summary::{Summary, Wanted};

/// How long the steps are.
#[derive(Debug, Clone, PartialEq)]
pub enum Steps {
    /// Equal between breakpoints, and at most this long, s.
    Fixed(f64),
    /// As long as the error allows.
    Free {
        /// Largest error of a step, as a share of each state's size.
        tolerance: f64,
        /// Instants to record, s; `None` for the ends of steps.
        times: Option<Vec<f64>>,
    },
}

/// What a run with free steps may take at most where nobody says: seconds. Who needs more has a stiff scene and an explicit
/// method.
pub const MAX_STEPS: u64 = 10_000_000;

/// How it is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How long the steps are.
    pub steps: Steps,
    /// How time is stepped.
    pub method: Method,
    /// How the constraints are kept.
    pub formulation: Formulation,
    /// Gains of (19) and (20).
    pub stabilization: Stabilization,
    /// What is kept.
    pub record: Selection,
    /// Every how many steps it is kept; the last instant always is.
    pub every: u64,
    /// Violations that end the run.
    pub stop_on: Set,
    /// What is computed along the way.
    pub summaries: Wanted,
    /// Most attempted steps of a run whose steps are free.
    pub max_steps: u64,
    /// Into how many each step of a fixed grid is cut.
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
            stabilization: Stabilization { alpha: 1000.0, beta: 1000.0 },
            record: Selection { state: true, ..Selection::default() },
            every: 1,
            stop_on: STOPPABLE.iter().map(|&(_, violation)| violation).collect(),
            summaries: Wanted::default(),
            max_steps: MAX_STEPS,
            refine: 1,
            simd: Level::detect(),
        }
    }
}

impl Options {
    /// Whether the works of the ledger are carried.
    pub(crate) fn carries_ledger(&self) -> bool {
        self.record.energy || self.summaries.contains(Summary::EnergyClosure)
    }

    /// The equations of a scene with such fingers.
    pub(crate) fn choice(&self, fingers: Fingers) -> Choice {
        Choice { formulation: self.formulation, fingers, ledger: self.carries_ledger() }
    }
}
