//! Numbers that count the operations in which they take part, for `operations.rs`.
//!
//! [`Counted`] numbers record where they come from. An operation counts if a compiler cannot leave it out:
//! its result must be used, it counts once for the same operands, and not all of its operands may be
//! constants. Parameters are constants here, and so are inputs that a segment holds constant.

use std::cell::RefCell;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::number::real::Real;
use crate::number::trigonometry;
use crate::number::{Bits, Compose, LaneTask, Lanes};

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
    /// -a or |a|: a change of the sign bit, often done by the instruction that uses the result.
    Sign,
    /// The choice of one of several numbers by bits.
    Choose,
    /// A comparison of two numbers, which gives bits.
    Compare,
}

/// The operations by their public names. For each there is the number of floating-point operations that it
/// counts as, and the number of cycles from its operands to its result on a current core (Zen 4 and 5, Golden
/// Cove; Fog, "Instruction tables").
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

/// The number of operations of each kind of [`OPERATIONS`].
pub type Tally = [u64; OPERATIONS.len()];

/// The operations of a computation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Count {
    /// All operations.
    pub operations: Tally,
    /// The operations of the chain that takes longest, where each waits for the one before it. No processor
    /// is faster than this chain.
    pub chain: Tally,
}

impl Count {
    /// Floating-point operations; a fused multiply-add counts as two.
    pub fn flops(&self) -> u64 {
        self.operations.iter().zip(OPERATIONS).map(|(count, (_, flops, _))| count * flops).sum()
    }

    /// The cycles that the longest chain takes.
    pub fn latency(&self) -> u64 {
        self.chain.iter().zip(OPERATIONS).map(|(count, (_, _, cycles))| count * cycles).sum()
    }
}

/// The origin of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Origin {
    /// A constant, by its bits.
    Constant(u64),
    /// A given number or the result of an operation, by its place in the record.
    Place(usize),
}

const ZERO: Origin = Origin::Constant(0);

/// The record of a computation.
#[derive(Default)]
struct Record {
    /// For each place, the operation whose result it has; `None` for a given number.
    places: Vec<Option<(Operation, [Origin; 3])>>,
    known: HashMap<(Operation, [Origin; 3]), usize>,
    /// Places of comparisons. Their bits were asked for, so they count as used.
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

    /// The operations that the numbers at the places in `used`, and the comparisons, need.
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

/// Counts the operations of the numbers that `work` returns, and of its comparisons.
pub fn count(work: impl FnOnce() -> Vec<Counted>) -> Count {
    RECORD.take();
    let used = work();
    let places = used.iter().filter_map(|number| match number.origin {
        Origin::Place(place) => Some(place),
        Origin::Constant(_) => None,
    });
    RECORD.take().count(places)
}

/// A number that knows its origin. It is valid during one [`count`].
#[derive(Debug, Clone, Copy)]
pub struct Counted {
    value: f64,
    origin: Origin,
}

impl Counted {
    /// A number that is not known beforehand.
    pub fn given(value: f64) -> Self {
        let place = RECORD.with_borrow_mut(|record| {
            record.places.push(None);
            record.places.len() - 1
        });
        Self { value, origin: Origin::Place(place) }
    }

    /// The number itself.
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

    /// Notes a comparison. Its result counts as used.
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
                // The order distinguishes a - b from a + b.
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

impl Compose for Counted {}

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

    #[inline(never)]
    fn select(bits: Bits, a: Self, b: Self) -> Self {
        let value = f64::select(bits, a.value, b.value);
        Self::result(Operation::Choose, value, [a.origin, b.origin, ZERO])
    }

    fn less(self, other: Self) -> Bits {
        self.ask(other, self.value < other.value)
    }

    fn sqrt(self) -> Self {
        Self::result(Operation::Root, self.value.sqrt(), [self.origin, ZERO, ZERO])
    }

    fn angle(self, _: Self) -> Self {
        unreachable!("the paper's contacts have no arcs")
    }

    fn power(self, _: Self) -> Self {
        unreachable!("the paper's tips have no powers")
    }

    fn ln(self) -> Self {
        unreachable!("the paper's tips have no powers")
    }

    fn outlined<K: LaneTask<Self>>(task: K) -> K::Output {
        task.run()
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

    fn at_most(self, other: Self) -> Bits {
        self.ask(other, self.value <= other.value)
    }

    fn abs(self) -> Self {
        Self::result(Operation::Sign, self.value.abs(), [self.origin, Origin::Constant(1), ZERO])
    }

    fn rotate_quadrants(quadrants: Self, sin: Self, cos: Self) -> (Self, Self) {
        let (s, c) = f64::rotate_quadrants(quadrants.value, sin.value, cos.value);
        (
            Self::result(Operation::Choose, s, [quadrants.origin, sin.origin, cos.origin]),
            Self::result(Operation::Choose, c, [quadrants.origin, cos.origin, sin.origin]),
        )
    }
}

impl Count {
    /// The number of operations of one kind.
    pub fn of(&self, operation: Operation) -> u64 {
        self.operations[operation as usize]
    }
}

#[test]
fn used_operations_count_once_and_constants_do_not_count() {
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

/// The expected numbers are counted by hand in `sin_cos_small` and `sin_cos_reduced` of `trigonometry`. Each kernel starts from
/// the square of its argument.
#[test]
fn sine_and_cosine_take_the_operations_of_their_source() {
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
    // A large angle is also compared with the end of the reducible range.
    assert_eq!([small.of(Operation::Compare), large.of(Operation::Compare)], [1, 2]);
    assert!(sine(0.3).flops() < small.flops());
    assert_eq!(sine(0.9).flops(), large.flops(), "the quadrant is unknown, so each takes both kernels");
}
