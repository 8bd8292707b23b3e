//! The limits of an adaptive step: the allowed error of each state, and the shortest step that doubles resolve.

use crate::formulation::{MAX_COMPONENTS, Size, StageState, States, System};
use crate::method::{Allowed, StepControl, largest};
use crate::model::SegmentDrive;
use crate::number::{Bits, Lanes, each};

/// A state's magnitude counts as no less than this share of its typical one, and a rate's as no less than
/// this share of the rate that viscosity leaves: at rest nothing else is known.
const LEAST_SIZE: f64 = 1e-3;
/// The allowed error of a state is no less than this share of its typical magnitude.
const ROUND_OFF: f64 = 100.0 * f64::EPSILON;
/// The shortest step, as a share of the time, or close to time zero of a billionth of the segment's length.
const SHORTEST: f64 = 16.0 * f64::EPSILON;
const NEXT_TO_ZERO: f64 = 1e-9;

/// The length of the next attempt: the rest of the segment (`left`) if `h` reaches its end, half of the rest
/// if two steps of `h` would go beyond its end, and otherwise `h`.
#[inline(always)]
pub fn next_length<R: Lanes>(h: R, left: R) -> R {
    let halved = R::select(left.less(h + h), R::constant(0.5) * left, h);
    R::select((R::constant(0.999_999) * left).at_most(h), left, halved)
}

/// The lanes in which double precision does not resolve the step `taken` at `t`, in a segment of this length.
#[inline(always)]
pub fn is_unresolved<R: Lanes>(taken: R, t: R, length: R) -> Bits {
    let place = t.abs().max_in(R::constant(NEXT_TO_ZERO) * length, R::ALL);
    taken.at_most(R::constant(SHORTEST) * place)
}

/// The error that is allowed of each state, from the largest magnitude that the state has reached so far.
pub struct Sizes<R> {
    largest: States<R>,
    /// The smallest errors that are allowed.
    round_off: States<R>,
    /// The allowed errors in the form that methods use.
    pub allowed: Allowed<R>,
}

impl<R: Lanes> Sizes<R> {
    #[inline(always)]
    pub fn new(tolerance: f64) -> Self {
        let one = [R::constant(1.0); MAX_COMPONENTS];
        Self { largest: one, round_off: one, allowed: Allowed { tolerance, weights: one } }
    }

    /// Begins runs in the lanes of `changed`. `usual` has their typical magnitudes, `slow` those that viscosity leaves.
    #[inline(always)]
    pub fn begin(&mut self, changed: Bits, usual: &States<R>, slow: &States<R>) {
        for n in 0..MAX_COMPONENTS {
            self.largest[n] = R::select(changed, R::constant(LEAST_SIZE) * slow[n], self.largest[n]);
            self.round_off[n] = R::select(changed, R::constant(ROUND_OFF) * usual[n], self.round_off[n]);
        }
    }

    /// Takes note of the states in the lanes of `bits`. Of these lanes, those of `entering` have just begun a segment.
    #[inline(always)]
    pub fn note(&mut self, size: Size, y: &States<R>, bits: Bits, entering: Bits) {
        let tolerance = R::constant(self.allowed.tolerance);
        for n in 0..size.states {
            let larger = self.largest[n].less(y[n].abs()) & bits;
            if larger | entering == 0 {
                continue;
            }
            self.largest[n] = R::select(larger, y[n].abs(), self.largest[n]);
            let error = (tolerance * self.largest[n]).max_in(self.round_off[n], R::ALL);
            self.allowed.weights[n] = R::constant(1.0) / error;
        }
    }

    #[inline(always)]
    fn share(&self, size: Size, rate: &States<R>) -> R {
        R::constant(self.allowed.tolerance) * largest(size, rate, &self.allowed.weights)
    }

    /// The first steps in the lanes of `entering`, which begin at times `tau` of their segments, with this `length`
    /// left.
    #[inline(always)]
    pub fn first_step(
        &self,
        (system, drive): (&impl System<R>, &SegmentDrive<R>),
        control: &StepControl<R>,
        (y, rate): (&States<R>, &States<R>),
        (entering, tau, length): (Bits, R, R),
    ) -> R {
        let size = system.size();
        let pace = self.share(size, rate);
        // An explicit Euler step that changes no state by much shows how fast the rates change.
        let mut trial = R::zero();
        for lane in each(entering) {
            trial.set(lane, f64::min(0.01 / pace.lane(lane), 1e-3 * length.lane(lane)));
        }
        let mut change = *rate;
        let at = StageState { from: y, by: trial, along: rate };
        system.rates(&drive.at(tau + trial), drive, at, &mut change);
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
