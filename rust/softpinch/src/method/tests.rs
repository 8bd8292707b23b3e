//! Tests of each method alone, on equations with known solutions.

use nalgebra::{Complex, ComplexField};

use crate::formulation::equations::{Evaluation, MAX_COMPONENTS, Size, States};
use crate::formulation::system::{StageState, System};
use crate::formulation::tangent::{Jacobian, Linear};
use crate::method::dop853::Dop853;
use crate::method::implicit_midpoint::ImplicitMidpoint;
use crate::method::linearize::Factors;
use crate::method::newton::Newton;
use crate::method::radau5::{Pair, Radau5};
use crate::method::rk4::Rk4;
use crate::method::rosenbrock::Rosenbrock;
use crate::method::table::{METHODS, Method};
use crate::method::traits::{Adaptive, Allowed, Integrator, Stats, Step};
use crate::model::drive::{Input, SegmentDrive};
use crate::model::inputs::Inputs;
use crate::model::piecewise::PiecewisePolynomial;
use crate::number::dual::Dual;
use crate::number::lanes::Lanes;
use crate::number::real::Real;

/// x' = v, v' = -2 t v^2 + stiffness x - drag v. With the first term alone the solution is v = 1 / (1 + t^2).
/// With the other terms alone it is the linear test equation, and its eigenvalues are any pair that adds up
/// to -drag.
#[derive(Clone, Copy)]
struct Equation {
    bend: f64,
    stiffness: f64,
    drag: f64,
}

impl Equation {
    const BENT: Self = Self { bend: 1.0, stiffness: 0.0, drag: 0.0 };

    fn linear(stiffness: f64, drag: f64) -> Self {
        Self { bend: 0.0, stiffness, drag }
    }
}

impl Equation {
    /// The derivative of (x, v). The target angle has the time.
    fn derivative<R: Real>(&self, time: R, y: &States<R>) -> [R; 2] {
        let [x, v, ..] = *y;
        let bend = R::constant(-2.0 * self.bend) * time * v * v;
        [v, R::constant(self.stiffness).mul_add(x, R::constant(-self.drag).mul_add(v, bend))]
    }
}

impl<R: Lanes> System<R> for Equation {
    fn size(&self) -> Size {
        Size { states: 2, degrees: 1, works: 0, slips: 0, relaxations: 0 }
    }

    fn evaluate_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, now: &mut Evaluation<R>) {
        now.rate[..2].copy_from_slice(&self.derivative(drive.at(tau).target[0], y));
    }

    fn rates(&self, input: &Input<R>, _: &SegmentDrive<R>, at: StageState<'_, R>, rate: &mut States<R>) {
        let y = std::array::from_fn(|n| at.along[n].mul_add(at.by, at.from[n]));
        rate[..2].copy_from_slice(&self.derivative(input.target[0], &y));
    }
}

/// The Jacobian from dual numbers with three directions: x, v and time.
impl Linear<f64> for Equation {
    fn jacobian_into(&self, drive: &SegmentDrive, tau: f64, y: &States<f64>, jacobian: &mut Jacobian) {
        let mut lifted = y.map(Dual::<f64, 3>::constant);
        for (n, number) in lifted[..2].iter_mut().enumerate() {
            *number = Dual::variable(y[n], n);
        }
        let time = drive.at(Dual::variable(tau, 2)).target[0];
        for (row, rate) in jacobian.rows.iter_mut().zip(self.derivative(time, &lifted)) {
            row[..3].copy_from_slice(&rate.slope);
        }
    }
}

/// Makes a state from x and v.
fn state(x: f64, v: f64) -> States<f64> {
    let mut y = [0.0; MAX_COMPONENTS];
    (y[0], y[1]) = (x, v);
    y
}

/// Inputs whose target angle is the time.
fn clock() -> SegmentDrive {
    let ramp = [[0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0; 6]];
    let schedule = PiecewisePolynomial::new("schedule", vec![0.0], vec![[[0.0; 6]; 2], ramp]).unwrap();
    Inputs::new(schedule.into(), vec![], vec![], vec![], vec![]).unwrap().segment(0.0)
}

/// The typical magnitudes of x and v.
fn magnitudes() -> States<f64> {
    [1.0; MAX_COMPONENTS]
}

fn size(equation: Equation) -> Size {
    System::<f64>::size(&equation)
}

fn midpoint(equation: Equation) -> impl Integrator<f64, Equation> {
    Newton::<_, Factors<f64>, _>::new(size(equation), equation, magnitudes(), ImplicitMidpoint)
}

fn radau5(equation: Equation) -> impl Adaptive<f64, Equation> {
    Newton::<_, Pair, _>::new(size(equation), equation, magnitudes(), Radau5::default())
}

fn rosenbrock(equation: Equation) -> impl Adaptive<f64, Equation> {
    Rosenbrock::<_, f64, f64>::new(size(equation), equation)
}

fn dop853() -> impl Adaptive<f64, Equation> {
    Dop853::<f64>::default()
}

fn rate(equation: &Equation, tau: f64, y: &States<f64>) -> States<f64> {
    equation.evaluate(&clock(), tau, y).rate
}

/// Any method.
trait Stepped {
    /// Takes one step of length `h` from `y`.
    fn one_step(&mut self, equation: Equation, tau_and_h: (f64, f64), y: &States<f64>) -> States<f64>;

    /// [`Integrator::restart`].
    fn forget(&mut self);
}

impl<I: Integrator<f64, Equation>> Stepped for I {
    fn one_step(&mut self, equation: Equation, (tau, h): (f64, f64), y: &States<f64>) -> States<f64> {
        let rate = rate(&equation, tau, y);
        let drive = &clock();
        let step = Step { system: &equation, drive, tau, h, y, rate: &rate, allowed: None };
        let mut next = *y;
        self.step(&step, &mut next, &mut Stats::default()).unwrap();
        next
    }

    fn forget(&mut self) {
        self.restart();
    }
}

/// Runs a check on every method.
macro_rules! for_each_method {
    ($equation:expr, $check:expr) => {{
        let (equation, check) = ($equation, $check);
        check(Method::Rk4, &mut Rk4::<f64>::default() as &mut dyn Stepped);
        check(Method::Dop853, &mut dop853());
        check(Method::ImplicitMidpoint, &mut midpoint(equation));
        check(Method::Radau5, &mut radau5(equation));
        check(Method::Rosenbrock, &mut rosenbrock(equation));
    }};
}

/// The error of v at t = 2 after this number of equal steps.
fn error(integrator: &mut dyn Stepped, steps: u32) -> f64 {
    let h = 2.0 / f64::from(steps);
    integrator.forget();
    let end = (0..steps)
        .fold(state(0.0, 1.0), |y, k| integrator.one_step(Equation::BENT, (h * f64::from(k), h), &y));
    (end[1] - 0.2).abs()
}

#[test]
fn each_method_has_its_order() {
    for_each_method!(Equation::BENT, |method, integrator: &mut dyn Stepped| {
        let (steps, within) = match method {
            Method::Rk4 | Method::Rosenbrock => (80, 0.2),
            Method::Dop853 => (12, 0.5),
            Method::ImplicitMidpoint => (80, 0.1),
            Method::Radau5 => (20, 0.2),
        };
        let order = f64::from(method.entry().order);
        let observed = (error(integrator, steps) / error(integrator, 2 * steps)).log2();
        assert!((observed - order).abs() < within, "{method:?} {observed}");
    });
}

/// The eigenvalues z of x'' = -k x - d x' solve z^2 + d z + k = 0. A step multiplies their eigenvectors by
/// R(z).
#[test]
fn each_stability_function_is_reproduced_to_round_off() {
    let pairs = [(-0.3, 0.0), (-0.2, 0.7), (-2.0, 0.0), (0.0, 2.5), (-1.0, 1.0)];
    for (re, im) in pairs {
        let z = Complex::new(re, im);
        // A conjugate pair, or a real eigenvalue with a zero beside it.
        let equation =
            if im == 0.0 { Equation::linear(0.0, -re) } else { Equation::linear(-z.norm_sqr(), -2.0 * re) };
        for_each_method!(equation, |method: Method, integrator: &mut dyn Stepped| {
            // The real part of the eigenvector (1, z) becomes the real part of R(z) (1, z).
            let end = integrator.one_step(equation, (0.0, 1.0), &state(1.0, z.re));
            let r = (method.entry().stability_function)(z);
            let expected = [r.re, (r * z).re];
            for (end, expected) in end.iter().zip(expected) {
                // DOP853 has coefficients up to 43, which magnify round-off.
                let round_off = if method == Method::Dop853 { 2e-13 } else { 1e-14 };
                assert!((end - expected).abs() < round_off, "{method:?} {z} {end} {expected}");
            }
        });
    }
}

/// An infinitely stiff mode is gone after one step.
#[test]
fn radau5_and_rosenbrock_are_l_stable_and_the_midpoint_rule_is_not() {
    let left = |integrator: &mut dyn Stepped, equation| {
        integrator.one_step(equation, (0.0, 1.0), &state(0.0, 1.0))[1]
    };
    for z in [1e4, 1e8, 1e12] {
        let equation = Equation::linear(0.0, z);
        assert!(left(&mut radau5(equation), equation).abs() < 10.0 / z);
        assert!(left(&mut rosenbrock(equation), equation).abs() < 10.0 / z);
        assert!(left(&mut midpoint(equation), equation) < -0.99);
    }
    // No mode grows anywhere in the left half-plane, because |R| <= 1 on its edge.
    for method in [Method::Radau5, Method::Rosenbrock, Method::ImplicitMidpoint] {
        for k in -60..60 {
            let z = Complex::new(0.0, 10f64.powf(f64::from(k) / 10.0));
            assert!((method.entry().stability_function)(z).modulus() <= 1.0 + 1e-14, "{method:?} {z}");
        }
    }
}

/// A mode decays just inside the stated limit and grows just outside of it.
#[test]
fn the_real_stability_limits_are_sharp() {
    for (_, method) in METHODS {
        let Some(limit) = method.entry().real_stability_limit else { continue };
        let growth =
            |share: f64| (method.entry().stability_function)(Complex::new(-share * limit, 0.0)).modulus();
        assert!(growth(0.9999) < 1.0, "{method:?}");
        assert!(growth(1.0001) > 1.0, "{method:?}");
    }
}

/// On rays into the left half-plane |R| <= 1 up to the stated step, and |R| > 1 just beyond it.
#[test]
fn the_longest_stable_step_ends_where_a_mode_begins_to_grow() {
    for (_, method) in METHODS {
        for k in 0..=20 {
            let angle = std::f64::consts::PI * (0.5 + 0.5 * f64::from(k) / 20.0);
            let rate = Complex::new((3e4 * libm::cos(angle)).min(0.0), 3e4 * libm::sin(angle));
            let h = method.longest_stable_step(rate);
            assert_eq!(h.is_infinite(), method.entry().real_stability_limit.is_none(), "{method:?}");
            if h.is_finite() {
                assert!((1..100).all(|k| {
                    (method.entry().stability_function)(rate * (h * f64::from(k) / 100.0)).modulus()
                        <= 1.0 + 1e-9
                }));
                assert!(
                    (method.entry().stability_function)(rate * (1.001 * h)).modulus() > 1.0,
                    "{method:?} {rate}"
                );
            }
        }
        assert!(method.longest_stable_step(Complex::new(1.0, 5.0)).is_infinite());
        assert!(method.longest_stable_step(Complex::new(0.0, 0.0)).is_infinite());
    }
    let real = Method::Rk4.longest_stable_step(Complex::new(-2.0, 0.0));
    assert!((real - 0.5 * Method::Rk4.entry().real_stability_limit.unwrap()).abs() < 1e-6);
    // Hairer and Wanner IV.2: RK4 reaches 2 sqrt(2) on the imaginary axis.
    let oscillation = Method::Rk4.longest_stable_step(Complex::new(0.0, 1.0));
    assert!((oscillation - 8.0_f64.sqrt()).abs() < 1e-6, "{oscillation}");
}

/// The largest error of the dense output inside steps of length `h` that begin at several times, and the
/// largest error estimate of these steps.
fn inside(method: &mut impl Adaptive<f64, Equation>, h: f64) -> (f64, f64) {
    let (equation, drive) = (Equation::BENT, clock());
    let exact = |t: f64| 1.0 / (1.0 + t * t);
    let mut largest = (0.0_f64, 0.0_f64);
    for tau in [0.0, 0.2, 0.5, 0.8, 1.2] {
        let y = state(0.0, exact(tau));
        let rate = rate(&equation, tau, &y);
        // An allowed error of one makes the estimate absolute. The step itself is solved to round-off.
        let allowed = Allowed { tolerance: 1.0, weights: [1.0; MAX_COMPONENTS] };
        let (system, drive) = (&equation, &drive);
        let step = Step { system, drive, tau, h, y: &y, rate: &rate, allowed: Some(&allowed) };
        let fixed = Step { allowed: None, ..step };
        let mut stats = Stats::default();
        method.restart();
        let mut next = y;
        method.step(&fixed, &mut next, &mut stats).unwrap();
        largest.1 = largest.1.max(method.error(&step, 0, &mut stats));
        method.prepare(&step, &next, &mut stats);
        for k in 0..=16 {
            let x = f64::from(k) / 16.0;
            let error = method.interpolate(&y, &next, x)[1] - exact(tau + x * h);
            largest.0 = largest.0.max(error.abs());
        }
        // The dense output passes through both ends of the step.
        assert!((method.interpolate(&y, &next, 0.0)[1] - y[1]).abs() < 1e-15);
        assert!((method.interpolate(&y, &next, 1.0)[1] - next[1]).abs() < 1e-15);
    }
    largest
}

#[test]
fn dense_output_and_error_estimates_have_their_orders() {
    fn check(name: &str, mut method: impl Adaptive<f64, Equation>, order: f64, estimate: f64, h: f64) {
        let (coarse, fine) = (inside(&mut method, h), inside(&mut method, h / 2.0));
        let observed = ((coarse.0 / fine.0).log2(), (coarse.1 / fine.1).log2());
        let close = |observed: f64, order: f64| order - 0.4 < observed && observed < order + 0.8;
        assert!(close(observed.0, order), "{name}: dense output {observed:?} {coarse:?}");
        assert!(close(observed.1, estimate), "{name}: estimate {observed:?} {coarse:?}");
    }
    // Over a single step the error is one order higher.
    check("dop853", dop853(), 8.0, 8.0, 0.2);
    check("radau5", radau5(Equation::BENT), 4.0, 4.0, 0.1);
    check("rosenbrock", rosenbrock(Equation::BENT), 4.0, 4.0, 0.05);
}
