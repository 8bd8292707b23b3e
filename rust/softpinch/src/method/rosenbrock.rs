//! Steinebach's Rodas4P2: a linearly implicit method of order four with six stages, L-stable and stiffly accurate
//! (Steinebach, "Improvement of Rosenbrock-Wanner method RODASP", in "Progress in Differential-Algebraic Equations II",
//! 2020, with his coefficients; Hairer and Wanner, "Solving Ordinary Differential Equations II", IV.7, for the form). A
//! step takes one Jacobian and one decomposition, and no iteration, so that its work is fixed.
//!
//! (1/(gamma h) - J) u_i = f(t + c_i h, y + sum of a_ij u_j) + sum of (C_ij / h) u_j + d_i h df/dt,
//! y_1 = y + sum of a_6j u_j + u_6, and u_6 is the error estimate.

use std::marker::PhantomData;

use nalgebra::Complex;

use crate::formulation::{
    Linear, MAX_COMPONENTS, Runs, SceneEquations, Size, StageState, States, System, Tangent,
};
use crate::method::{
    Adaptive, Called, Integrator, Linearization, MethodEntry, Stats, Step, StepResult, largest,
};
use crate::number::{Bits, Entry, Lanes, inlined};

pub const ENTRY: MethodEntry = MethodEntry {
    order: 4,
    real_stability_limit: None,
    // Hairer and Wanner IV.7: a polynomial over (1 - gamma z)^6, of degree five because of L-stability. Order four
    // determines its first five coefficients, which are those of e^z (1 - z/4)^6. The last one comes from the tableau.
    stability_function: |z| {
        const TOP: [f64; 6] = [1.0, -1.0 / 2.0, -1.0 / 16.0, 1.0 / 24.0, 5.0 / 768.0, -7.0 / 3072.0];
        let top = TOP.iter().rev().fold(Complex::new(0.0, 0.0), |sum, c| sum * z + c);
        top / (Complex::new(1.0, 0.0) - z / 4.0).powi(6)
    },
    keeps_jacobian: false,
    alone: |runs, system| Box::new(rosenbrock(runs, system)),
    adaptive: Some(|runs, system| Box::new(rosenbrock(runs, system))),
    error_order: 4.0,
    min_growth: 1.0,
};

pub(super) fn rosenbrock(runs: Runs<'_>, system: &SceneEquations<f64>) -> Called<Rosenbrock<Tangent<f64>>> {
    Called(Rosenbrock::new(system.size(), runs.tangent()))
}

pub(super) const STAGES: usize = 6;
pub(super) const GAMMA: f64 = 0.25;

/// The nodes: the position of each stage within the step.
pub(super) const C: [f64; STAGES] = [0.0, 0.75, 0.321448134013046, 0.519745732277726, 1.0, 1.0];

/// The weights of the derivative with respect to time in each stage.
pub(super) const BY_TIME: [f64; STAGES] = [0.25, -0.5, -0.189532918363016, 0.085612108792769, 0.0, 0.0];

/// The weights of the earlier u_j in the state of each stage, row by row.
pub(super) const A: [[f64; STAGES - 1]; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0, 0.0, 0.0, 0.0, 0.0],
    [0.906377755268814, -0.189707390391685, 0.0, 0.0, 0.0],
    [3.758617027739064, 1.161741776019525, -0.849258085312803, 0.0, 0.0],
    [7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775, 0.0],
    [7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775, 1.0],
];

/// The weights of the earlier u_j in the equation of each stage, row by row.
pub(super) const COUPLING: [[f64; STAGES - 1]; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [-12.0, 0.0, 0.0, 0.0, 0.0],
    [-6.354581592719008, 0.338972550544623, 0.0, 0.0, 0.0],
    [-8.575016317114033, -7.606483992117508, 12.224_997_650_124_82, 0.0, 0.0],
    [-5.888975457523102, -8.157_396_617_841_82, 24.805546872612922, 12.790_401_512_796_98, 0.0],
    [-4.408651676063871, -6.692003137674639, 24.625568527593117, 16.627521966636085, -5.714285714285718],
];

/// The weights of the stages in the dense output, which has order three.
const DENSE: [[f64; STAGES - 1]; 2] = [
    [-5.323528268423303, -10.042123754867493, 17.175254928256965, -5.079931171878093, -0.016185991706112],
    [6.984505741529879, 6.914061169603662, -0.849178943070653, 18.104410789349338, -3.516963011559032],
];

pub struct Rosenbrock<T, R = f64, E = f64> {
    pub(super) tangent: T,
    /// The linearisation of the last step, at its start.
    pub(super) linearization: Box<Linearization<R>>,
    /// Whether the next step has the start of the last one, and so its linearisation.
    repeats: bool,
    pub(super) stages: [States<R>; STAGES],
    /// The type of number in which linear systems are solved.
    entry: PhantomData<E>,
}

impl<T, R: Lanes, E> Rosenbrock<T, R, E> {
    #[inline(always)]
    pub fn new(size: Size, tangent: T) -> Self {
        let linearization = Box::new(Linearization::new(size));
        let stages = [[R::zero(); MAX_COMPONENTS]; STAGES];
        Self { tangent, linearization, repeats: false, stages, entry: PhantomData }
    }
}

/// Adds the weighted stages times `by` to `sum`.
#[inline(always)]
fn add<R: Lanes>(size: Size, sum: &mut States<R>, stages: &[States<R>; STAGES], weights: &[f64], by: R) {
    for (stage, weight) in stages.iter().zip(weights) {
        let weight = R::constant(*weight) * by;
        size.each(|n| sum[n] = weight.mul_add(stage[n], sum[n]));
    }
}

impl<R: Lanes, S: System<R>, T: Linear<R>, E: Entry<Part = R>> Integrator<R, S> for Rosenbrock<T, R, E> {
    #[inline(always)]
    fn step(&mut self, step: &Step<'_, R, S>, next: &mut States<R>, stats: &mut Stats) -> StepResult {
        let &Step { system, drive, tau, h, y, rate, .. } = step;
        let size = system.size();
        // A lane without a run has a step of length zero. A division by it would give NaN, which would slow
        // all lanes down. A long step would slow them down too, because angles are huge at its end.
        let h = R::select(h.is_zero(), R::constant(1e-6), h);
        if !std::mem::take(&mut self.repeats) {
            self.linearization.take(&self.tangent, drive, tau, y);
            stats.jacobians += 1;
        }
        let linearization = &self.linearization;
        stats.factorisations += 1;
        stats.evaluations += STAGES as u64 - 1;
        let one = R::constant(1.0);
        let factors = linearization.factor(E::of(one / (R::constant(GAMMA) * h)));
        let (mut at, mut load) = (*y, *rate);
        let mut entries = [E::of(R::zero()); MAX_COMPONENTS];
        for i in 0..STAGES {
            if i > 0 {
                // The share of the latest stage is left out here and added in `state`.
                let last = i - 1;
                size.each(|n| at[n] = y[n]);
                add(size, &mut at, &self.stages, &A[i][..last], one);
                let state = StageState { from: &at, by: R::constant(A[i][last]), along: &self.stages[last] };
                let input = drive.at(R::constant(C[i]).mul_add(h, tau));
                system.rates(&input, drive, state, &mut load);
            }
            add(size, &mut load, &self.stages, &COUPLING[i][..i], one / h);
            let share = R::constant(BY_TIME[i]) * h;
            let by_time = size.states;
            size.each(|n| {
                entries[n] = E::of(share.mul_add(linearization.jacobian.rows[n][by_time], load[n]));
            });
            let solution = linearization.solve_with_works(&factors, &entries);
            let stage = &mut self.stages[i];
            size.each(|n| stage[n] = solution[n].real());
        }
        // The state of the last stage, with the share that `at` still lacks, plus the last stage itself.
        let (share, last) = (R::constant(A[STAGES - 1][STAGES - 2]), &self.stages[STAGES - 1]);
        let before = &self.stages[STAGES - 2];
        size.each(|n| next[n] = share.mul_add(before[n], at[n]) + last[n]);
        Ok(())
    }

    inlined! {
        repeat(&mut self) -> () = self.repeats = true;
        renew(&mut self, runs: Runs<'_>) -> () = self.tangent.renew(runs);
    }
}

impl<R: Lanes, S: System<R>, T: Linear<R>, E: Entry<Part = R>> Adaptive<R, S> for Rosenbrock<T, R, E> {
    #[inline(always)]
    fn error(&mut self, step: &Step<'_, R, S>, _: Bits, _: &mut Stats) -> R {
        largest(step.system.size(), &self.stages[STAGES - 1], &step.weights())
    }

    #[inline(always)]
    fn interpolate(&self, y: &States<R>, next: &States<R>, x: R) -> States<R> {
        let [low, high] = DENSE;
        let one = R::constant(1.0);
        let size = self.linearization.size;
        let mut inner = [R::zero(); MAX_COMPONENTS];
        add(size, &mut inner, &self.stages, &low, one);
        add(size, &mut inner, &self.stages, &high, x);
        let mut at = *y;
        for n in 0..MAX_COMPONENTS {
            at[n] = (one - x).mul_add(y[n], x * (one - x).mul_add(inner[n], next[n]));
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

    /// All conditions up to order four hold in the untransformed coefficients (Hairer and Wanner, IV.7): a
    /// node with one branch takes alpha + gamma, a node with several takes alpha. An error in any digit
    /// shows.
    #[test]
    fn the_tableau_satisfies_its_order_conditions() {
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
