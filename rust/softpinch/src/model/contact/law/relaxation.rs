//! Relaxation of a tip: Maxwell branches beside its law.
//!
//! A branch with the share g and the time tau remembers a force r and a shear zeta, which follow F(d_n) and d_t:
//! r' = (F - r) / tau and zeta' = (d_t - zeta) / tau. With chi and eta as in `springs.rs`, it resists d_n with
//! chi g {F - r + eta F'' (d_t - zeta)^2 / 2} and d_t with chi eta g F' (d_t - zeta). It stores
//! chi g {Phi(d_n) - Phi(delta) - r (d_n - delta) + eta F' (d_t - zeta)^2 / 2}, where F(delta) = r, and loses
//! chi g {(F - r) (d_n - delta) + eta F' (d_t - zeta)^2} / tau. Both are positive for any F that rises with d, so a branch is
//! passive. Only the ledger needs delta.

use super::springs::{Curve, Springs};
use crate::model::Source;
use crate::number::{Bits, Real};

/// Most branches of a tip.
pub const BRANCHES: usize = 2;

/// Number of states of all branches: for each branch r of both tips, then zeta of both tips.
pub const RELAXATIONS: usize = 4 * BRANCHES;

/// Most steps of Newton's method for delta.
const STEPS: usize = 60;

#[derive(Debug, Clone, Copy)]
pub(super) struct Branches<R> {
    shares: [R; BRANCHES],
    /// 1 / tau.
    rates: [R; BRANCHES],
    /// The compression from which the search for delta starts.
    radius: R,
}

/// The effect of a tip's branches at one state.
#[derive(Debug, Clone, Copy)]
pub struct Relaxing<R> {
    /// The resistance against d_n and d_t, N.
    pub resistance: [R; 2],
    /// The rates of all states of branches; zeros of the other tip.
    pub rates: [R; RELAXATIONS],
    /// The energy stored, J. Zero unless it is asked for, and so is the loss.
    pub stored: R,
    /// The power lost, W.
    pub lost: R,
}

impl<R: Real> Relaxing<R> {
    /// That of a tip without branches.
    #[inline(always)]
    pub(super) fn nothing() -> Self {
        let zero = R::zero();
        Self { resistance: [zero; 2], rates: [zero; RELAXATIONS], stored: zero, lost: zero }
    }
}

impl<R: Real> Branches<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        let (mut shares, mut rates) = ([R::zero(); BRANCHES], [R::zero(); BRANCHES]);
        for k in 0..BRANCHES {
            shares[k] = source.number(|p| p.relaxation[i][k].share);
            rates[k] = R::constant(1.0) / source.number(|p| p.relaxation[i][k].time);
        }
        Self { shares, rates, radius: source.number(|p| p.tips[i].radius) }
    }
}

impl<R: Real> Springs<R> {
    /// The effect of the branches of tip `i`, for d_n, d_t and the states of all branches.
    #[inline(always)]
    pub(super) fn relaxing(
        &self,
        i: usize,
        [d_n, d_t]: [R; 2],
        states: &[R; RELAXATIONS],
        ledger: bool,
    ) -> Relaxing<R> {
        let (half, mut found) = (R::constant(0.5), Relaxing::nothing());
        let Curve { integral, force, slope, bend } = self.curve_called(d_n);
        for k in 0..BRANCHES {
            let (share, rate) = (self.share * self.branches.shares[k], self.branches.rates[k]);
            let (r, zeta) = (4 * k + i, 4 * k + 2 + i);
            let (over, shear) = (force - states[r], d_t - states[zeta]);
            let stretched = self.shear_factor * shear;
            let squared = stretched * shear;
            found.resistance[0] = share.mul_add((half * bend).mul_add(squared, over), found.resistance[0]);
            found.resistance[1] = (share * slope).mul_add(stretched, found.resistance[1]);
            found.rates[r] = over * rate;
            found.rates[zeta] = shear * rate;
            if ledger {
                let (delta, stored) = self.compression(states[r]);
                let (beyond, sheared) = (d_n - delta, slope * squared);
                let normal = (integral - stored) - states[r] * beyond;
                found.stored = share.mul_add(half.mul_add(sheared, normal), found.stored);
                found.lost = (share * rate).mul_add(over.mul_add(beyond, sheared), found.lost);
            }
        }
        found
    }

    /// The compression with a force, and Phi there, by Newton's method. F is convex, so after its first step it comes from
    /// above; where it is flat, at a force of zero, it halves the compression with each step.
    #[inline(always)]
    fn compression(&self, force: R) -> (R, R) {
        let force = force.positive_part();
        let (mut d, mut moving) = (self.branches.radius, Bits::MAX);
        for _ in 0..STEPS {
            let Curve { force: found, slope, .. } = self.curve_called(d);
            moving &= R::zero().less(slope);
            let step = R::select(moving, (found - force) / slope, R::zero());
            d = d - step;
            // A lane that is done stays where its run alone ends.
            moving &= (R::constant(1e-30) * d * d).less(step * step);
            if moving == 0 {
                break;
            }
        }
        (d, self.curve_called(d).integral)
    }
}
