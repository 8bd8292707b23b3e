//! The derivatives of the steps of methods that solve equations. Explicit methods take their steps in dual numbers
//! themselves; here the step is taken in plain numbers, as in any run, and the equations of its solved stages are
//! differentiated after that: by the Jacobian at each stage, and for linearly implicit stages by the
//! derivative of the Jacobian, too.

use std::ops::Range;

use nalgebra::DMatrix;

use crate::formulation::{
    Jacobian, Linear, MAX_COMPONENTS, RunDual, RunDualEquations, Runs, SceneEquations, StageState, States,
    System,
};
use crate::method::implicit_midpoint::ImplicitMidpoint;
use crate::method::newton::newton;
use crate::method::radau5::{self, Pair, Radau5};
use crate::method::rosenbrock::{A, BY_TIME, C, COUPLING, GAMMA, STAGES, rosenbrock};
use crate::method::{
    AnyMethod, Called, Dop853, Factors, Integrator, Linearization, Method, Newton, Rk4, Rosenbrock, Stats,
    Step, StepResult,
};
use crate::model::{DIRECTIONS, SegmentDrive};
use crate::number::{Entry, LaneEntry, LaneTask, Lanes, Real, task};

/// A step that was taken in plain numbers, to be differentiated.
pub struct SolvedStep<'a, R> {
    equations: &'a RunDualEquations<R>,
    /// The inputs of the segment, without their derivatives.
    plain_drive: &'a SegmentDrive,
    step: &'a Step<'a, RunDual<R>>,
    end: &'a States<f64>,
}

impl<R: Lanes> SolvedStep<'_, R> {
    /// The rates at the share `c` of the step, where the state differs from the one at its start by `z`, which has no
    /// derivatives; and the Jacobian there, which `tangent` computes. `z` is zero beyond the states of the motion. The rates
    /// count by the length, which has derivatives where it leads to an event: h k is h0 times k h / h0.
    #[inline(always)]
    fn stage(&self, tangent: &impl Linear<f64>, c: f64, z: &States<f64>) -> (States<RunDual<R>>, Jacobian) {
        let &Step { system, drive, tau, h, y, .. } = self.step;
        let tau = tau + RunDual::constant(c) * h;
        let at = StageState { from: y, by: RunDual::constant(1.0), along: &z.map(RunDual::constant) };
        let mut rates = [RunDual::zero(); MAX_COMPONENTS];
        system.rates(&drive.at(tau), drive, at, &mut rates);
        let share = h / RunDual::constant(h.lane(0));
        for rate in &mut rates {
            *rate = *rate * share;
        }
        let mut y = values(y);
        for n in 0..system.size().states {
            y[n] += z[n];
        }
        (rates, tangent.jacobian(self.plain_drive, tau.lane(0), &y))
    }
}

/// A method whose last step can be differentiated.
pub trait Differentiable<R: Lanes>: Integrator<f64, SceneEquations<f64>> {
    /// The state at the end of the step just taken, with its derivatives. Its values are not used.
    fn differentiate(&self, solved: &SolvedStep<'_, R>) -> States<RunDual<R>>;
}

task! {
    ['a, R: Lanes, M: Differentiable<R>]
    Differentiate<'a, R, M>(method: &'a M, solved: &'a SolvedStep<'a, R>)
    for R => States<RunDual<R>> = method.differentiate(solved)
}

impl<R: Lanes, M: Differentiable<R>> Differentiable<R> for Called<M> {
    fn differentiate(&self, solved: &SolvedStep<'_, R>) -> States<RunDual<R>> {
        R::outlined(Differentiate { method: &self.0, solved })
    }
}

/// A method as a run with derivatives uses it.
pub enum RunDualMethod<R> {
    Explicit(AnyMethod<RunDual<R>>),
    /// A method that solves equations takes its steps in plain numbers.
    Solved(Box<Solved<R>>),
}

/// A method that takes each step in plain numbers and differentiates it after that.
pub struct Solved<R> {
    method: Box<dyn Differentiable<R>>,
    system: SceneEquations<f64>,
    drive: SegmentDrive,
}

impl<R: Lanes> RunDualMethod<R> {
    pub fn new(runs: Runs<'_>, method: Method) -> Self {
        // Called, so that a stack frame has one method at most: methods that keep a Jacobian are large.
        #[inline(never)]
        fn solved<R: Lanes, M: Differentiable<R> + 'static>(
            runs: Runs<'_>,
            method: impl Fn(Runs<'_>, &SceneEquations<f64>) -> Called<M>,
        ) -> RunDualMethod<R> {
            let (system, method) = runs.with_method(|runs, system| Box::new(method(runs, system)));
            RunDualMethod::Solved(Box::new(Solved { method, system, drive: SegmentDrive::still() }))
        }
        match method {
            Method::Rk4 => Self::Explicit(Box::new(Called(Rk4::default()))),
            Method::Dop853 => Self::Explicit(Box::new(Called(Dop853::default()))),
            Method::ImplicitMidpoint => {
                solved(runs, |runs, system| newton::<_, Factors<f64>>(runs, system, ImplicitMidpoint))
            }
            Method::Radau5 => solved(runs, radau5::radau5),
            Method::Rosenbrock => solved(runs, rosenbrock),
        }
    }

    /// Begins a segment with the inputs `drive`. `linearized` is the point of the Jacobian that a resumed run uses.
    pub fn begin(&mut self, drive: SegmentDrive, linearized: Option<(f64, States<f64>)>) {
        let Self::Solved(solved) = self else { return };
        solved.method.restart();
        if let Some((tau, y)) = linearized {
            solved.method.take_jacobian(&drive, tau, &y);
        }
        solved.drive = drive;
    }

    /// Takes the next step with a Jacobian of its own, as runs do at events of contacts.
    pub fn restart(&mut self) {
        if let Self::Solved(solved) = self {
            solved.method.restart();
        }
    }

    pub fn step(
        &mut self,
        equations: &RunDualEquations<R>,
        step: &Step<'_, RunDual<R>>,
        next: &mut States<RunDual<R>>,
    ) -> StepResult {
        let stats = &mut Stats::default();
        let Solved { method, system, drive: plain_drive } = match self {
            Self::Explicit(method) => return method.step(step, next, stats),
            Self::Solved(solved) => &mut **solved,
        };
        plain_drive.contacts = step.drive.contacts.map(|tilt| tilt.lane(0));
        let (y, rate) = (values(step.y), values(step.rate));
        let (tau, h) = (step.tau.lane(0), step.h.lane(0));
        let plain = Step { system, drive: plain_drive, tau, h, y: &y, rate: &rate, allowed: None };
        let mut end = [0.0; MAX_COMPONENTS];
        method.step(&plain, &mut end, stats)?;
        *next = method.differentiate(&SolvedStep { equations, plain_drive, step, end: &end });
        for (number, value) in next.iter_mut().zip(end) {
            number.value = R::constant(value);
        }
        Ok(())
    }
}

#[inline(always)]
pub fn values<R: Lanes>(numbers: &States<RunDual<R>>) -> States<f64> {
    numbers.map(|number| number.lane(0))
}

/// For each direction the solution of (g I - J) x = b. The derivatives of `loads` are b, those of the result x.
#[inline(always)]
fn solve_slopes<R: Lanes>(
    linearization: &Linearization<R>,
    factors: &Factors<LaneEntry<R>>,
    loads: &States<RunDual<R>>,
) -> States<RunDual<R>> {
    let mut solutions = [RunDual::zero(); MAX_COMPONENTS];
    for k in 0..loads[0].slope.len() {
        let mut entries = [LaneEntry(R::zero()); MAX_COMPONENTS];
        for n in 0..MAX_COMPONENTS {
            entries[n] = LaneEntry(loads[n].slope[k]);
        }
        let solution = linearization.solve_with_works(factors, &entries);
        for n in 0..MAX_COMPONENTS {
            solutions[n].slope[k] = solution[n].real();
        }
    }
    solutions
}

/// Adds `of`, times a number without derivatives.
#[inline(always)]
fn add_scaled<R: Lanes>(sum: &mut RunDual<R>, weight: R, of: &RunDual<R>) {
    sum.value = weight.mul_add(of.value, sum.value);
    for k in 0..sum.slope.len() {
        sum.slope[k] = weight.mul_add(of.slope[k], sum.slope[k]);
    }
}

impl<R: Lanes, T: Linear<f64>> Differentiable<R> for Newton<ImplicitMidpoint, Factors<f64>, T> {
    /// The stage is y + z with z = h/2 f(y + z), so (2/h I - J) dz is the derivative of f(y + z) for constant z.
    #[inline(always)]
    fn differentiate(&self, solved: &SolvedStep<'_, R>) -> States<RunDual<R>> {
        let SolvedStep { equations, step, end, .. } = solved;
        let size = equations.system.size();
        let y = values(step.y);
        let mut z = [0.0; MAX_COMPONENTS];
        for n in 0..size.states {
            z[n] = 0.5 * (end[n] - y[n]);
        }
        let (loads, jacobian) = solved.stage(&self.tangent, 0.5, &z);
        let linearization = Linearization::everywhere(size, &jacobian);
        let factors = linearization.factor(LaneEntry(R::constant(2.0 / step.h.lane(0))));
        let dz = solve_slopes(&linearization, &factors, &loads);
        let mut next = *step.y;
        for n in 0..size.all() {
            add_scaled(&mut next[n], R::constant(2.0), &dz[n]);
        }
        next
    }
}

/// `sum` plus the weighted stages times `by`.
#[inline(always)]
fn plus<R: Lanes>(sum: &mut States<RunDual<R>>, stages: &[States<RunDual<R>>], weights: &[f64], by: f64) {
    for (stage, weight) in stages.iter().zip(weights) {
        let weight = R::constant(weight * by);
        for n in 0..MAX_COMPONENTS {
            add_scaled(&mut sum[n], weight, &stage[n]);
        }
    }
}

impl<R: Lanes, T: Linear<f64>> Differentiable<R> for Rosenbrock<T> {
    /// (1/(gamma h) - J) du_i is the derivative of the right-hand side of the stage, plus dJ u_i and the derivative
    /// of d_i h df/dt. Both are the derivative of J u_i + d_i h df/dt for constant u_i, which is the derivative of
    /// the rates along u_i in the state and d_i h in time.
    #[inline(always)]
    fn differentiate(&self, solved: &SolvedStep<'_, R>) -> States<RunDual<R>> {
        let &SolvedStep { equations, step: &Step { system, drive, tau, h, y, rate, .. }, .. } = solved;
        let size = system.size();
        let (length, h) = (h, h.lane(0));
        // The value is zero: 1 / h has a derivative where the length has one.
        let inverse = RunDual::constant(1.0) / length - RunDual::constant(1.0 / h);
        let linearization = Linearization::everywhere(size, &self.linearization.jacobian);
        let factors = linearization.factor(LaneEntry(R::constant(1.0 / (GAMMA * h))));
        let mut stages = [[RunDual::zero(); MAX_COMPONENTS]; STAGES];
        let (mut load, mut at) = (*rate, *y);
        for i in 0..STAGES {
            if i > 0 {
                at = *y;
                plus(&mut at, &stages, &A[i][..i], 1.0);
                let state = StageState { from: &at, by: RunDual::zero(), along: y };
                let input = drive.at(tau + RunDual::constant(C[i]) * length);
                system.rates(&input, drive, state, &mut load);
            }
            plus(&mut load, &stages, &COUPLING[i][..i], 1.0 / h);
            let own = &self.stages[i];
            let change = equations.along(drive, (tau, y), (own, RunDual::constant(BY_TIME[i]) * length));
            for n in 0..size.all() {
                let terms = COUPLING[i][..i].iter().zip(&self.stages).map(|(c, stage)| c * stage[n]);
                let coupled = RunDual::constant(terms.sum::<f64>() - own[n] / GAMMA);
                load[n] = load[n] + change[n] + inverse * coupled;
            }
            let slopes = solve_slopes(&linearization, &factors, &load);
            for n in 0..size.all() {
                stages[i][n] = RunDual { value: R::constant(own[n]), ..slopes[n] };
            }
        }
        for n in 0..size.all() {
            at[n] = at[n] + stages[STAGES - 1][n];
        }
        at
    }
}

/// The stages' derivatives of the rates, at first for constant z_i, in the end all.
type Stages<R> = [States<RunDual<R>>; 3];

impl<R: Lanes, T: Linear<f64>> Differentiable<R> for Newton<Radau5, Pair, T> {
    /// The stages are y + z_i with z_i = h sum of a_ij k_j and k_i = f(y + z_i). So dk_i is the derivative of
    /// f(y + z_i) for constant z_i, plus J_i h sum of a_ij dk_j, where J_i is the Jacobian at the stage.
    ///
    /// As in `linearize.rs`, the rates of the coordinates x are v, and those of the remaining states r depend on x
    /// and v only. So only the derivatives of the rates of v are unknowns of the linear system; those of x and
    /// r follow from them.
    #[inline(always)]
    fn differentiate(&self, solved: &SolvedStep<'_, R>) -> States<RunDual<R>> {
        let SolvedStep { equations, step, .. } = solved;
        let size = equations.system.size();
        let (h, d, states) = (step.h.lane(0), size.degrees, size.states);
        // On the heap, because threads may be small.
        let mut jacobians = vec![Jacobian::zero(); 3];
        let mut slopes = [[RunDual::zero(); MAX_COMPONENTS]; 3];
        for i in 0..3 {
            let mut z = self.scheme.stages[i];
            z[states..].fill(0.0);
            (slopes[i], jacobians[i]) = solved.stage(&self.tangent, radau5::C[i], &z);
            for slope in &mut slopes[i] {
                slope.value = R::zero();
            }
        }
        let lu = velocity_system(&jacobians, h, d, states).lu();

        // What x and r contribute if the rates of v do not change.
        let mut still = slopes;
        for stage in &mut still {
            stage[d..2 * d].fill(RunDual::zero());
        }
        let moved = weighted(h, &still);
        multiply(&jacobians, (2 * d..states, 0..d), &moved, &mut still);
        let moved = weighted(h, &still);
        let mut loads = slopes;
        multiply(&jacobians, (d..2 * d, 0..d), &moved, &mut loads);
        multiply(&jacobians, (d..2 * d, 2 * d..states), &moved, &mut loads);
        let right = DMatrix::from_fn(3 * d, DIRECTIONS, |row, k| loads[row / d][d + row % d].direction(k));
        // A singular matrix belongs to a step without a solution, which Newton's method refuses.
        let solution = lu.solve(&right).unwrap_or(right);
        for row in 0..3 * d {
            let own: [f64; DIRECTIONS] = std::array::from_fn(|k| solution[(row, k)]);
            slopes[row / d][d + row % d] = RunDual::varied(0.0, &own);
        }

        // The rates of x, then those of r, then the powers, which are the rates of the works.
        let changes = weighted(h, &slopes);
        for i in 0..3 {
            for n in 0..d {
                slopes[i][n] = slopes[i][n] + changes[i][d + n];
            }
        }
        let changes = weighted(h, &slopes);
        multiply(&jacobians, (2 * d..states, 0..2 * d), &changes, &mut slopes);
        let changes = weighted(h, &slopes);
        multiply(&jacobians, (states..size.all(), 0..states), &changes, &mut slopes);
        let [_, _, change] = weighted(h, &slopes);
        let mut next = *step.y;
        for n in 0..size.all() {
            next[n] = step.y[n] + change[n];
        }
        next
    }
}

/// For each stage i the sum of h a_ij k_j.
#[inline(always)]
fn weighted<R: Lanes>(h: f64, of: &Stages<R>) -> Stages<R> {
    let mut sums = [[RunDual::zero(); MAX_COMPONENTS]; 3];
    for (sum, weights) in sums.iter_mut().zip(&radau5::A) {
        plus(sum, of, weights, h);
    }
    sums
}

/// Adds to these rows of `to` these columns of each stage's Jacobian times `of`.
#[inline(always)]
fn multiply<R: Lanes>(
    jacobians: &[Jacobian],
    (rows, columns): (Range<usize>, Range<usize>),
    of: &Stages<R>,
    to: &mut Stages<R>,
) {
    for i in 0..3 {
        for n in rows.clone() {
            for m in columns.clone() {
                let entry = R::constant(jacobians[i].rows[n][m]);
                add_scaled(&mut to[i][n], entry, &of[i][m]);
            }
        }
    }
}

/// The matrix of the linear system for the derivatives of the three stages' rates of v.
fn velocity_system(jacobians: &[Jacobian], h: f64, d: usize, states: usize) -> DMatrix<f64> {
    let b = |i: usize, j: usize| h * radau5::A[i][j];
    let mut twice = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            twice[i][j] = (0..3).map(|k| b(i, k) * b(k, j)).sum();
        }
    }
    let mut matrix = DMatrix::identity(3 * d, 3 * d);
    for i in 0..3 {
        let rows = &jacobians[i].rows;
        for l in 0..3 {
            // How the remaining states follow the rates of v: their own rates depend on x and v.
            let mut follow = [[0.0; MAX_COMPONENTS]; MAX_COMPONENTS];
            for r in 2 * d..states {
                for j in 0..3 {
                    let inner = &jacobians[j].rows[r];
                    let (by_x, by_v) = (b(i, j) * twice[j][l], b(i, j) * b(j, l));
                    for n in 0..d {
                        follow[r][n] += by_x * inner[n] + by_v * inner[d + n];
                    }
                }
            }
            for n in 0..d {
                for m in 0..d {
                    let row = &rows[d + m];
                    let mut entry = twice[i][l] * row[n] + b(i, l) * row[d + n];
                    for r in 2 * d..states {
                        entry += row[r] * follow[r][n];
                    }
                    matrix[(i * d + m, l * d + n)] -= entry;
                }
            }
        }
    }
    matrix
}
