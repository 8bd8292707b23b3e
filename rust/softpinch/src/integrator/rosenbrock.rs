//! Steinebach's Rodas4P2: a linearly implicit method of order four with six stages, L-stable and stiffly accurate
//! (Steinebach, "Improvement of Rosenbrock-Wanner method RODASP", in "Progress in Differential-Algebraic Equations II", 2020,
//! with his coefficients; Hairer and Wanner, "Solving Ordinary Differential Equations II", IV.7, for the form). One Jacobian
//! and one decomposition a step, no iteration: fixed work.
//!
//! (1/(gamma h) - J) u_i = f(t + c_i h, y + sum of a_ij u_j) + sum of (C_ij / h) u_j + d_i h df/dt,
//! y_1 = y + sum of a_6j u_j + u_6, and u_6 is the error estimate.

use std::marker::PhantomData;

use crate::dual::Dual;
use crate::formulation::{Build, System};
use crate::inputs::SegmentDrive;
use crate::integrator::linearize::{DIRECTIONS_IN_LANES, Directions, Linearizable, Linearization, Sweeps};
use crate::integrator::newton::{Unsolved, largest};
use crate::integrator::slope::{Called, Slope, Together};
use crate::integrator::{Adaptive, AdaptiveLanes, FreeInLanes, InLanes, Integrator, LaneMethod, Stats, Step};
use crate::lanes::{LaneTask, Lanes, MOST};
use crate::linear::{Each, Entry};
use crate::parameters::{Duals, Parameters, Stabilization};
use crate::real::Real;
use crate::simd::Level;

const STAGES: usize = 6;
const GAMMA: f64 = 0.25;

/// Where each stage stands in the step.
const C: [f64; STAGES] = [0.0, 0.75, 0.321448134013046, 0.519745732277726, 1.0, 1.0];

/// What each takes of the derivative by time.
const BY_TIME: [f64; STAGES] = [0.25, -0.5, -0.189532918363016, 0.085612108792769, 0.0, 0.0];

/// What each stage's state takes of the u before it.
const A: [[f64; STAGES - 1]; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0, 0.0, 0.0, 0.0, 0.0],
    [0.906377755268814, -0.189707390391685, 0.0, 0.0, 0.0],
    [3.758617027739064, 1.161741776019525, -0.849258085312803, 0.0, 0.0],
    [7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775, 0.0],
    [7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775, 1.0],
];

/// What its equation takes of them.
const COUPLING: [[f64; STAGES - 1]; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [-12.0, 0.0, 0.0, 0.0, 0.0],
    [-6.354581592719008, 0.338972550544623, 0.0, 0.0, 0.0],
    [-8.575016317114033, -7.606483992117508, 12.224_997_650_124_82, 0.0, 0.0],
    [-5.888975457523102, -8.157_396_617_841_82, 24.805546872612922, 12.790_401_512_796_98, 0.0],
    [-4.408651676063871, -6.692003137674639, 24.625568527593117, 16.627521966636085, -5.714285714285718],
];

/// Dense output of order three.
const DENSE: [[f64; STAGES - 1]; 2] = [
    [-5.323528268423303, -10.042123754867493, 17.175254928256965, -5.079931171878093, -0.016185991706112],
    [6.984505741529879, 6.914061169603662, -0.849178943070653, 18.104410789349338, -3.516963011559032],
];

/// The method, with the stages of the last step.
#[derive(Debug, Clone, Copy)]
pub struct Rosenbrock<T, const N: usize, const D: usize> {
    level: Level,
    /// The system in dual numbers.
    dual: T,
    stages: [[f64; N]; STAGES],
}

impl<T, const N: usize, const D: usize> Rosenbrock<T, N, D> {
    /// For a system, given in dual numbers too.
    #[inline(always)]
    pub fn new(level: Level, dual: T) -> Self {
        Self { level, dual, stages: [[0.0; N]; STAGES] }
    }
}

/// `sum` plus the weighted stages.
#[inline(always)]
fn plus<R: Real, const N: usize>(
    mut sum: [R; N],
    stages: &[[R; N]; STAGES],
    weights: &[f64],
    by: R,
) -> [R; N] {
    for (stage, weight) in stages.iter().zip(weights) {
        let weight = R::constant(*weight) * by;
        for n in 0..N {
            sum[n] = weight.mul_add(stage[n], sum[n]);
        }
    }
    sum
}

/// The stages of a step of length `h` from `y` and its end. `entry` makes what linear systems are solved in.
#[inline(always)]
fn step<R, S, T, const N: usize, const D: usize>(
    linearization: &Linearization<S, N, D, R>,
    slope: &impl Slope<R, N>,
    stages: &mut [[R; N]; STAGES],
    (tau, h): (R, R),
    (y, rate): (&[R; N], &[R; N]),
    real: impl Fn(T) -> R,
) -> [R; N]
where
    R: Real,
    S: System<R, N>,
    T: Entry<Part = R>,
{
    let one = R::constant(1.0);
    let factors = linearization.factor(T::of(one / (R::constant(GAMMA) * h)));
    let by_time = linearization.by_time();
    let mut at = *y;
    for i in 0..STAGES {
        let mut load = *rate;
        if i > 0 {
            at = plus(*y, stages, &A[i][..i], one);
            load = slope.at(R::constant(C[i]).mul_add(h, tau), &at);
        }
        load = plus(load, stages, &COUPLING[i][..i], one / h);
        let mut entries = [T::of(R::zero()); N];
        for n in 0..N {
            entries[n] = T::of((R::constant(BY_TIME[i]) * h).mul_add(by_time[n], load[n]));
        }
        let solution = linearization.solve(&factors, &entries);
        for n in 0..N {
            stages[i][n] = real(solution[n]);
        }
    }
    for n in 0..N {
        at[n] = at[n] + stages[STAGES - 1][n];
    }
    at
}

impl<S, T, const N: usize, const D: usize> Integrator<S, N> for Rosenbrock<T, N, D>
where
    S: System<f64, N>,
    T: Linearizable<N>,
{
    #[inline(always)]
    fn step(
        &mut self,
        system: &S,
        drive: &SegmentDrive,
        at: &Step<'_, N>,
        stats: &mut Stats,
    ) -> Result<[f64; N], Unsolved> {
        let Step { tau, h, y, rate, .. } = *at;
        let linearization = Linearization::<S, N, D>::new(self.dual.jacobian(self.level, drive, tau, y));
        stats.jacobians += 1;
        stats.factorisations += 1;
        stats.evaluations += STAGES as u64 - 1;
        let slope = Called(self.level, system, drive);
        Ok(step(&linearization, &slope, &mut self.stages, (tau, h), (y, rate), |x: f64| x))
    }
}

/// The system in dual numbers, of the runs in all lanes.
struct BuildDual<'a, B, const N: usize>(&'a [Parameters; MOST], &'a Stabilization, PhantomData<B>);

impl<B: Build<N>, R: Lanes, const N: usize> LaneTask<R> for BuildDual<'_, B, N> {
    type Output = B::Rates<Dual<R, DIRECTIONS_IN_LANES>>;

    #[inline(always)]
    fn run(self) -> B::Rates<Dual<R, DIRECTIONS_IN_LANES>> {
        B::rates(&Duals(self.0), self.1)
    }
}

/// The method in lanes.
#[derive(Debug, Clone, Copy)]
pub struct RosenbrockLanes<T, R, const N: usize, const D: usize> {
    dual: T,
    stages: [[R; N]; STAGES],
}

impl<B: Build<N>, R: Lanes, const N: usize, const D: usize> LaneMethod<B, R, N>
    for RosenbrockLanes<B::Rates<Dual<R, DIRECTIONS_IN_LANES>>, R, N, D>
{
    #[inline(always)]
    fn new(parameters: &[Parameters; MOST], gains: &Stabilization) -> Self {
        Self {
            dual: R::call(BuildDual::<B, N>(parameters, gains, PhantomData)),
            stages: [[R::zero(); N]; STAGES],
        }
    }

    #[inline(always)]
    fn step(
        &mut self,
        system: &B::Built<R>,
        drive: &SegmentDrive<R>,
        tau: R,
        h: R,
        y: &[R; N],
        rate: &[R; N],
    ) -> [R; N] {
        // A lane without a run has a step of length zero, which cannot be divided by: NaN would slow all lanes down. So would a long
        // step, at whose end angles are wild.
        let h = R::select(h.vanishes(), R::constant(1e-6), h);
        let linearization =
            Linearization::<B::Built<R>, N, D, R>::new(R::call(Sweeps { system: &self.dual, drive, tau, y }));
        let slope = Together(system, drive);
        step(&linearization, &slope, &mut self.stages, (tau, h), (y, rate), |x: Each<R>| x.0)
    }
}

impl<B: Build<N>, R: Lanes, const N: usize, const D: usize> AdaptiveLanes<B, R, N>
    for RosenbrockLanes<B::Rates<Dual<R, DIRECTIONS_IN_LANES>>, R, N, D>
{
    type Alone = Rosenbrock<B::Rates<Directions>, N, D>;

    #[inline(always)]
    fn errors(&self, _: R, weights: &[R; N]) -> R {
        largest::<R, B::Built<R>, N>(&self.stages[STAGES - 1], weights)
    }

    fn alone(
        &self,
        lane: usize,
        level: Level,
        parameters: &Parameters,
        gains: &Stabilization,
    ) -> Self::Alone {
        let mut alone = Rosenbrock::new(level, B::rates::<Directions>(parameters, gains));
        for (stage, all) in alone.stages.iter_mut().zip(&self.stages) {
            for (number, numbers) in stage.iter_mut().zip(all) {
                *number = numbers.lane(lane);
            }
        }
        alone
    }
}

/// Names the method for the lanes of systems with `D` degrees of freedom.
pub struct InRosenbrock<const D: usize>;

impl<B: Build<N>, const N: usize, const D: usize> InLanes<B, N> for InRosenbrock<D> {
    type Method<R: Lanes> = RosenbrockLanes<B::Rates<Dual<R, DIRECTIONS_IN_LANES>>, R, N, D>;
}

impl<B: Build<N>, const N: usize, const D: usize> FreeInLanes<B, N> for InRosenbrock<D> {
    type Method<R: Lanes> = RosenbrockLanes<B::Rates<Dual<R, DIRECTIONS_IN_LANES>>, R, N, D>;
}

impl<S, T, const N: usize, const D: usize> Adaptive<S, N> for Rosenbrock<T, N, D>
where
    S: System<f64, N>,
    T: Linearizable<N>,
{
    const ERROR_ORDER: f64 = 4.0;

    #[inline(always)]
    fn error(&mut self, _: &S, _: &SegmentDrive, step: &Step<'_, N>, _: bool, _: &mut Stats) -> f64 {
        largest::<f64, S, N>(&self.stages[STAGES - 1], &step.weights())
    }

    #[inline(always)]
    fn interpolate(&self, step: &Step<'_, N>, next: &[f64; N], x: f64) -> [f64; N] {
        let [low, high] = DENSE;
        let inner = plus(plus([0.0; N], &self.stages, &low, 1.0), &self.stages, &high, x);
        let mut at = *step.y;
        for n in 0..N {
            at[n] = (1.0 - x).mul_add(step.y[n], x * (1.0 - x).mul_add(inner[n], next[n]));
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Vector6};

    use super::*;

    fn matrix(rows: &[[f64; STAGES - 1]; STAGES]) -> Matrix6<f64> {
        Matrix6::from_fn(|r, c| if c < STAGES - 1 { rows[r][c] } else { 0.0 })
    }

    /// Back in the untransformed coefficients (Hairer and Wanner, IV.7) all conditions up to order four hold: a node with one
    /// branch takes alpha + gamma, one with several alpha. A slip in any digit shows.
    #[test]
    fn the_tableau_keeps_its_order_conditions() {
        let gamma = (Matrix6::identity() / GAMMA - matrix(&COUPLING)).try_inverse().unwrap();
        let alpha = matrix(&A) * gamma;
        let beta = alpha + gamma;
        let one = Vector6::repeat(1.0);
        let mut weights = matrix(&A).row(STAGES - 1).into_owned();
        weights[STAGES - 1] = 1.0;
        let b = (weights * gamma).transpose();
        let (c, by_time) = (Vector6::from(C), Vector6::from(BY_TIME));
        assert!((alpha * one - c).amax() < 1e-13, "{}", alpha * one);
        assert!((gamma * one - by_time).amax() < 1e-13, "{}", gamma * one);
        let squares = c.component_mul(&c);
        let conditions = [
            (one, 1.0),
            (beta * one, 1.0 / 2.0),
            (squares, 1.0 / 3.0),
            (beta * beta * one, 1.0 / 6.0),
            (squares.component_mul(&c), 1.0 / 4.0),
            (c.component_mul(&(alpha * beta * one)), 1.0 / 8.0),
            (beta * squares, 1.0 / 12.0),
            (beta * beta * beta * one, 1.0 / 24.0),
        ];
        for (k, (tree, expected)) in conditions.into_iter().enumerate() {
            assert!((b.dot(&tree) - expected).abs() < 1e-13, "{k}: {}", b.dot(&tree));
        }
    }
}
