//! What an adaptive step may be: the error that is allowed of each state, and the lengths that the clock resolves.

use crate::formulation::equations::{ROOM, States};
use crate::formulation::system::{Moved, Size, System};
use crate::method::step_control::StepControl;
use crate::method::traits::{Allowed, largest};
use crate::model::drive::{Drive, SegmentDrive};
use crate::number::lanes::{Bits, Lanes, each};

/// A state's size is at least this share of its usual one, a rate's of what viscosity leaves of that: from rest nothing else
/// is known.
const LEAST_SIZE: f64 = 1e-3;
/// No error below this share of a state's usual size is asked for.
const ROUND_OFF: f64 = 100.0 * f64::EPSILON;
/// The shortest step, as a share of the time, or of a billionth of the stretch where that is longer: next to time zero.
const SHORTEST: f64 = 16.0 * f64::EPSILON;
const NEXT_TO_ZERO: f64 = 1e-9;

/// The length of the next attempt: `h`, or what is `left` of the stretch, or half of that where `h` would leave next to nothing.
#[inline(always)]
pub fn fitted<R: Lanes>(h: R, left: R) -> R {
    let halved = R::select(left.less(h + h), R::constant(0.5) * left, h);
    R::select((R::constant(0.999_999) * left).at_most(h), left, halved)
}

/// Whether the clock does not resolve a step at `t` in a stretch of this length.
#[inline(always)]
pub fn is_unresolved<R: Lanes>(taken: R, t: R, length: R) -> Bits {
    let place = t.abs().raised(R::constant(NEXT_TO_ZERO) * length, R::ALL);
    taken.at_most(R::constant(SHORTEST) * place)
}

/// The error that is allowed of each state, from the largest size that each has had.
#[derive(Debug, Clone, Copy)]
pub struct Sizes<R> {
    largest: States<R>,
    /// Less than this is not asked for.
    round_off: States<R>,
    /// The errors, as methods ask for them.
    pub allowed: Allowed<R>,
}

impl<R: Lanes> Sizes<R> {
    /// Before any state was seen.
    #[inline(always)]
    pub fn new(tolerance: f64) -> Self {
        let one = [R::constant(1.0); ROOM];
        Self { largest: one, round_off: one, allowed: Allowed { tolerance, weights: one } }
    }

    /// The lanes of `fresh` begin, with their states' `usual` sizes and those that viscosity leaves of them (`slow`).
    #[inline(always)]
    pub fn begin(&mut self, fresh: Bits, usual: &States<R>, slow: &States<R>) {
        for n in 0..ROOM {
            self.largest[n] = R::select(fresh, R::constant(LEAST_SIZE) * slow[n], self.largest[n]);
            self.round_off[n] = R::select(fresh, R::constant(ROUND_OFF) * usual[n], self.round_off[n]);
        }
    }

    /// Takes the states of the lanes in `bits`, of which those in `fresh` have begun a stretch.
    #[inline(always)]
    pub fn note(&mut self, size: Size, y: &States<R>, bits: Bits, fresh: Bits) {
        let tolerance = R::constant(self.allowed.tolerance);
        for n in 0..size.states {
            let larger = self.largest[n].less(y[n].abs()) & bits;
            if larger | fresh == 0 {
                continue;
            }
            self.largest[n] = R::select(larger, y[n].abs(), self.largest[n]);
            let error = (tolerance * self.largest[n]).raised(self.round_off[n], R::ALL);
            self.allowed.weights[n] = R::constant(1.0) / error;
        }
    }

    /// The size of rates, as a share of the states' sizes.
    #[inline(always)]
    fn share(&self, size: Size, rate: &States<R>) -> R {
        R::constant(self.allowed.tolerance) * largest(size, rate, &self.allowed.weights)
    }

    /// The first steps of stretches of these lengths, which the lanes in `entering` begin.
    #[inline(always)]
    pub fn first_step(
        &self,
        (system, drive): (&impl System<R>, &SegmentDrive<R>),
        control: &StepControl<R>,
        (y, rate): (&States<R>, &States<R>),
        (entering, length): (Bits, R),
    ) -> R {
        let size = system.size();
        let pace = self.share(size, rate);
        // An explicit Euler step that changes no state by much shows how fast the rates change.
        let mut trial = R::zero();
        for lane in each(entering) {
            trial.set(lane, f64::min(0.01 / pace.lane(lane), 1e-3 * length.lane(lane)));
        }
        let mut change = *rate;
        system.rates(&drive.at(trial), Moved { from: y, by: trial, along: rate }, &mut change);
        for n in 0..size.states {
            change[n] = (change[n] - rate[n]) / trial;
        }
        let curvature = self.share(size, &change);
        let mut h = R::zero();
        for lane in each(entering) {
            let first = control.first(self.allowed.tolerance, pace.lane(lane), curvature.lane(lane));
            h.set(lane, if first > 0.0 { first.min(length.lane(lane)) } else { trial.lane(lane) });
        }
        h
    }
}
