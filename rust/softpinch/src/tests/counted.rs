//! Numbers that count the operations which they take part in, for `operations.rs`.
//!
//! [`Counted`] numbers write down where they come from. What counts is what a compiler may not leave out: an operation whose
//! result is used, once for the same operands, and not where all of them are constants. Parameters, and inputs that a segment
//! holds constant, are constants here.

use std::cell::RefCell;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::number::lanes::{Bits, Lanes};
use crate::number::real::Real;
use crate::number::trigonometry;

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

    /// The number itself.
    #[must_use]
    pub fn value(self) -> f64 {
        self.value
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

impl Count {
    /// How many of one kind.
    pub fn of(&self, operation: Operation) -> u64 {
        self.operations[operation as usize]
    }
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
    assert_eq!([small.of(Operation::Divide), large.of(Operation::Divide)], [0, 0]);
    assert_eq!([small.of(Operation::Fused), large.of(Operation::Fused)], [6 + 7, 4 + 7 + 6]);
    // The large one is compared with where the reduction ends, too.
    assert_eq!([small.of(Operation::Compare), large.of(Operation::Compare)], [1, 2]);
    assert!(sine(0.3).flops() < small.flops());
    assert_eq!(sine(0.9).flops(), large.flops(), "a quadrant is not known beforehand, so either takes both");
}
