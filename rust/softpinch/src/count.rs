//! What a scene costs, counted: the operations of one evaluation of its equations and of one step, whichever processor runs
//! them.
//!
//! [`Counted`] numbers write down where they come from. What counts is what a compiler may not leave out: an operation whose
//! result is used, once for the same operands, and not where all of them are constants. Parameters, and inputs that a segment
//! holds constant, are constants here.

use std::cell::RefCell;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::convert::Infallible;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::energy::{Energies, closure};
use crate::error::Error;
use crate::formulation::{Chosen, Evaluation, Motion, Size, States, System};
use crate::inputs::SegmentDrive;
use crate::integrator::dop853::Dop853;
use crate::integrator::rk4::Rk4;
use crate::integrator::{Integrator, Method, Stats, Step};
use crate::lanes::{Bits, Lanes};
use crate::monitor::Limits;
use crate::real::Real;
use crate::simd::Instructions;
use crate::simulate::{Options, Scene};
use crate::stepping::batch::{finite, works};
use crate::trigonometry;

/// Kinds of operations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Operation {
    /// a + b or a - b.
    Add,
    /// a b.
    Multiply,
    /// a b + c, rounded once.
    Fused,
    /// a / b.
    Divide,
    /// The square root.
    Root,
    /// -a or |a|: of the sign bit, often done by the instruction that uses it.
    Sign,
    /// One of several numbers, by bits.
    Choose,
    /// Bits from two numbers.
    Compare,
}

/// The operations by their public names, with the roundings of each by which floating-point operations are counted and the
/// cycles that a current core takes from operands to result (Zen 4 and 5, Golden Cove; Fog, "Instruction tables").
pub const OPERATIONS: [(&str, u64, u64); 8] = [
    ("add", 1, 3),
    ("multiply", 1, 4),
    ("fused multiply-add", 2, 4),
    ("divide", 1, 13),
    ("square root", 1, 20),
    ("sign", 0, 1),
    ("choose", 0, 1),
    ("compare", 0, 3),
];

/// How many operations of each of [`OPERATIONS`].
pub type Tally = [u64; OPERATIONS.len()];

/// Operations that something takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Count {
    /// All of them.
    pub operations: Tally,
    /// Those of the chain that takes longest, each waiting for the one before: no processor is faster than that alone.
    pub chain: Tally,
}

impl Count {
    /// Floating-point operations, a fused multiply-add as two.
    #[must_use]
    pub fn flops(&self) -> u64 {
        self.operations.iter().zip(OPERATIONS).map(|(count, (_, flops, _))| count * flops).sum()
    }

    /// The cycles that the longest chain takes.
    #[must_use]
    pub fn latency(&self) -> u64 {
        self.chain.iter().zip(OPERATIONS).map(|(count, (_, _, cycles))| count * cycles).sum()
    }
}

/// Where a number comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Origin {
    /// A constant, by its bits.
    Constant(u64),
    /// Given, or the result of an operation: its place in the record.
    Place(usize),
}

const ZERO: Origin = Origin::Constant(0);

/// What has been computed.
#[derive(Default)]
struct Record {
    /// What each place holds the result of; `None` where it was given.
    places: Vec<Option<(Operation, [Origin; 3])>>,
    known: HashMap<(Operation, [Origin; 3]), usize>,
    /// Places whose bits were asked for: they are used.
    asked: Vec<usize>,
}

impl Record {
    fn result(&mut self, operation: Operation, operands: [Origin; 3]) -> usize {
        match self.known.entry((operation, operands)) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => {
                self.places.push(Some((operation, operands)));
                *new.insert(self.places.len() - 1)
            }
        }
    }

    /// The operations that these places, and those asked for, need.
    fn count(&self, used: impl Iterator<Item = usize>) -> Count {
        let mut needed = vec![false; self.places.len()];
        for place in used.chain(self.asked.iter().copied()) {
            needed[place] = true;
        }
        for place in (0..needed.len()).rev() {
            if let (true, Some((_, operands))) = (needed[place], self.places[place]) {
                for operand in operands {
                    if let Origin::Place(from) = operand {
                        needed[from] = true;
                    }
                }
            }
        }
        let mut total = Count::default();
        let mut chains = vec![Count::default(); needed.len()];
        for (place, held) in self.places.iter().enumerate() {
            let (true, &Some((operation, operands))) = (needed[place], held) else { continue };
            total.operations[operation as usize] += 1;
            let chain = operands.into_iter().filter_map(|operand| match operand {
                Origin::Place(from) => Some(chains[from]),
                Origin::Constant(_) => None,
            });
            let mut longest = chain.max_by_key(Count::latency).unwrap_or_default();
            longest.chain[operation as usize] += 1;
            chains[place] = longest;
            if longest.latency() > total.latency() {
                total.chain = longest.chain;
            }
        }
        total
    }
}

thread_local! {
    static RECORD: RefCell<Record> = RefCell::default();
}

/// The operations that the numbers need which `work` gives, and its comparisons.
pub fn count(work: impl FnOnce() -> Vec<Counted>) -> Count {
    RECORD.take();
    let used = work();
    let places = used.iter().filter_map(|number| match number.origin {
        Origin::Place(place) => Some(place),
        Origin::Constant(_) => None,
    });
    RECORD.take().count(places)
}

/// A number that knows where it comes from, for the length of one [`count`].
#[derive(Debug, Clone, Copy)]
pub struct Counted {
    value: f64,
    origin: Origin,
}

impl Counted {
    /// A number that is not known beforehand.
    #[must_use]
    pub fn given(value: f64) -> Self {
        let place = RECORD.with_borrow_mut(|record| {
            record.places.push(None);
            record.places.len() - 1
        });
        Self { value, origin: Origin::Place(place) }
    }

    #[inline(never)]
    fn result(operation: Operation, value: f64, operands: [Origin; 3]) -> Self {
        if operands.iter().all(|operand| matches!(operand, Origin::Constant(_))) {
            return Self::constant(value);
        }
        let place = RECORD.with_borrow_mut(|record| record.result(operation, operands));
        Self { value, origin: Origin::Place(place) }
    }

    /// Notes a comparison, whose bits are used.
    #[inline(never)]
    fn ask(self, other: Self, bit: bool) -> Bits {
        let compared =
            Self::result(Operation::Compare, f64::from(u8::from(bit)), [self.origin, other.origin, ZERO]);
        if let Origin::Place(place) = compared.origin {
            RECORD.with_borrow_mut(|record| record.asked.push(place));
        }
        Bits::from(bit)
    }
}

macro_rules! operator {
    ($($operator:ident, $name:ident, $operation:ident, $order:literal;)*) => {$(
        impl $operator for Counted {
            type Output = Self;
            #[inline(never)]
            fn $name(self, other: Self) -> Self {
                // The order tells a - b from a + b.
                let operands = [self.origin, other.origin, Origin::Constant($order)];
                Self::result(Operation::$operation, self.value.$name(other.value), operands)
            }
        }
    )*};
}
operator! { Add, add, Add, 0; Sub, sub, Add, 1; Mul, mul, Multiply, 0; Div, div, Divide, 0; }

impl Neg for Counted {
    type Output = Self;
    #[inline(never)]
    fn neg(self) -> Self {
        Self::result(Operation::Sign, -self.value, [self.origin, ZERO, ZERO])
    }
}

impl Real for Counted {
    fn constant(x: f64) -> Self {
        Self { value: x, origin: Origin::Constant(x.to_bits()) }
    }

    #[inline(never)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        let value = self.value.mul_add(a.value, b.value);
        Self::result(Operation::Fused, value, [self.origin, a.origin, b.origin])
    }

    #[inline(never)]
    fn sin_cos(self) -> (Self, Self) {
        trigonometry::sin_cos(self)
    }
}

impl Lanes for Counted {
    const WIDTH: usize = 1;

    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        Self::constant(f(0))
    }

    fn lane(self, _: usize) -> f64 {
        self.value
    }

    fn set(&mut self, _: usize, value: f64) {
        *self = Self::constant(value);
    }

    fn less(self, other: Self) -> Bits {
        self.ask(other, self.value < other.value)
    }

    fn at_most(self, other: Self) -> Bits {
        self.ask(other, self.value <= other.value)
    }

    #[inline(never)]
    fn select(bits: Bits, a: Self, b: Self) -> Self {
        let value = f64::select(bits, a.value, b.value);
        Self::result(Operation::Choose, value, [a.origin, b.origin, ZERO])
    }

    fn abs(self) -> Self {
        Self::result(Operation::Sign, self.value.abs(), [self.origin, Origin::Constant(1), ZERO])
    }

    fn sqrt(self) -> Self {
        Self::result(Operation::Root, self.value.sqrt(), [self.origin, ZERO, ZERO])
    }

    fn turned(turns: Self, sin: Self, cos: Self) -> (Self, Self) {
        let (s, c) = f64::turned(turns.value, sin.value, cos.value);
        (
            Self::result(Operation::Choose, s, [turns.origin, sin.origin, cos.origin]),
            Self::result(Operation::Choose, c, [turns.origin, cos.origin, sin.origin]),
        )
    }
}

/// What a scene takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cost {
    /// States that are stepped, the ledger's works among them.
    pub states: usize,
    /// Velocities that the equations are solved for.
    pub degrees: usize,
    /// One evaluation of the equations, with multipliers and residuals.
    pub evaluation: Count,
    /// One step: the evaluation at its start with the monitors, and the method's own. `None` of methods that solve equations.
    pub step: Option<Count>,
}

/// Counts what a scene takes in the inputs of its start.
pub fn scene(scene: &Scene, options: &Options) -> Result<Cost, Error> {
    let instructions = options.simd.require()?;
    let Size { degrees, .. } = Start::new(scene, options, instructions).system.size();
    let all = Start::new(scene, options, instructions).system.size().all();
    let evaluation = count(|| {
        let Start { system, drive, tau, y } = Start::new(scene, options, instructions);
        let Evaluation { rate, multipliers, residuals, .. } = system.evaluate(&drive, tau, &y);
        [&rate[..all], &multipliers, &residuals].concat()
    });
    let step = match options.method {
        Method::Rk4 => Some(step(scene, options, instructions, Rk4::new())),
        Method::Dop853 => Some(step(scene, options, instructions, Dop853::new())),
        Method::Rosenbrock | Method::ImplicitMidpoint | Method::Radau5 => None,
    };
    Ok(Cost { states: all, degrees, evaluation, step })
}

/// One step of a scene that is watched.
fn step(
    scene: &Scene,
    options: &Options,
    instructions: Instructions,
    mut method: impl Integrator<Counted, Chosen<Counted>, Failure = Infallible>,
) -> Count {
    count(|| {
        let Start { system, drive, tau, y } = Start::new(scene, options, instructions);
        let size = system.size();
        let now = system.evaluate(&drive, tau, &y);
        let open = if size.ledger {
            let zero = Counted::zero();
            let begun = Energies { kinetic: zero, elastic: zero, gravity: zero };
            closure(&begun, &system.energies(&now.motion), &works(size, &y))
        } else {
            Counted::zero()
        };
        finite(&now, open);
        Limits::<Counted>::new(&scene.parameters).violated(&now.motion.q, &now.sin_tilt, &now.multipliers);
        let h = Counted::given(1e-4);
        let at = Step { tau, h, y: &y, rate: &now.rate, allowed: None };
        let mut next = y;
        let Ok(()) = method.step(&system, &drive, &at, &mut next, &mut Stats::default());
        system.correct(&drive, tau + h, &mut next);
        next[..size.all()].to_vec()
    })
}

/// A scene's equations and inputs, and the instant that it starts at.
struct Start {
    system: Chosen<Counted>,
    drive: SegmentDrive<Counted>,
    tau: Counted,
    y: States<Counted>,
}

impl Start {
    fn new(scene: &Scene, options: &Options, instructions: Instructions) -> Self {
        let choice = options.choice(scene.inputs.fingers());
        let system = Chosen::new(instructions, choice, &scene.parameters, &options.stabilization);
        let mut drive = SegmentDrive::still();
        drive.set(0, &scene.inputs.segment(scene.initial.time));
        let initial = &scene.initial;
        let motion = Motion {
            q: initial.q.map(Counted::constant),
            p: initial.p.map(Counted::constant),
            memory: initial.memory.map(Counted::constant),
        };
        let mut y = system.begin(&motion);
        for number in &mut y[..system.size().all()] {
            *number = Counted::given(number.value);
        }
        Self { system, drive, tau: Counted::given(0.0), y }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Fingers;
    use crate::formulation::Formulation;
    use crate::inputs::{Inputs, Sinusoid};
    use crate::parameters::Parameters;
    use crate::start::{State, contact};

    fn parameters() -> Parameters {
        let (finger, pid) = ([0.0762, 0.049, 0.0045, 0.1, 5.8e-4], [100.0, 1.0, 1000.0]);
        let (right, left) =
            ([0.02, 3e5, 100.0, 100.0, 1.0, 0.1, 0.1], [0.0201, 2e5, 90.0, 80.0, 0.9, 0.2, 0.3]);
        let (object, surroundings) = ([0.049, 0.08, 4e-5, 0.0], [9.81, f64::INFINITY]);
        let other = [0.0761, 0.0491, 0.0046, 0.11, 5.9e-4];
        let values = [&finger[..], &other, &right, &left, &object, &pid, &[90.0, 0.9, 900.0], &surroundings];
        Parameters::from_array(&values.concat().try_into().unwrap()).unwrap()
    }

    fn still() -> Scene {
        let parameters = parameters();
        Scene {
            inputs: Inputs::hold([0.1, 0.08]),
            initial: State::at_rest(contact(&parameters).unwrap()),
            check: true,
            duration: 1.0,
            parameters,
        }
    }

    fn of(count: &Count, operation: Operation) -> u64 {
        count.operations[operation as usize]
    }

    #[test]
    fn what_is_used_counts_once_and_constants_do_not() {
        let counted = count(|| {
            let (x, y, c) = (Counted::given(2.0), Counted::given(3.0), Counted::constant(5.0));
            let product = x * y;
            let _unused = product / c;
            let again = x * y;
            vec![product.mul_add(c * c, again), product - x, x + product]
        });
        assert_eq!(counted.operations, [2, 1, 1, 0, 0, 0, 0, 0]);
        assert_eq!(counted.chain, [0, 1, 1, 0, 0, 0, 0, 0]);
        assert_eq!((counted.flops(), counted.latency()), (5, 8));
    }

    /// Counted by hand in `trigonometry::small` and `reduced`: each kernel squares its argument and works from there.
    #[test]
    fn a_sine_and_a_cosine_take_what_their_source_says() {
        let both = |angle: f64| {
            count(|| {
                let (sin, cos) = Counted::given(angle).sin_cos();
                vec![sin, cos]
            })
        };
        let sine = |angle: f64| count(|| vec![Counted::given(angle).sin_cos().0]);
        let (small, large) = (both(0.3), both(0.9));
        assert_eq!([of(&small, Operation::Divide), of(&large, Operation::Divide)], [0, 0]);
        assert_eq!([of(&small, Operation::Fused), of(&large, Operation::Fused)], [5 + 5, 4 + 7 + 6]);
        // The large one is compared with where the reduction ends, too.
        assert_eq!([of(&small, Operation::Compare), of(&large, Operation::Compare)], [1, 2]);
        assert!(sine(0.3).flops() < small.flops());
        assert_eq!(
            sine(0.9).flops(),
            large.flops(),
            "a quadrant is not known beforehand, so either takes both"
        );
    }

    #[test]
    fn values_are_those_of_plain_numbers() {
        let (scene, options) = (still(), Options::default());
        let instructions = options.simd.require().unwrap();
        let Start { system, drive, tau, y } = Start::new(&scene, &options, instructions);
        let counted = system.evaluate(&drive, tau, &y);
        let choice = options.choice(Fingers::Pid);
        let plain = Chosen::<f64>::new(instructions, choice, &scene.parameters, &options.stabilization);
        let alone = plain.evaluate(&scene.inputs.segment(0.0), 0.0, &y.map(|number| number.value));
        assert_eq!(counted.rate.map(|number| number.value.to_bits()), alone.rate.map(f64::to_bits));
    }

    #[test]
    fn a_step_of_rk4_is_four_evaluations_and_what_they_are_added_with() {
        for (formulation, divisions) in [(Formulation::Csm, 6), (Formulation::Nullspace, 7)] {
            let options = Options { formulation, ..Options::default() };
            let Cost { evaluation, step, .. } = scene(&still(), &options).unwrap();
            let step = step.unwrap();
            assert_eq!(of(&evaluation, Operation::Divide), divisions);
            assert_eq!(of(&step, Operation::Divide), 4 * divisions);
            assert!(step.flops() < 4 * evaluation.flops() + 400, "{} {}", step.flops(), evaluation.flops());
            assert!(step.latency() > 2 * evaluation.latency());
        }
    }

    #[test]
    fn a_wave_costs_a_sine_and_a_constant_nothing() {
        let (quiet, options) = (still(), Options::default());
        let wave = Sinusoid { start: 0.0, end: 1.0, omega: 9.0, phase: 0.1, amplitude: [1.0, 2.0, 0.0] };
        let schedule = crate::inputs::PiecewisePolynomial::constant([0.1, 0.08]).into();
        let inputs = Inputs::new(schedule, Vec::new(), vec![wave], Vec::new(), Vec::new()).unwrap();
        let waving = Scene { inputs, ..still() };
        let sine = count(|| vec![Counted::given(0.3).sin_cos().0]).flops();
        let (less, more) = (
            scene(&quiet, &options).unwrap().evaluation.flops(),
            scene(&waving, &options).unwrap().evaluation.flops(),
        );
        assert!((sine..sine + 20).contains(&(more - less)), "{less} {more} {sine}");
    }

    /// Driven fingers take the PID and the fingers' own rows out of `nullspace`; what is left of the object's system has the
    /// same masses along and across the face whatever the pose.
    #[test]
    fn driven_fingers_take_less() {
        let options = Options { formulation: Formulation::Nullspace, ..Options::default() };
        let turning = scene(&still(), &options).unwrap();
        let held = Scene { inputs: Inputs::hold([0.1, 0.08]).with_fingers(Fingers::Driven), ..still() };
        let driven = scene(&held, &options).unwrap();
        let divisions = |count: &Count| of(count, Operation::Divide);
        assert_eq!([turning.states, turning.degrees, driven.states, driven.degrees], [14, 5, 8, 3]);
        assert_eq!([divisions(&turning.evaluation), divisions(&driven.evaluation)], [7, 3]);
        let flops = |cost: &Cost| (cost.evaluation.flops(), cost.step.unwrap().flops());
        let (less, more) = (flops(&driven), flops(&turning));
        assert!(less.0 + 40 < more.0 && less.1 + 200 < more.1, "{less:?} {more:?}");
    }
}
