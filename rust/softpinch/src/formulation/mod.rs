//! How the constraints are kept: from a state to its derivative and the multipliers.
//!
//! A new formulation is one file beside `csm.rs` and one line in [`FORMULATIONS`].

pub mod csm;
pub mod erased;
pub mod nullspace;
pub mod projected;

use crate::control::{ByPid, Driven, Fingers};
use crate::energy::{Energies, WORKS};
use crate::geometry::index::{D_N, FINGER, THETA};
use crate::inputs::{Drive, Input, SegmentDrive};
use crate::lanes::{LaneTask, Lanes};
use crate::parameters::{Parameters, Source, Stabilization};
use crate::real::Real;
use crate::simd::{Level, has_portable};

/// The formulations there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formulation {
    /// The constraint stabilisation method (19)-(24).
    Csm,
    /// Independent velocities (Maggi's equations): no gains, no drift.
    Nullspace,
    /// Accelerations on the constraints, and after each step the state put back on them.
    Projected,
}

/// The formulations by their public names.
pub const FORMULATIONS: [(&str, Formulation); 3] =
    [("csm", Formulation::Csm), ("nullspace", Formulation::Nullspace), ("projected", Formulation::Projected)];

/// A state in the nine coordinates that every formulation is recorded in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<R> {
    /// Coordinates.
    pub q: [R; 9],
    /// Velocities.
    pub p: [R; 9],
    /// The controllers' memories.
    pub memory: [R; 2],
}

impl Motion<f64> {
    /// The usual size of each number of a scene: lengths against the larger tip's radius, angles against one, rates against
    /// these times sqrt(E a / M), at which such a tip moves the object. An integral without a gain drives nothing, so its error is
    /// none: its size is infinite.
    #[must_use]
    pub fn sizes(parameters: &Parameters) -> Self {
        let [right, left] = &parameters.tips;
        let length = right.radius.max(left.radius);
        let pace = (right.youngs_modulus.max(left.youngs_modulus) * length / parameters.grasped.mass).sqrt();
        let mut q = [length; 9];
        q[THETA] = 1.0;
        q[FINGER..D_N].fill(1.0);
        let memory = parameters.control.map(|pid| if pid.ki == 0.0 { f64::INFINITY } else { 1.0 / pace });
        Self { q, p: q.map(|size| size * pace), memory }
    }

    /// The same with the rates of a scene that its viscosity slows down: E a / c, at which a tip gives way.
    #[must_use]
    pub fn slow_sizes(parameters: &Parameters) -> Self {
        let usual = Self::sizes(parameters);
        let mut pace = usual.p[THETA];
        for tip in &parameters.tips {
            let viscosity = tip.normal_viscosity.max(tip.tangential_viscosity);
            pace = pace.min(tip.youngs_modulus * tip.radius / viscosity);
        }
        Self { p: usual.q.map(|size| size * pace), ..usual }
    }
}

/// What a formulation says of one state.
#[derive(Debug, Clone, Copy)]
pub struct Evaluation<R, const N: usize> {
    /// The derivative of the state.
    pub rate: [R; N],
    /// The state in nine coordinates.
    pub motion: Motion<R>,
    /// (lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N).
    pub multipliers: [R; 4],
    /// (C_1^H, C_2^H, C_1^N, C_2^N).
    pub residuals: [R; 4],
    /// sin theta_p of both tips, for the monitors.
    pub sin_tilt: [R; 2],
    /// Torques on the fingers, N m.
    pub torque: [R; 2],
}

/// A formulation that builds systems of a scene, in numbers of any kind.
pub trait Build<const N: usize> {
    /// The system that it builds.
    type Built<R: Real>: System<R, N>;

    /// One with the same rates, to be differentiated.
    type Rates<R: Real>: System<R, N>;

    /// Compiles a scene, or one a lane.
    fn build<R: Real>(source: &impl Source<R>, gains: &Stabilization) -> Self::Built<R>;

    /// The same for the rates alone.
    fn rates<R: Real>(source: &impl Source<R>, gains: &Stabilization) -> Self::Rates<R>;
}

/// The systems in the lanes at times `tau` of their segments and states `y`.
struct There<'a, R, S, const N: usize> {
    system: &'a S,
    drive: &'a SegmentDrive<R>,
    tau: R,
    y: &'a [R; N],
}

impl<R: Lanes, S: System<R, N>, const N: usize> LaneTask<R> for There<'_, R, S, N> {
    type Output = Evaluation<R, N>;
    const PORTABLE: bool = has_portable(S::LEDGER);

    #[inline(always)]
    fn run(self) -> Evaluation<R, N> {
        self.system.evaluate(&self.drive.at(self.tau), self.y)
    }
}

/// Their rates alone.
struct Rates<'a, R, S, const N: usize>(There<'a, R, S, N>);

impl<R: Lanes, S: System<R, N>, const N: usize> LaneTask<R> for Rates<'_, R, S, N> {
    type Output = [R; N];
    const PORTABLE: bool = has_portable(S::LEDGER);

    #[inline(always)]
    fn run(self) -> [R; N] {
        self.0.run().rate
    }
}

/// Work whose code is compiled for every formulation and kind of fingers.
pub trait Compiled {
    /// What the work gives.
    type Output;
    /// Does the work for systems of `N` states, or `M` where the ledger is carried, and `D` degrees of freedom.
    fn run<B: Build<N> + Build<M>, const N: usize, const M: usize, const D: usize>(self) -> Self::Output;
}

/// Does work for a formulation and a kind of fingers.
pub fn compiled<W: Compiled>(formulation: Formulation, fingers: Fingers, work: W) -> W::Output {
    use {csm::ByCsm, nullspace::ByNullspace, projected::ByProjected};
    /// The numbers of states and degrees of freedom, of fingers that turn and of driven ones.
    macro_rules! states {
        ($name:ident: $build:ident) => {
            match fingers {
                Fingers::Pid => work.run::<$build<ByPid>, { $name::STATES }, { $name::STATES + WORKS }, { $name::DEGREES }>(),
                Fingers::Driven => work.run::<
                    $build<Driven>,
                    { $name::DRIVEN_STATES },
                    { $name::DRIVEN_STATES + WORKS },
                    { $name::DRIVEN_DEGREES },
                >(),
            }
        };
    }
    match formulation {
        Formulation::Csm => states!(csm: ByCsm),
        Formulation::Projected => states!(csm: ByProjected),
        Formulation::Nullspace => states!(nullspace: ByNullspace),
    }
}

/// A first-order system of `N` states, as the integrators see it, in this order: as many coordinates as there are degrees
/// of freedom; their rates; what depends on both and drives the rates (shears, controllers' memories); and behind the
/// [`System::STATES`] of the motion the ledger's works, where they are carried, which drive nothing.
pub trait System<R: Real, const N: usize> {
    /// How many states the motion has.
    const STATES: usize;
    /// How many of them are coordinates, the first ones, with their rates behind them.
    const DEGREES: usize;
    /// Whether the ledger is carried.
    const LEDGER: bool = N > Self::STATES;
    /// Whether it stands for another one behind a reference.
    const ERASED: bool = false;

    /// The state of a motion, its works at zero.
    fn begin(&self, motion: &Motion<R>) -> [R; N];

    /// Derivative and multipliers of the state `y` under the inputs of the instant.
    fn evaluate(&self, input: &Input<R>, y: &[R; N]) -> Evaluation<R, N>;

    /// The same at time `tau` of a segment, by a call: whoever asks in many places, or does much else in a step, loses nothing.
    #[inline(always)]
    fn evaluation(&self, level: Level, drive: &SegmentDrive<R>, tau: R, y: &[R; N]) -> Evaluation<R, N>
    where
        R: Lanes,
        Self: Sized,
    {
        R::call_at(level, There { system: self, drive, tau, y })
    }

    /// The derivative alone, by a call.
    #[inline(always)]
    fn rates(&self, level: Level, drive: &SegmentDrive<R>, tau: R, y: &[R; N]) -> [R; N]
    where
        R: Lanes,
        Self: Sized,
    {
        R::call_at(level, Rates(There { system: self, drive, tau, y }))
    }

    /// Adds the constraint-consistent velocity jump that an impulse (J_x, J_y, J_theta) makes:
    /// M dp = J + Phi^T Lambda, Phi dp = 0. Where the state carries the ledger, the works of the impulse and of the
    /// constraints' answer join it: J (p before + p after) / 2, which is exact.
    fn jump(&self, input: &Input<R>, y: &mut [R; N], impulse: &[R; 3]);

    /// The energies of a motion, for the ledger.
    fn energies(&self, motion: &Motion<R>) -> Energies<R>;

    /// Puts the end of a step back on the constraints, where the formulation does that.
    #[inline(always)]
    fn correct(&self, input: &Input<R>, y: &mut [R; N]) {
        let _ = (input, y);
    }
}
