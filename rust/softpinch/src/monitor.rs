//! Where the model stops holding: each way is watched at the ends of steps, with the first time it happens.

use crate::geometry::index::{D_N, FINGER, THETA};
use crate::parameters::{Parameters, SIDES};
use crate::real::signed;

/// A way in which the model stops holding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Violation {
    /// d_n < -1e-9 a: the tip has left the object.
    Separated,
    /// d_n >= a: the tip is pressed flat.
    Crushed,
    /// |theta_p| >= 90 degrees: the tip's energy (5) has a pole there.
    Folded,
    /// lambda^H < 0: the bilateral constraint pulls.
    Pulling,
    /// |lambda^N| > mu lambda^H, where a scene gives mu.
    Slipping,
    /// d_n > a (1 - sin |theta_p|): the contact reaches the hemisphere's rim, and (4) is no longer (3).
    Rim,
}

/// The violations by their public names.
pub const VIOLATIONS: [(&str, Violation); 6] = [
    ("separated", Violation::Separated),
    ("crushed", Violation::Crushed),
    ("folded", Violation::Folded),
    ("pulling", Violation::Pulling),
    ("slipping", Violation::Slipping),
    ("rim", Violation::Rim),
];

/// Those that a run can be told to stop on: they are read off q alone.
pub const STOPPABLE: [(&str, Violation); 3] = [VIOLATIONS[0], VIOLATIONS[1], VIOLATIONS[2]];

/// Below this share of the radius a negative compression is round-off, not separation.
const SEPARATION: f64 = 1e-9;

/// A set of violations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Set(u8);

impl Set {
    /// Whether `violation` is in the set.
    #[inline(always)]
    #[must_use]
    pub fn contains(self, violation: Violation) -> bool {
        self.0 & (1 << violation as u8) != 0
    }

    /// Whether it has none.
    #[inline(always)]
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// What both sets have.
    #[inline(always)]
    #[must_use]
    pub fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// The first of them in the order of [`VIOLATIONS`].
    #[must_use]
    pub fn first(self) -> Option<Violation> {
        VIOLATIONS.iter().map(|&(_, violation)| violation).find(|&violation| self.contains(violation))
    }

    #[inline(always)]
    fn note(&mut self, violation: Violation, found: bool) {
        self.0 |= u8::from(found) << violation as u8;
    }
}

impl FromIterator<Violation> for Set {
    fn from_iter<I: IntoIterator<Item = Violation>>(violations: I) -> Self {
        let mut set = Self::default();
        for violation in violations {
            set.note(violation, true);
        }
        set
    }
}

/// Watches one run.
#[derive(Debug, Clone)]
pub struct Monitor {
    radius: [f64; 2],
    /// mu, where the scene gives one.
    friction: Option<f64>,
    noted: Set,
    first_times: [f64; VIOLATIONS.len()],
}

impl Monitor {
    /// For a scene.
    #[must_use]
    pub fn new(parameters: &Parameters) -> Self {
        let friction = parameters.surroundings.friction;
        Self {
            radius: [parameters.tips[0].radius, parameters.tips[1].radius],
            friction: friction.is_finite().then_some(friction),
            noted: Set::default(),
            first_times: [f64::NAN; VIOLATIONS.len()],
        }
    }

    /// What is violated at this state, noted with its time where it is the first.
    #[inline(always)]
    pub fn observe(&mut self, t: f64, q: &[f64; 9], sin_tilt: &[f64; 2], multipliers: &[f64; 4]) -> Set {
        let mut found = Set::default();
        for i in 0..2 {
            let (a, d_n) = (self.radius[i], q[D_N + i]);
            let tilt = q[FINGER + i] + signed(i, q[THETA]);
            let (press, hold) = (multipliers[i], multipliers[2 + i]);
            found.note(Violation::Separated, d_n < -SEPARATION * a);
            found.note(Violation::Crushed, d_n >= a);
            found.note(Violation::Folded, tilt.abs() >= std::f64::consts::FRAC_PI_2);
            found.note(Violation::Pulling, press < 0.0);
            found.note(Violation::Rim, d_n > a * (1.0 - sin_tilt[i].abs()));
            if let Some(friction) = self.friction {
                found.note(Violation::Slipping, hold.abs() > friction * press);
            }
        }
        if found.0 & !self.noted.0 != 0 {
            self.note_first(t, found);
        }
        found
    }

    #[cold]
    #[inline(never)]
    fn note_first(&mut self, t: f64, found: Set) {
        for (first, (_, violation)) in self.first_times.iter_mut().zip(VIOLATIONS) {
            if found.contains(violation) && first.is_nan() {
                *first = t;
            }
        }
        self.noted.0 |= found.0;
    }

    /// What has been seen, with its first time.
    #[must_use]
    pub fn violations(&self) -> Vec<(&'static str, f64)> {
        let times = self.first_times;
        VIOLATIONS.iter().zip(times).filter(|(_, t)| !t.is_nan()).map(|((name, _), t)| (*name, t)).collect()
    }

    /// Why a run ends on `violation` at `q`, with the numbers.
    #[must_use]
    pub fn explain(&self, violation: Violation, t: f64, q: &[f64; 9]) -> String {
        let side = |broken: &dyn Fn(usize) -> bool| usize::from(!broken(0));
        match violation {
            Violation::Separated => {
                let i = side(&|i| q[D_N + i] < -SEPARATION * self.radius[i]);
                format!(
                    "the {} fingertip left the object at t = {t} s (d_n = {:.3e} m); a firmer grasp or a smaller \
                     disturbance would keep it",
                    SIDES[i],
                    q[D_N + i]
                )
            }
            Violation::Crushed => {
                let i = side(&|i| q[D_N + i] >= self.radius[i]);
                format!(
                    "the {} fingertip was crushed at t = {t} s (d_n = {:.3e} m, its radius is {:.3e} m)",
                    SIDES[i],
                    q[D_N + i],
                    self.radius[i]
                )
            }
            _ => {
                let tilt = |i: usize| (q[FINGER + i] + signed(i, q[THETA])).to_degrees();
                let i = side(&|i| tilt(i).abs() >= 90.0);
                format!(
                    "the {} fingertip folded at t = {t} s (theta_p = {:.2} degrees, the limit is 90)",
                    SIDES[i],
                    tilt(i)
                )
            }
        }
    }
}
