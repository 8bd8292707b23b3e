//! The energies (5) and (16), and the energy ledger. The elastic energy of a tip is its law's (`contact/law.rs`).

use crate::number::{Lanes, Real};

/// The energies of a state, in joules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Energies<R = f64> {
    /// Kinetic energy p M p / 2.
    pub kinetic: R,
    /// Elastic energy P (5).
    pub elastic: R,
    /// Potential energy of gravity P_g (16).
    pub gravity: R,
}

impl<R: Real> Energies<R> {
    #[inline(always)]
    pub fn total(&self) -> R {
        (self.kinetic + self.elastic) + self.gravity
    }
}

impl<R: Lanes> Energies<R> {
    pub fn lane(&self, lane: usize) -> Energies {
        let Self { kinetic, elastic, gravity } = *self;
        Energies { kinetic: kinetic.lane(lane), elastic: elastic.lane(lane), gravity: gravity.lane(lane) }
    }
}

/// The closure error of the energy ledger: (energy now - energy at the start) - (works - losses). Bilateral
/// contact has the first four works. That of the hand's motion is the last one, if the hand moves.
#[inline(always)]
pub fn closure<R: Real>(start: &Energies<R>, now: &Energies<R>, works: &[R]) -> R {
    let gain = now.total() - start.total();
    let &[control, external, viscous, constraint, ref others @ ..] = works else { return gain };
    let work = ((control + external) + constraint) - viscous;
    match *others {
        [motion] => gain - (work + motion),
        [friction, impact, relaxation] => gain - (work + (relaxation - (friction + impact))),
        [friction, impact, relaxation, motion] => {
            gain - ((work + motion) + (relaxation - (friction + impact)))
        }
        _ => gain - work,
    }
}

pub const WORKS: usize = 8;
/// Number of works in unilateral contact, without that of the hand's motion.
pub const CONTACT_WORKS: usize = 7;
/// Number of works in bilateral contact, which neither slides nor opens.
pub const BILATERAL_WORKS: usize = 4;

/// The places of the works in a state's ledger and in a row. Each work is a quadrature of its own, or a sum over events.
pub mod work {
    pub const CONTROL: usize = 0;
    pub const EXTERNAL: usize = 1;
    /// Work of the constraints: lambda^T Phi p, and the energy that a correction of the state adds.
    pub const CONSTRAINT: usize = 3;
    #[cfg(test)]
    pub const FRICTION: usize = 4;
    pub const IMPACT: usize = 5;
    /// Energy that free tips gain while their tilt is frozen.
    pub const RELAXATION: usize = 6;
    /// Work of the forces of the hand's motion, gravity included.
    pub const MOTION: usize = 7;
}
