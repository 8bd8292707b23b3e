//! Linear systems with the Jacobian of the equations.
//!
//! Coordinates x, their rates v and the remaining states r (shears, memories) linearise to x' = v,
//! r' = R_x x + R_v v, v' = V_x x + V_v v + V_r r. So (g I - J) needs no decomposition of its own size:
//! eliminating x and r leaves g I - V_v - (V_x + V_r R_v) / g - V_r R_x / g^2, with one row for each degree of
//! freedom, 5 instead of 14 in `nullspace`. The works of the ledger follow from all states.
//!
//! Maxwell branches of tips are remaining states that decay and follow shears: r' has the term R_r r, in which R_r is lower
//! triangular. Then (g - R_r)^-1 takes the place of 1 / g, with a substitution for each row.

use std::ops::Range;

use crate::formulation::{Jacobian, Linear, MAX_COMPONENTS, Size, States};
use crate::model::SegmentDrive;
use crate::number::{Entry, LaneTask, Lanes, Lu, MOST_ROWS, Real, Square, inlined, task};

/// Calls a function with the numbers of states and of degrees of freedom, and whether there are branches. For the sizes
/// of the formulations these are constants, so that the function's loops are unrolled.
macro_rules! unrolled {
    ($size:expr, $function:ident($($argument:expr),*)) => {
        match ($size.states, $size.degrees) {
            (20, 9) => $function(20, 9, false, $($argument),*),
            (14, 7) => $function(14, 7, false, $($argument),*),
            (14, 5) => $function(14, 5, false, $($argument),*),
            (8, 3) => $function(8, 3, false, $($argument),*),
            (states, degrees) => $function(states, degrees, $size.relaxations > 0, $($argument),*),
        }
    };
}

/// A Jacobian, with the matrices that remain after coordinates and remaining states are eliminated.
pub struct Linearization<R = f64> {
    pub(super) size: Size,
    pub(super) jacobian: Jacobian<R>,
    /// V_x + V_r R_v.
    stiffness: Square<R>,
    /// V_r R_x.
    delayed: Square<R>,
}

#[inline(always)]
fn reduce<R: Lanes>(states: usize, d: usize, branches: bool, of: &mut Linearization<R>) {
    let branches = branches && R::VARIED_PARTS;
    let Linearization { jacobian: Jacobian { rows }, stiffness, delayed, .. } = of;
    for i in 0..d {
        let rate = &rows[d + i];
        stiffness[i][..d].copy_from_slice(&rate[..d]);
        delayed[i][..d].fill(R::zero());
        // With branches what follows from r depends on g.
        for r in 2 * d..if branches { 2 * d } else { states } {
            for k in 0..d {
                stiffness[i][k] = rate[r].mul_add(rows[r][d + k], stiffness[i][k]);
                delayed[i][k] = rate[r].mul_add(rows[r][k], delayed[i][k]);
            }
        }
    }
}

#[inline(always)]
fn factor<T: Entry>(states: usize, d: usize, branches: bool, of: &Linearization<T::Part>, g: T) -> Factors<T>
where
    T::Part: Lanes,
{
    let branches = branches && T::Part::VARIED_PARTS;
    let (zero, one) = (T::of(T::Part::zero()), T::of(T::Part::constant(1.0)));
    let inverse = one / g;
    let mut matrix = [[zero; MOST_ROWS]; MOST_ROWS];
    for i in 0..d {
        // The row V_r (g - R_r)^-1.
        let (rows, mut through) = (&of.jacobian.rows, [zero; MAX_COMPONENTS]);
        if branches {
            for n in (2 * d..states).rev() {
                through[n] = T::of(rows[d + i][n]);
                for m in n + 1..states {
                    through[n] = through[n].plus(rows[m][n], through[m]);
                }
                through[n] = through[n] / (g - T::of(rows[n][n]));
            }
        }
        for k in 0..d {
            let slow = (zero.plus(of.delayed[i][k], inverse)).plus(of.stiffness[i][k], one);
            let mut entry = T::of(-rows[d + i][d + k]).less_product(slow, inverse);
            if branches {
                for n in 2 * d..states {
                    entry = entry.less_product(through[n], T::of(rows[n][d + k]).plus(rows[n][k], inverse));
                }
            }
            matrix[i][k] = if i == k { entry + g } else { entry };
        }
    }
    Factors { inverse, lu: Lu::new(d, matrix) }
}

/// The remaining state after those in `before`: its load in `x` times (g - R_r)^-1.
#[inline(always)]
fn remaining<T: Entry>(
    branches: bool,
    before: Range<usize>,
    rows: &[[T::Part; MAX_COMPONENTS]; MAX_COMPONENTS],
    inverse: T,
    x: &States<T>,
) -> T
where
    T::Part: Lanes,
{
    let n = before.end;
    if !branches {
        return x[n] * inverse;
    }
    let mut load = x[n];
    for m in before {
        load = load.plus(rows[n][m], x[m]);
    }
    load / (T::of(T::Part::constant(1.0)) / inverse - T::of(rows[n][n]))
}

#[inline(always)]
fn solve<T: Entry>(
    states: usize,
    d: usize,
    branches: bool,
    of: &Linearization<T::Part>,
    factors: &Factors<T>,
    b: &States<T>,
) -> States<T>
where
    T::Part: Lanes,
{
    let branches = branches && T::Part::VARIED_PARTS;
    let rows = &of.jacobian.rows;
    let inverse = factors.inverse;
    let mut x = *b;
    // The coordinates and the remaining states of a solution whose rates are zero.
    for n in 0..d {
        x[n] = b[n] * inverse;
    }
    for n in 2 * d..states {
        for k in 0..d {
            x[n] = x[n].plus(rows[n][k], x[k]);
        }
        x[n] = remaining(branches, 2 * d..n, rows, inverse, &x);
    }
    let mut rate = [T::of(T::Part::zero()); MOST_ROWS];
    for i in 0..d {
        rate[i] = b[d + i];
        for k in 0..d {
            rate[i] = rate[i].plus(rows[d + i][k], x[k]);
        }
        for k in 2 * d..states {
            rate[i] = rate[i].plus(rows[d + i][k], x[k]);
        }
    }
    rate = factors.lu.solve(d, &rate);
    x[d..2 * d].copy_from_slice(&rate[..d]);
    for n in 0..d {
        x[n] = (b[n] + rate[n]) * inverse;
    }
    for n in 2 * d..states {
        x[n] = b[n];
        for k in 0..2 * d {
            x[n] = x[n].plus(rows[n][k], x[k]);
        }
        x[n] = remaining(branches, 2 * d..n, rows, inverse, &x);
    }
    x
}

task! {
    ['a, R: Lanes, T: Entry<Part = R>] Factor<'a, R, T>(of: &'a Linearization<R>, g: T)
    for R => Factors<T> = unrolled!(of.size, factor(of, g))
}

struct Solve<'a, T: Entry>(&'a Linearization<T::Part>, &'a Factors<T>, &'a States<T>);

impl<R: Lanes, T: Entry<Part = R>> LaneTask<R> for Solve<'_, T> {
    type Output = States<T>;

    inlined! { run(self) -> States<T> = unrolled!(self.0.size, solve(self.0, self.1, self.2)); }
}

impl<R: Lanes> Linearization<R> {
    #[inline(always)]
    pub fn new(size: Size) -> Self {
        let zero = [[R::zero(); MOST_ROWS]; MOST_ROWS];
        Self { size, jacobian: Jacobian::zero(), stiffness: zero, delayed: zero }
    }

    /// The same Jacobian in all lanes.
    #[inline(always)]
    pub fn everywhere(size: Size, jacobian: &Jacobian) -> Box<Self> {
        let mut found = Box::new(Self::new(size));
        for (own, row) in found.jacobian.rows.iter_mut().zip(&jacobian.rows) {
            for (own, value) in own.iter_mut().zip(row) {
                *own = R::constant(*value);
            }
        }
        unrolled!(found.size, reduce(&mut found));
        found
    }

    /// Takes the Jacobian at time `tau` of a segment and state `y`, in place.
    #[inline(always)]
    pub fn take(&mut self, tangent: &impl Linear<R>, drive: &SegmentDrive<R>, tau: R, y: &States<R>) {
        tangent.jacobian_into(drive, tau, y, &mut self.jacobian);
        unrolled!(self.size, reduce(self));
    }

    #[inline(always)]
    pub fn factor<T: Entry<Part = R>>(&self, g: T) -> Factors<T> {
        // Called by all methods of single runs; inlined into the one method that has lanes.
        let task = Factor { of: self, g };
        if const { R::WIDTH == 1 } { R::outlined(task) } else { task.run() }
    }

    /// Solves (g I - J) x = b for the states. The other entries of the solution are those of `b`.
    #[inline(always)]
    pub fn solve<T: Entry<Part = R>>(&self, factors: &Factors<T>, b: &States<T>) -> States<T> {
        let task = Solve(self, factors, b);
        if const { R::WIDTH == 1 } { R::outlined(task) } else { task.run() }
    }

    /// Solves (g I - J) x = b for the states and the works.
    #[inline(always)]
    pub fn solve_with_works<T: Entry<Part = R>>(&self, factors: &Factors<T>, b: &States<T>) -> States<T> {
        let mut x = self.solve(factors, b);
        for n in self.size.states..self.size.all() {
            for k in 0..self.size.states {
                x[n] = x[n].plus(self.jacobian.rows[n][k], x[k]);
            }
            x[n] = x[n] * factors.inverse;
        }
        x
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Factors<T: Entry> {
    /// 1 / g.
    inverse: T,
    lu: Lu<T>,
}

#[cfg(test)]
mod tests {
    use nalgebra::{Complex, ComplexField, DMatrix, DVector, SMatrix, Vector3};

    use super::*;
    use crate::formulation::equations::Carried;
    use crate::formulation::scene_equations::{Choice, SceneEquations};
    use crate::formulation::system::System;
    use crate::formulation::table::Formulation;
    use crate::formulation::tangent::Linear;
    use crate::formulation::tangent::{Runs, Tangent};
    use crate::model::contact::Side;
    use crate::model::contact_modes::ContactModel;
    use crate::model::control::Fingers;
    use crate::model::drive::SegmentDrive;
    use crate::model::geometry::Geometry;
    use crate::model::inputs::Inputs;
    use crate::model::motion::Motion;
    use crate::model::parameters::{Parameters, Stabilization};
    use crate::model::piecewise::PiecewisePolynomial;
    use crate::model::start::consistent;
    use crate::number::lanes::MOST;

    const KP: [f64; 2] = [90.0, 110.0];
    const KI: [f64; 2] = [1000.0, 600.0];
    const TARGET_RATE: [f64; 2] = [0.7, -0.4];

    /// Two different fingers, tips and controllers, and a centre of gravity off the middle.
    fn parameters() -> Parameters {
        let finger = |length: f64| [length, 0.049, 0.0045, 0.1, 5.8e-4];
        let tip = |e: f64, kappa: f64| [0.02, e, 100.0, 60.0, kappa, 0.1, 0.05];
        let mut values = Vec::new();
        values.extend(finger(0.0762));
        values.extend(finger(0.07));
        values.extend(tip(3e5, 1.0));
        values.extend(tip(4e5, -1.0));
        values.extend([0.049, 0.1, 4e-5, 0.003, f64::INFINITY]);
        values.extend([KP[0], 1.0, KI[0], KP[1], 1.4, KI[1], 9.81, f64::INFINITY, f64::INFINITY]);
        let mut all = Parameters::default().to_array();
        all[..values.len()].copy_from_slice(&values);
        Parameters::from_array(&all).unwrap()
    }

    /// A state on the constraints without a zero in it.
    fn motion() -> Motion<f64> {
        let pose = [0.003, 0.0735, 0.05, 0.12, 0.09];
        let (q, p) = consistent(&parameters(), &pose, &[4e-4, -3e-4], &[0.2, -0.1, 1.5, -2.0, 1.2]);
        Motion { q, p, memory: [2e-3, -1e-3], ..Motion::zero() }
    }

    /// Targets that move and a force that oscillates.
    fn drive() -> SegmentDrive {
        let ramp = TARGET_RATE.map(|rate| [0.1, rate, 0.0, 0.0, 0.0, 0.0]);
        let schedule = PiecewisePolynomial::new("schedule", vec![0.0], vec![ramp, ramp]).unwrap();
        let sine = crate::model::inputs::Sinusoid {
            start: 0.0,
            end: f64::INFINITY,
            omega: 30.0,
            phase: 0.3,
            amplitude: [5.0, -2.0, 0.03],
        };
        Inputs::new(schedule.into(), vec![], vec![sine], vec![], vec![]).unwrap().segment(0.0)
    }

    const TAU: f64 = 0.02;

    /// The equations of the parameters above, in plain and in dual numbers.
    fn equations(
        formulation: Formulation,
        fingers: Fingers,
        ledger: bool,
    ) -> (SceneEquations<f64>, Tangent<f64>) {
        let gains = Stabilization { alpha: 1000.0, beta: 700.0 };
        let choice = Choice {
            formulation,
            contact: ContactModel::Bilateral,
            fingers,
            moves: false,
            carried: Carried { ledger, slips: false },
        };
        let (own, gains) = (&parameters(), &gains);
        let runs = Runs { choice, parameters: [own; MOST], gains };
        (runs.system(), runs.tangent())
    }

    /// Central differences of the rates. Each state is changed by a share of its typical magnitude. The last
    /// column is the derivative with respect to time.
    fn differences(system: &SceneEquations<f64>) -> DMatrix<f64> {
        let Size { states, .. } = system.size();
        let magnitudes = system.begin(&Motion::typical_magnitudes(&parameters()));
        let y = system.begin(&motion());
        let all = system.size().all();
        let rates =
            |tau: f64, y: &States<f64>| DVector::from(system.evaluate(&drive(), tau, y).rate[..all].to_vec());
        DMatrix::from_columns(
            &(0..=states)
                .map(|k| {
                    if k == states {
                        return (rates(TAU + 1e-5, &y) - rates(TAU - 1e-5, &y)) / 2e-5;
                    }
                    let h = 1e-6 * magnitudes[k];
                    let (mut up, mut down) = (y, y);
                    up[k] += h;
                    down[k] -= h;
                    (rates(TAU, &up) - rates(TAU, &down)) / (up[k] - down[k])
                })
                .collect::<Vec<_>>(),
        )
    }

    /// The Jacobian agrees with differences, and linear systems with it have the solutions that nalgebra
    /// finds for the full matrix. An effect on a row below `round_off` counts as round-off: those on the
    /// power of the constraints in `nullspace` do, and they are larger with driven fingers.
    fn check((system, tangent): (SceneEquations<f64>, Tangent<f64>), round_off: f64) {
        let size = system.size();
        let (states, all) = (size.states, size.all());
        let y = system.begin(&motion());
        let magnitudes = system.begin(&Motion::typical_magnitudes(&parameters()));
        let jacobian = tangent.jacobian(&drive(), TAU, &y);
        let ours = DMatrix::from_fn(all, states + 1, |r, c| jacobian.rows[r][c]);
        let theirs = differences(&system);
        for row in 0..all {
            // Each entry is compared with the largest effect that a state of typical magnitude has on its
            // row.
            let effect = |c: usize| if c < states { magnitudes[c] } else { 1e-3 };
            let largest = (0..=states).map(|c| theirs[(row, c)].abs() * effect(c)).fold(round_off, f64::max);
            for c in 0..=states {
                let off = (ours[(row, c)] - theirs[(row, c)]).abs() * effect(c);
                assert!(
                    off <= 1e-7 * largest,
                    "row {row} column {c}: {} {}",
                    ours[(row, c)],
                    theirs[(row, c)]
                );
            }
        }

        let mut linearization = Linearization::new(size);
        linearization.take(&tangent, &drive(), TAU, &y);
        for g in [Complex::new(3e4, 0.0), Complex::new(2e3, -1.7e3)] {
            let whole = DMatrix::from_fn(all, all, |r, c| {
                let entry = if c < states { -ours[(r, c)] } else { 0.0 };
                Complex::new(entry, 0.0) + if r == c { g } else { Complex::new(0.0, 0.0) }
            });
            let b: [Complex<f64>; MAX_COMPONENTS] =
                std::array::from_fn(|n| Complex::new(magnitudes[n], -0.3 * magnitudes[n]) * (1.0 + n as f64));
            let theirs = whole.lu().solve(&DVector::from(b[..all].to_vec())).unwrap();
            let ours = linearization.solve_with_works(&linearization.factor(g), &b);
            for n in 0..states {
                assert!((ours[n] - theirs[n]).modulus() <= 1e-11 * theirs[n].modulus(), "{g} {n}");
            }
            if g.im == 0.0 {
                let real = linearization.solve_with_works(&linearization.factor(g.re), &b.map(|b| b.re));
                for n in 0..all {
                    assert!((real[n] - theirs[n].re).abs() <= 1e-11 * theirs[n].modulus(), "{n}");
                }
            }
        }
    }

    #[test]
    fn jacobians_and_their_solves_agree_with_differences_and_with_nalgebra() {
        for formulation in [Formulation::Csm, Formulation::Nullspace] {
            check(equations(formulation, Fingers::Pid, false), 1e-3);
            check(equations(formulation, Fingers::Pid, true), 1e-3);
            check(equations(formulation, Fingers::Driven, true), 1e-2);
        }
    }

    /// A torque e changes the accelerations by (M^-1 - M^-1 Phi^T (Phi M^-1 Phi^T)^-1 Phi M^-1) e. A memory
    /// acts by the factor -K_I, a moving target by K_P.
    #[test]
    fn entries_agree_with_closed_forms() {
        let (system, tangent) = equations(Formulation::Csm, Fingers::Pid, false);
        let motion = motion();
        let states = system.size().states;
        let jacobian = tangent.jacobian(&drive(), TAU, &system.begin(&motion));
        let phi = Geometry::<f64>::of(&Side::both(&parameters()), &motion.q, &motion.p).constraint_matrix();
        let weights =
            SMatrix::<f64, 9, 9>::from_diagonal(&parameters().masses().row().map(|m| 1.0 / m).into());
        let schur = (phi * weights * phi.transpose()).try_inverse().unwrap();
        let accelerance = weights - weights * phi.transpose() * schur * phi * weights;
        for i in 0..2 {
            for k in 0..9 {
                let entry = jacobian.rows[9 + k][18 + i];
                let expected = -KI[i] * accelerance[(k, 3 + i)];
                assert!((entry - expected).abs() <= 1e-11 * KI[i] * accelerance.column(3 + i).amax());
            }
            // The memory integrates the error of the angle, and the angle integrates its rate.
            assert_eq!(jacobian.rows[18 + i][3 + i], 1.0);
            assert_eq!(jacobian.rows[18 + i][states], -TARGET_RATE[i]);
            assert_eq!(jacobian.rows[3 + i][12 + i], 1.0);
        }
        let force_rate = 30.0 * (30.0 * TAU + 0.3).cos();
        for k in 0..9 {
            let targets: f64 = (0..2).map(|i| KP[i] * TARGET_RATE[i] * accelerance[(k, 3 + i)]).sum();
            let force = accelerance.fixed_view::<1, 3>(k, 0) * Vector3::new(5.0, -2.0, 0.03) * force_rate;
            let expected = targets + force.x;
            let entry = jacobian.rows[9 + k][states];
            assert!((entry - expected).abs() <= 1e-10 * expected.abs().max(1.0), "{k} {entry} {expected}");
        }
    }
}
