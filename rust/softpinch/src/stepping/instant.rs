//! One instant of a run as step loops hand it on; reading it from one lane, and checking that all numbers are finite.

use crate::formulation::{Evaluation, SceneEquations, Size, States};
use crate::model::{BILATERAL_WORKS, ContactRow, Contacts, Energies, Linearized, Motion, State, WORKS, work};
use crate::number::{Bits, Lanes, Real};

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    pub t: f64,
    /// Start of its segment and steps since then, so that a resumed run gives the same bits.
    pub grid: (f64, u64),
    pub motion: Motion<f64>,
    pub multipliers: [f64; 4],
    pub residuals: [f64; 4],
    pub torque: [f64; 2],
    pub contact: Option<ContactRow>,
    /// The works of the ledger; zeros if they are not carried.
    pub works: [f64; WORKS],
    /// The distance of slips since the start, m; zero if it is not carried.
    pub slipped: f64,
    /// The point of the Jacobian that the next step uses, for methods that keep one.
    pub linearized: Option<Linearized>,
    /// True if the controller has not yet sampled at this instant.
    pub before_sample: bool,
}

impl Instant {
    /// The start of a run, before anything is computed.
    pub fn start(state: &State) -> Self {
        Self {
            t: state.time,
            grid: (state.time, 0),
            motion: state.motion,
            multipliers: [f64::NAN; 4],
            residuals: [f64::NAN; 4],
            torque: [f64::NAN; 2],
            contact: state.contact,
            works: [0.0; WORKS],
            slipped: 0.0,
            linearized: None,
            before_sample: false,
        }
    }

    pub fn is_finite(&self) -> bool {
        let Self { motion, multipliers, residuals, torque, works, .. } = self;
        let all = [&motion.row()[..], multipliers, residuals, torque, works];
        all.into_iter().flatten().all(|number| number.is_finite())
    }
}

/// An instant of the run in a lane, as evaluated at the state `y`.
#[inline(always)]
pub fn watched<R: Lanes>(
    size: Size,
    (lane, contact): (usize, Option<ContactRow>),
    now: &Evaluation<R>,
    y: &States<R>,
    t: f64,
    grid: (f64, u64),
) -> Instant {
    let Evaluation { motion, multipliers, residuals, torque, .. } = now;
    Instant {
        t,
        grid,
        motion: motion.lane(lane),
        multipliers: column(multipliers, lane),
        residuals: column(residuals, lane),
        torque: column(torque, lane),
        contact,
        works: column(&works(size, y), lane),
        slipped: size.slipped(y).lane(lane),
        linearized: None,
        before_sample: false,
    }
}

pub(super) fn energies<R: Lanes>(
    system: &SceneEquations<R>,
    Instant { motion, contact, .. }: &Instant,
) -> Energies {
    let motion = Motion::constant(motion);
    let mut contacts = Contacts::sticking();
    if let Some([right, left, right_tilt, left_tilt]) = contact {
        contacts.free = [u8::from(*right == 0.0), u8::from(*left == 0.0)];
        contacts.frozen_tilt = [R::constant(*right_tilt), R::constant(*left_tilt)];
    }
    system.energies(&contacts, &motion).lane(0)
}

/// The works of the ledger in a state; zeros if the state does not carry them.
#[inline(always)]
pub fn works<R: Real>(size: Size, y: &States<R>) -> [R; WORKS] {
    let mut works = [R::zero(); WORKS];
    let carried = &y[size.states..][..size.works];
    works[..carried.len()].copy_from_slice(carried);
    if carried.len() == BILATERAL_WORKS + 1 {
        works.swap(BILATERAL_WORKS, work::MOTION);
    }
    works
}

/// The lanes in which all numbers of an instant are finite. The `closure` of the ledger is finite only if
/// each energy and each work is.
///
/// If a sum of products is finite, so are its factors. If it is not, a product of finite factors may have
/// overflowed, so each number is checked alone.
#[inline(always)]
pub fn all_finite<R: Lanes>(now: &Evaluation<R>, closure: R) -> Bits {
    let Evaluation { motion: Motion { q, p, memory, .. }, multipliers, residuals, torque, .. } = now;
    let (mut first, mut second) = (closure, torque[0] * torque[1]);
    let (q, p) = (q.row(), p.row());
    for k in 0..9 {
        first = q[k].mul_add(p[k], first);
    }
    for k in 0..4 {
        second = multipliers[k].mul_add(residuals[k], second);
    }
    let finite = (memory[0].mul_add(memory[1], first + second) * R::zero()).is_zero();
    if finite & R::ALL == R::ALL { finite } else { each_finite(now, closure) }
}

/// [`all_finite`] with a check of each number: zero times a number is zero if the number is finite, and NaN
/// otherwise. There is no threshold, so scaling changes nothing.
#[cold]
#[inline(never)]
fn each_finite<R: Lanes>(now: &Evaluation<R>, closure: R) -> Bits {
    let Evaluation { motion: Motion { q, p, memory, .. }, multipliers, residuals, torque, .. } = now;
    let mut bits = 0;
    for lane in 0..R::WIDTH {
        let mut sum = closure.lane(lane) * 0.0;
        for values in [&q.row()[..], &p.row(), memory, multipliers, residuals, torque] {
            sum += values.iter().map(|value| value.lane(lane) * 0.0).sum::<f64>();
        }
        bits |= Bits::from(sum == 0.0) << lane;
    }
    bits
}

#[inline(always)]
pub fn column<R: Lanes, const N: usize>(y: &[R; N], lane: usize) -> [f64; N] {
    let mut column = [0.0; N];
    for n in 0..N {
        column[n] = y[n].lane(lane);
    }
    column
}

/// Sets the motion of one lane. Rare stores, so that the code exists once.
#[inline(never)]
pub fn put_motion<R: Lanes>(motion: &mut Motion<R>, lane: usize, own: &Motion<f64>) {
    let mut row = motion.row();
    put(&mut row, lane, &own.row());
    *motion = row.into();
}

#[inline(always)]
pub fn put<R: Lanes, const N: usize>(y: &mut [R; N], lane: usize, column: &[f64; N]) {
    for n in 0..N {
        y[n].set(lane, column[n]);
    }
}
