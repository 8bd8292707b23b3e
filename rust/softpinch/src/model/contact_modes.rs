//! The modes of unilateral contact with Coulomb friction.
//!
//! | mode | held | multipliers | couple of the tip on object and finger |
//! |---|---|---|---|
//! | stick | C^H, C^N | lambda^H, lambda^N free | whole |
//! | slip, along sigma = sign v | C^H | lambda^N = -sigma mu lambda^H | whole |
//! | graze | C^H | 0 | a part psi, 0 <= psi <= 1 |
//! | free | nothing | 0 | none; the tilt in P is frozen at its value at the release |
//!
//! v = C^N is the velocity with which the object's face slips up over the tip. The couple of tip i is
//! -tau_i = -dP/d theta_pi, with the generalised force c_i = -tau_i (s_i on theta, 1 on theta_i).
//!
//! Between events the modes are constant, so they stand beside the inputs of a segment
//! ([`SegmentDrive`](crate::model::drive::SegmentDrive)). In the bilateral model both tips stick for ever.

use crate::names::named;
use crate::number::{Bits, Dual, Lanes, inlined, spread};

named! {
    /// What the contacts can do.
    #[derive(Default)]
    ContactModel;
    CONTACT_MODELS = {
        /// The tips never slip, and they pull where they have to: the paper's model.
        #[default]
        Bilateral = "bilateral",
        /// The tips push and never pull, and stick as far as friction allows.
        Unilateral = "unilateral",
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    Free,
    #[default]
    Stick,
    Slip(Slip),
    /// The tip touches without a force. A part of its couple keeps it from leaving.
    Graze,
}

/// The direction in which the object's face slips over the tip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slip {
    /// v > 0.
    Up,
    /// v < 0.
    Down,
}

impl Slip {
    /// The direction of the slip velocity `v`; `None` if its size is no more than `rest`.
    pub fn of(v: f64, rest: f64) -> Option<Self> {
        match v {
            v if v > rest => Some(Self::Up),
            v if v < -rest => Some(Self::Down),
            _ => None,
        }
    }

    /// sigma: 1 upwards, -1 downwards.
    pub fn sign(self) -> f64 {
        match self {
            Self::Up => 1.0,
            Self::Down => -1.0,
        }
    }
}

/// The contacts of a run at one instant, from which another run can go on: for each contact a code of its
/// mode, then for each contact the tilt that is frozen while its tip is free, rad.
///
/// | code | mode |
/// |---|---|
/// | 0 | free |
/// | 1 | stick |
/// | 2, -2 | slip, with v > 0 or v < 0 |
/// | 3 | graze, with v = 0 |
/// | 4, -4 | graze, with v > 0 or v < 0 |
pub type ContactRow = [f64; 4];

/// The codes of the modes in results, by their public names.
pub const CONTACT_MODES: [(&str, u8); 4] = [("FREE", 0), ("STICK", 1), ("SLIP", 2), ("GRAZE", 3)];

impl Mode {
    pub fn is_closed(self) -> bool {
        self != Self::Free
    }

    /// The direction in which the face slips; `None` if it does not slip.
    pub fn slip(self) -> Option<Slip> {
        if let Self::Slip(direction) = self { Some(direction) } else { None }
    }

    /// The code of the mode in results.
    pub fn code(self) -> u8 {
        match self {
            Self::Free => 0,
            Self::Stick => 1,
            Self::Slip(_) => 2,
            Self::Graze => 3,
        }
    }

    pub fn word(self) -> &'static str {
        ["is free", "sticks", "slips", "grazes"][usize::from(self.code())]
    }
}

/// The contacts in all lanes: for each finger the lanes in which it slips, grazes or is free. In all others it sticks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contacts<R> {
    pub up: [Bits; 2],
    pub down: [Bits; 2],
    pub graze: [Bits; 2],
    pub free: [Bits; 2],
    /// The frozen tilts of free tips, rad.
    pub frozen_tilt: [R; 2],
}

impl<R> Contacts<R> {
    inlined! {
        /// Lanes in which the tip of finger `i` slips.
        pub slip(&self, i: usize) -> Bits = self.up[i] | self.down[i];
        /// Lanes in which the tip of finger `i` does not feel its couple's reaction in full: it grazes or is free.
        pub unloaded(&self, i: usize) -> Bits = self.graze[i] | self.free[i];
        pub special(&self) -> Bits = (self.slip(0) | self.unloaded(0)) | (self.slip(1) | self.unloaded(1));
    }
}

impl<R: Lanes> Contacts<R> {
    #[inline(always)]
    pub fn sticking() -> Self {
        Self { up: [0; 2], down: [0; 2], graze: [0; 2], free: [0; 2], frozen_tilt: [R::zero(); 2] }
    }

    /// The same contacts for numbers of another kind.
    #[inline(always)]
    pub fn map<T>(&self, of: impl Fn(R) -> T) -> Contacts<T> {
        let Self { up, down, graze, free, frozen_tilt: [right, left] } = *self;
        Contacts { up, down, graze, free, frozen_tilt: [of(right), of(left)] }
    }

    /// The same contacts for vectors that hold these lanes several times.
    #[inline(always)]
    pub fn spread<X: Lanes>(&self) -> Contacts<Dual<X, 1>> {
        let each = |bits: [Bits; 2]| {
            bits.map(|bits| (0..X::WIDTH).fold(0, |all, lane| all | (bits >> (lane % R::WIDTH) & 1) << lane))
        };
        let frozen_tilt = self.frozen_tilt.map(|tilt| spread(tilt, |_| R::zero()));
        let Self { up, down, graze, free, .. } = *self;
        Contacts { up: each(up), down: each(down), graze: each(graze), free: each(free), frozen_tilt }
    }

    /// Sets the modes of one lane, and the frozen tilts of its free tips.
    pub fn set(&mut self, lane: usize, modes: [Mode; 2], frozen_tilt: [f64; 2]) {
        let bit = 1 << lane;
        for i in 0..2 {
            let sets = [&mut self.up[i], &mut self.down[i], &mut self.graze[i], &mut self.free[i]];
            let own = [Mode::Slip(Slip::Up), Mode::Slip(Slip::Down), Mode::Graze, Mode::Free];
            for (set, mode) in sets.into_iter().zip(own) {
                *set = *set & !bit | if modes[i] == mode { bit } else { 0 };
            }
            self.frozen_tilt[i].set(lane, frozen_tilt[i]);
        }
    }
}
