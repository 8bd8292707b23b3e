//! An instant of a run, as step loops hand it on.

use crate::model::energy::WORKS;
use crate::model::motion::{Linearized, Motion};
use crate::stepping::record::Instant;

/// An instant of a run that was watched and found to be finite.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// The instant.
    pub instant: Instant,
    /// The works of the ledger; zeros if they are not carried.
    pub works: [f64; WORKS],
    /// The point of the Jacobian that the next step uses, for methods that keep one.
    pub linearized: Option<Linearized>,
    /// True if the controller has not yet sampled at this instant.
    pub before_sample: bool,
}

impl Sample {
    /// Whether all numbers of the instant are finite.
    pub fn is_finite(&self) -> bool {
        let Instant { motion: Motion { q, p, memory }, multipliers, residuals, torque, .. } = &self.instant;
        [&q.row()[..], &p.row(), memory, multipliers, residuals, torque, &self.works]
            .into_iter()
            .flatten()
            .all(|number| number.is_finite())
    }
}
