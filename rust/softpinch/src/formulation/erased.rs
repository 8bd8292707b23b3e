//! A system behind a reference. What a step loop calls anyway, it may as well call without knowing the type: then its code is
//! there once for all systems of as many states, and the crate is a good deal smaller.

use crate::energy::Energies;
use crate::formulation::{Evaluation, Motion, System};
use crate::inputs::{Input, SegmentDrive};
use crate::lanes::{LaneTask, Lanes};
use crate::simd::{Level, has_portable};

/// What is asked of a [`System`], each with the instructions of `level`.
pub trait Called<const N: usize> {
    /// [`System::begin`].
    fn begin(&self, motion: &Motion<f64>) -> [f64; N];
    /// [`System::evaluate`].
    fn evaluate(&self, level: Level, input: &Input<f64>, y: &[f64; N]) -> Evaluation<f64, N>;
    /// [`System::evaluation`].
    fn evaluation(&self, level: Level, drive: &SegmentDrive, tau: f64, y: &[f64; N]) -> Evaluation<f64, N>;
    /// [`System::rates`].
    fn rates(&self, level: Level, drive: &SegmentDrive, tau: f64, y: &[f64; N]) -> [f64; N];
    /// [`System::jump`].
    fn jump(&self, level: Level, input: &Input<f64>, y: &mut [f64; N], impulse: &[f64; 3]);
    /// [`System::energies`].
    fn energies(&self, level: Level, motion: &Motion<f64>) -> Energies;
    /// [`System::correct`].
    fn correct(&self, level: Level, input: &Input<f64>, y: &mut [f64; N]);
}

/// Declares a question to a system as a task, so that its code has the instructions of a level.
macro_rules! task {
    ($name:ident($($field:ident: $kind:ty),*) -> $output:ty, $system:ident => $body:expr) => {
        struct $name<'a, S, const N: usize>(&'a S, $($kind),*);

        impl<S: System<f64, N>, const N: usize> LaneTask<f64> for $name<'_, S, N> {
            type Output = $output;
            const PORTABLE: bool = has_portable(S::LEDGER);

            #[inline(always)]
            fn run(self) -> $output {
                let Self($system, $($field),*) = self;
                $body
            }
        }
    };
}
task! { Evaluate(input: &'a Input<f64>, y: &'a [f64; N]) -> Evaluation<f64, N>, system => system.evaluate(input, y) }
task! {
    Jump(input: &'a Input<f64>, y: &'a mut [f64; N], impulse: &'a [f64; 3]) -> (),
    system => system.jump(input, y, impulse)
}
task! { Energy(motion: &'a Motion<f64>) -> Energies, system => system.energies(motion) }
task! { Correct(input: &'a Input<f64>, y: &'a mut [f64; N]) -> (), system => system.correct(input, y) }

impl<S: System<f64, N>, const N: usize> Called<N> for S {
    fn begin(&self, motion: &Motion<f64>) -> [f64; N] {
        System::begin(self, motion)
    }

    fn evaluate(&self, level: Level, input: &Input<f64>, y: &[f64; N]) -> Evaluation<f64, N> {
        f64::call_at(level, Evaluate(self, input, y))
    }

    fn evaluation(&self, level: Level, drive: &SegmentDrive, tau: f64, y: &[f64; N]) -> Evaluation<f64, N> {
        System::evaluation(self, level, drive, tau, y)
    }

    fn rates(&self, level: Level, drive: &SegmentDrive, tau: f64, y: &[f64; N]) -> [f64; N] {
        System::rates(self, level, drive, tau, y)
    }

    fn jump(&self, level: Level, input: &Input<f64>, y: &mut [f64; N], impulse: &[f64; 3]) {
        f64::call_at(level, Jump(self, input, y, impulse));
    }

    fn energies(&self, level: Level, motion: &Motion<f64>) -> Energies {
        f64::call_at(level, Energy(self, motion))
    }

    fn correct(&self, level: Level, input: &Input<f64>, y: &mut [f64; N]) {
        f64::call_at(level, Correct(self, input, y));
    }
}

/// A system of `STATES` states, `N` with the ledger, and `D` degrees of freedom, whose formulation is not known.
#[derive(Clone, Copy)]
pub struct Erased<'a, const N: usize, const STATES: usize, const D: usize> {
    /// Instructions to use.
    pub level: Level,
    /// The system.
    pub system: &'a dyn Called<N>,
}

impl<const N: usize, const STATES: usize, const D: usize> System<f64, N> for Erased<'_, N, STATES, D> {
    const STATES: usize = STATES;
    const DEGREES: usize = D;
    const ERASED: bool = true;

    fn begin(&self, motion: &Motion<f64>) -> [f64; N] {
        self.system.begin(motion)
    }

    fn evaluate(&self, input: &Input<f64>, y: &[f64; N]) -> Evaluation<f64, N> {
        self.system.evaluate(self.level, input, y)
    }

    fn evaluation(&self, level: Level, drive: &SegmentDrive, tau: f64, y: &[f64; N]) -> Evaluation<f64, N> {
        self.system.evaluation(level, drive, tau, y)
    }

    fn rates(&self, level: Level, drive: &SegmentDrive, tau: f64, y: &[f64; N]) -> [f64; N] {
        self.system.rates(level, drive, tau, y)
    }

    fn jump(&self, input: &Input<f64>, y: &mut [f64; N], impulse: &[f64; 3]) {
        self.system.jump(self.level, input, y, impulse);
    }

    fn energies(&self, motion: &Motion<f64>) -> Energies {
        self.system.energies(self.level, motion)
    }

    fn correct(&self, input: &Input<f64>, y: &mut [f64; N]) {
        self.system.correct(self.level, input, y);
    }
}
