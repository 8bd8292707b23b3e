//! Where a method gets the rates from: by a call, of one run or of a run in each lane.

use crate::formulation::System;
use crate::inputs::SegmentDrive;
use crate::lanes::Lanes;
use crate::simd::Level;

/// What gives the rates at a time of the segment and a state.
pub trait Slope<R, const N: usize> {
    /// The rates.
    fn at(&self, tau: R, y: &[R; N]) -> [R; N];
}

/// Called, of one run.
#[derive(Debug, Clone, Copy)]
pub struct Called<'a, S>(pub Level, pub &'a S, pub &'a SegmentDrive);

impl<S: System<f64, N>, const N: usize> Slope<f64, N> for Called<'_, S> {
    #[inline(always)]
    fn at(&self, tau: f64, y: &[f64; N]) -> [f64; N] {
        self.1.rates(self.0, self.2, tau, y)
    }
}

/// Called, of a run in each lane.
#[derive(Debug, Clone, Copy)]
pub struct Together<'a, R, S>(pub &'a S, pub &'a SegmentDrive<R>);

impl<R: Lanes, S: System<R, N>, const N: usize> Slope<R, N> for Together<'_, R, S> {
    #[inline(always)]
    fn at(&self, tau: R, y: &[R; N]) -> [R; N] {
        // Vectors have their instructions, whatever a lone run's are.
        self.0.rates(Level::Portable, self.1, tau, y)
    }
}
