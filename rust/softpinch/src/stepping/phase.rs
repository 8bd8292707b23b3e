//! The phases of the runs in the lanes of a step loop.

use crate::number::{Bits, inlined};

/// What the run in a lane does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// There is no run, and there are no more.
    Idle,
    /// Its run has just ended, so that another one is loaded.
    Ended,
    /// It starts a segment: the modes of its contacts are chosen.
    Start,
    /// Its discrete controller measures, under the torques before the sample.
    Sample,
    /// Impulses act, at the instant that is watched first.
    Impulse,
    /// It goes on from the state after impulses, whose instant has been watched already.
    Struck,
    /// In the adaptive loop: its step ends at an event that was located.
    Approach,
    /// In the adaptive loop: the event happens. In the loop of equal steps events happen after the step, and its lanes are
    /// a set that lasts for one evaluation.
    Event,
    Step,
    End,
}

const PHASES: usize = Phase::End as usize + 1;

/// The phases of all lanes: for each phase the set of its lanes, as vector code needs it. Every lane is in just one.
pub struct Phases([Bits; PHASES]);

impl Phases {
    pub fn idle() -> Self {
        let mut lanes = [0; PHASES];
        lanes[Phase::Idle as usize] = Bits::MAX;
        Self(lanes)
    }

    inlined! {
        pub at(&self, phase: Phase) -> Bits = self.0[phase as usize];
        pub active(&self) -> Bits = !(self.at(Phase::Idle) | self.at(Phase::Ended));
    }

    pub fn set(&mut self, lanes: Bits, phase: Phase) {
        for of_phase in &mut self.0 {
            *of_phase &= !lanes;
        }
        self.0[phase as usize] |= lanes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_lane_is_in_exactly_one_phase() {
        let mut phases = Phases::idle();
        phases.set(0b0111, Phase::Start);
        phases.set(0b0011, Phase::Step);
        phases.set(0b0001, Phase::End);
        assert_eq!(phases.at(Phase::Start), 0b0100);
        assert_eq!(phases.at(Phase::Step), 0b0010);
        assert_eq!(phases.at(Phase::End), 0b0001);
        assert_eq!(phases.active(), 0b0111);
        assert_eq!(phases.0.iter().map(|lanes| lanes.count_ones()).sum::<u32>(), Bits::BITS);
    }
}
