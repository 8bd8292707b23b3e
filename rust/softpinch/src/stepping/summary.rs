//! Summaries: a few numbers that describe a run. They are computed while it is integrated, so that nothing of
//! its path has to be kept.
//!
//! A new summary is a type with `Fold` and a line in the list of [`SUMMARIES`] below. Summaries look at the
//! instants that the monitors watch.

use crate::formulation::Evaluation;
use crate::names::{named, set};
use crate::number::{Bits, Lanes};

/// The numbers that a summary keeps from one instant to the next.
pub(super) type Memory<R> = [R; 3];

/// One instant of the runs in all lanes.
pub(crate) struct SummaryInstant<'a, R> {
    pub t: R,
    pub now: &'a Evaluation<R>,
    /// The distance of slips since the start of the run, both contacts together, m.
    pub slipped: R,
    /// The closure error of the energy ledger, J, if the ledger is carried.
    pub closure: R,
    /// W / 2, m.
    pub half_width: R,
}

/// The end of a run, as far as summaries need it.
pub(crate) struct RunEnd {
    /// The first instant that the summaries look at: the start of the run, or a later instant, s.
    pub from: f64,
    pub completed: bool,
    pub holds: bool,
    /// The share of the run's duration that was left at its last instant.
    pub missing: f64,
    /// The time during which a tip was free, s.
    pub free_time: f64,
    /// The distance of slips since the start of the run, m.
    pub slipped: f64,
}

/// A number that is computed from the instants of a run, one after the other.
trait Fold {
    /// The memory before the first instant. While its first number is unchanged, no instant has been seen.
    const START: [f64; 3] = [NOTHING; 3];
    /// Whether the value has a derivative that means anything. Sums of times or errors do not follow the motion smoothly.
    const SMOOTH: bool = true;
    /// Takes an instant of the lanes in `seen`. Margins have a task of their own, which keeps the step loops small.
    #[inline(always)]
    fn watch<R: Lanes>(_memory: &mut Memory<R>, _: &SummaryInstant<'_, R>, _band: R, _seen: Bits) {}
    /// The value at the end of a run of which an instant was seen.
    fn value(memory: [f64; 3], _end: &RunEnd) -> f64 {
        memory[0]
    }
    /// The derivative of the value of a run that completes, from the memory and its derivatives; NaN if the value is not finite.
    fn slope(memory: [f64; 3], slopes: [f64; 3]) -> f64 {
        if memory[0].is_finite() { slopes[0] } else { f64::NAN }
    }
}

macro_rules! summaries {
    ($($(#[$doc:meta])* $kind:ident = $name:literal, $unit:literal;)*) => {
        named! {
            /// A summary.
            Summary;
            SUMMARIES = { $($(#[$doc])* $kind = $name,)* }
        }

        pub const COUNT: usize = SUMMARIES.len();

        /// The units of the summaries, in the same order.
        pub const UNITS: [&str; COUNT] = [$($unit),*];

        impl<R: Lanes> Summaries<R> {
            #[inline(always)]
            pub fn watch(&mut self, instant: &SummaryInstant<'_, R>, seen: Bits) {
                let seen = seen & self.after.at_most(instant.t);
                $(if self.wanted.set.contains(Summary::$kind) {
                    $kind::watch(&mut self.memory[Summary::$kind as usize], instant, self.band, seen);
                })*
            }

            #[inline(always)]
            pub fn restart(&mut self, lane: usize) {
                $(for (number, start) in self.memory[Summary::$kind as usize].iter_mut().zip($kind::START) {
                    number.set(lane, start);
                })*
            }

            /// The summaries of a lane, in the order of [`SUMMARIES`]; NaN where not asked for, or without an instant.
            pub fn values(&self, lane: usize, end: &RunEnd) -> [f64; COUNT] {
                let mut values = [f64::NAN; COUNT];
                $(if self.wanted.set.contains(Summary::$kind) {
                    let memory = self.memory[Summary::$kind as usize].map(|number| number.lane(lane));
                    if memory[0] != $kind::START[0] {
                        values[Summary::$kind as usize] = $kind::value(memory, end);
                    }
                })*
                values
            }
        }

        impl Summary {
            /// The derivative of the summary, from its memory and the derivatives of that; `None` if it means nothing.
            pub fn slope(self, memory: [f64; 3], slopes: [f64; 3]) -> Option<f64> {
                match self {
                    $(Self::$kind => $kind::SMOOTH.then(|| $kind::slope(memory, slopes)),)*
                }
            }

            /// Whether the summary has a derivative.
            pub fn is_differentiable(self) -> bool {
                self.slope([0.0; 3], [0.0; 3]).is_some()
            }
        }

        $($(#[$doc])* struct $kind;)*
    };
}

summaries! {
    /// The largest |theta| of the object.
    PeakRotation = "peak_rotation", "rad";
    /// The smallest d_n of both tips.
    MinCompression = "min_compression", "m";
    /// The largest angle of a contact's force from its normal, atan2(|lambda^N|, lambda^H): above 90 degrees where a tip pulls.
    PeakFrictionAngle = "peak_friction_angle", "rad";
    /// The largest coefficient of friction that a contact needs, |lambda^N| / lambda^H: infinite where a tip pulls.
    PeakFrictionRatio = "peak_friction_ratio", "1";
    /// The time during which a tip pulls.
    PullingTime = "pulling_time", "s";
    /// The time after which the object's faces move no faster than the band.
    SettlingTime = "settling_time", "s";
    /// The largest |C| of the four constraints, C^H in m and C^N in m/s.
    MaxResidual = "max_residual", "m or m/s";
    /// The largest closure error of the energy ledger.
    EnergyClosure = "energy_closure", "J";
    /// The largest |torque| on either finger.
    PeakTorque = "peak_torque", "N m";
    /// The distance over which the object's faces slip over the tips, both contacts together. Bilateral contact never slips.
    SlipDistance = "slip_distance", "m";
    /// The time during which a tip is free. Bilateral contact never opens.
    FreeTime = "free_time", "s";
    /// How far the grasp was from its loss: positive where it held, negative or zero where not.
    Margin = "margin", "1";
}

const NOTHING: f64 = f64::NEG_INFINITY;

/// A summary that is the largest size of some numbers.
macro_rules! largest {
    ($kind:ident, smooth: $smooth:literal, $instant:ident => $numbers:expr) => {
        impl Fold for $kind {
            const SMOOTH: bool = $smooth;

            #[inline(always)]
            fn watch<R: Lanes>(memory: &mut Memory<R>, $instant: &SummaryInstant<'_, R>, _: R, seen: Bits) {
                for number in $numbers {
                    memory[0] = memory[0].max_in(number.abs(), seen);
                }
            }
        }
    };
}
largest! { PeakRotation, smooth: true, instant => [instant.now.motion.q.object[2]] }
largest! { MaxResidual, smooth: false, instant => instant.now.residuals }
largest! { EnergyClosure, smooth: false, instant => [instant.closure] }
largest! { PeakTorque, smooth: true, instant => instant.now.torque }

impl Fold for MinCompression {
    const START: [f64; 3] = [f64::INFINITY; 3];

    #[inline(always)]
    fn watch<R: Lanes>(memory: &mut Memory<R>, instant: &SummaryInstant<'_, R>, _: R, seen: Bits) {
        let [right, left] = instant.now.motion.q.compression;
        memory[0] = memory[0].min_in(right, seen).min_in(left, seen);
    }
}

/// The memory has the force with the largest angle. Angles are compared by 1 - x / (|x| + y), which grows
/// with the angle of (x, y) from 0 to 2 over the upper half plane.
impl Fold for PeakFrictionAngle {
    #[inline(always)]
    fn watch<R: Lanes>(memory: &mut Memory<R>, instant: &SummaryInstant<'_, R>, _: R, seen: Bits) {
        for i in 0..2 {
            let (x, y) = (instant.now.multipliers[i], instant.now.multipliers[2 + i].abs());
            let place = R::constant(1.0) - x / (x.abs() + y);
            let larger = memory[0].less(place) & seen;
            *memory = [
                R::select(larger, place, memory[0]),
                R::select(larger, x, memory[1]),
                R::select(larger, y, memory[2]),
            ];
        }
    }

    fn value([_, x, y]: [f64; 3], _: &RunEnd) -> f64 {
        libm::atan2(y, x)
    }

    fn slope([_, x, y]: [f64; 3], [_, dx, dy]: [f64; 3]) -> f64 {
        (x * dy - y * dx) / (x * x + y * y)
    }
}

impl Fold for PeakFrictionRatio {
    #[inline(always)]
    fn watch<R: Lanes>(memory: &mut Memory<R>, instant: &SummaryInstant<'_, R>, _: R, seen: Bits) {
        for i in 0..2 {
            let (normal, tangential) = (instant.now.multipliers[i], instant.now.multipliers[2 + i].abs());
            let free = normal.is_zero() & tangential.is_zero();
            let ratio = R::select(free, R::zero(), tangential / normal.abs());
            let ratio = R::select(normal.less(R::zero()), R::constant(f64::INFINITY), ratio);
            memory[0] = memory[0].max_in(ratio, seen);
        }
    }
}

/// The time between two instants counts by half for each of them at which a tip pulls. The memory has the time, the last
/// instant, and the half that counts from there.
impl Fold for PullingTime {
    const START: [f64; 3] = [NOTHING, 0.0, 0.0];
    const SMOOTH: bool = false;

    #[inline(always)]
    fn watch<R: Lanes>(memory: &mut Memory<R>, instant: &SummaryInstant<'_, R>, _: R, seen: Bits) {
        let ([so_far, last, before], zero) = (*memory, R::zero());
        let pulls = instant.now.multipliers[0].less(zero) | instant.now.multipliers[1].less(zero);
        let half = R::select(pulls, R::constant(0.5), zero);
        let sum = (instant.t - last).mul_add(before + half, so_far);
        memory[0] = R::select(seen, R::select(so_far.less(zero), zero, sum), so_far);
        memory[1] = R::select(seen, instant.t, last);
        memory[2] = R::select(seen, half, before);
    }
}

/// The memory has the last instant, and the last instant with motion faster than the band. The speed is the
/// root mean square over the middles of both faces.
impl Fold for SettlingTime {
    const SMOOTH: bool = false;

    #[inline(always)]
    fn watch<R: Lanes>(memory: &mut Memory<R>, instant: &SummaryInstant<'_, R>, band: R, seen: Bits) {
        let [u, v, omega] = instant.now.motion.p.object;
        let by_rotation = instant.half_width * omega;
        let square = by_rotation.mul_add(by_rotation, u.dot2(u, v, v));
        let fast = (band * band).less(square) & seen;
        memory[0] = R::select(seen, instant.t, memory[0]);
        memory[1] = R::select(fast, instant.t, memory[1]);
    }

    fn value([last, fast, _]: [f64; 3], end: &RunEnd) -> f64 {
        match fast {
            _ if !end.completed || fast == last => f64::INFINITY,
            _ if fast == NOTHING => 0.0,
            _ => fast - end.from,
        }
    }
}

/// The method integrates the distance with the motion. The memory has that of the first instant.
impl Fold for SlipDistance {
    const SMOOTH: bool = false;

    #[inline(always)]
    fn watch<R: Lanes>(memory: &mut Memory<R>, instant: &SummaryInstant<'_, R>, _: R, seen: Bits) {
        memory[0] = R::select(seen & memory[0].less(R::zero()), instant.slipped, memory[0]);
    }

    fn value([first, ..]: [f64; 3], end: &RunEnd) -> f64 {
        end.slipped - first
    }
}

/// The events know the time to the round-off of their own times. The memory only says that an instant was seen.
impl Fold for FreeTime {
    const SMOOTH: bool = false;

    #[inline(always)]
    fn watch<R: Lanes>(memory: &mut Memory<R>, _: &SummaryInstant<'_, R>, _: R, seen: Bits) {
        memory[0] = R::select(seen, R::zero(), memory[0]);
    }

    fn value(_: [f64; 3], end: &RunEnd) -> f64 {
        end.free_time
    }
}

/// The memory has by how much the grasp holds at the last instant, and the smallest distance from its loss. A run that
/// ended early has a value even if no instant was seen.
impl Fold for Margin {
    const START: [f64; 3] = [f64::NAN, f64::INFINITY, 0.0];

    /// What was beyond and what was missing add up. Round-off does not decide the sign: the run knows whether it held.
    fn value([at_end, distance, _]: [f64; 3], end: &RunEnd) -> f64 {
        let margin = match end.completed {
            true if at_end.is_nan() => return f64::NAN,
            true => distance.min(at_end),
            false => distance.min(0.0) - end.missing,
        };
        if end.holds { margin.max(f64::MIN_POSITIVE) } else { margin.min(0.0) }
    }

    fn slope(memory: [f64; 3], slopes: [f64; 3]) -> f64 {
        let smaller = usize::from(memory[0] >= memory[1]);
        if memory[smaller].is_finite() { slopes[smaller] } else { f64::NAN }
    }
}

/// Takes the two margins of an instant of the lanes in `seen`.
#[inline(always)]
pub(super) fn take_margins<R: Lanes>(memory: &mut Memory<R>, [distance, at_end]: [R; 2], seen: Bits) {
    memory[0] = R::select(seen, at_end, memory[0]);
    memory[1] = memory[1].min_in(distance, seen);
}

set! {
    SummarySet of Summary
}

/// The summaries to compute, and their settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// The summaries.
    pub set: SummarySet,
    /// Instants before this one are left out, s.
    pub after: f64,
    /// The speed below which the object has settled, m/s.
    pub band: f64,
}

impl Default for Wanted {
    fn default() -> Self {
        Self { set: SummarySet::default(), after: f64::NEG_INFINITY, band: 1e-3 }
    }
}

/// The summaries of the runs in all lanes while they are computed.
pub(crate) struct Summaries<R> {
    pub wanted: Wanted,
    pub after: R,
    band: R,
    /// The numbers that each summary keeps.
    pub memory: [Memory<R>; COUNT],
}

impl<R: Lanes> Summaries<R> {
    pub fn new(wanted: &Wanted) -> Self {
        let mut summaries = Self {
            wanted: *wanted,
            after: R::constant(wanted.after),
            band: R::constant(wanted.band),
            memory: [[R::zero(); 3]; COUNT],
        };
        for lane in 0..R::WIDTH {
            summaries.restart(lane);
        }
        summaries
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::motion::Motion;
    use crate::number::row::Row4;

    /// An instant of the runs in all lanes, with its evaluation.
    #[derive(Debug, Clone, Copy)]
    struct Own<R> {
        t: R,
        now: Evaluation<R>,
        slipped: R,
        closure: R,
        half_width: R,
        margins: [R; 2],
    }

    impl<R: Lanes> Own<R> {
        fn instant(&self) -> SummaryInstant<'_, R> {
            let Self { t, ref now, slipped, closure, half_width, .. } = *self;
            SummaryInstant { t, now, slipped, closure, half_width }
        }
    }

    /// An instant of one run, and whether the loop watches it.
    type Watched = (Own<f64>, bool);

    fn instants() -> impl Strategy<Value = Vec<Watched>> {
        let numbers = proptest::array::uniform32(-2.0..2.0f64);
        proptest::collection::vec((0.01..0.5f64, numbers, any::<bool>()), 0..12).prop_map(|rows| {
            let mut t = 0.0;
            let instant = |(dt, x, seen): (f64, [f64; 32], bool)| {
                t += dt;
                let q = std::array::from_fn(|n| x[n]).into();
                let p = std::array::from_fn(|n| 1e-3 * x[9 + n]).into();
                let now = Evaluation {
                    motion: Motion { q, p, ..Motion::zero() },
                    multipliers: std::array::from_fn(|n| x[18 + n]),
                    residuals: std::array::from_fn(|n| x[22 + n]),
                    torque: [x[29], x[30]],
                    ..Evaluation::nothing()
                };
                let (slipped, half_width, margins) = (x[26].abs(), x[28].abs(), [x[29], x[31]]);
                (Own { t, now, slipped, closure: x[27], half_width, margins }, seen)
            };
            rows.into_iter().map(instant).collect()
        })
    }

    /// The summaries of a list of instants, each by its definition.
    fn by_definition(seen: &[Own<f64>], end: &RunEnd) -> [f64; COUNT] {
        let mut values = [f64::NAN; COUNT];
        let Some(last) = seen.last() else {
            if !end.completed {
                values[Summary::Margin as usize] = -end.missing;
            }
            return values;
        };
        let largest = |of: &dyn Fn(&Own<f64>) -> f64| seen.iter().map(of).fold(NOTHING, f64::max);
        let tips =
            |now: &Own<f64>| [0, 1].map(|i| (now.now.multipliers[i], now.now.multipliers[2 + i].abs()));
        let worst = |of: fn((f64, f64)) -> f64| {
            largest(&move |now| tips(now).map(of).into_iter().fold(NOTHING, f64::max))
        };
        let integral = |of: &dyn Fn(&Own<f64>) -> f64| {
            seen.windows(2)
                .map(|pair| 0.5 * (of(&pair[0]) + of(&pair[1])) * (pair[1].t - pair[0].t))
                .sum::<f64>()
        };
        let pulls = |now: &Own<f64>| f64::from(tips(now).iter().any(|&(normal, _)| normal < 0.0));
        let speed = |now: &Own<f64>| {
            let [u, v, omega] = now.now.motion.p.object;
            let turn = now.half_width * omega;
            (u * u + v * v + turn * turn).sqrt()
        };
        let moving = seen.iter().rev().find(|now| speed(now) > 1e-3).map(|now| now.t);
        for (kind, value) in [
            (Summary::PeakRotation, largest(&|now| now.now.motion.q.object[2].abs())),
            (
                Summary::MinCompression,
                -largest(&|now| -now.now.motion.q.compression[0].min(now.now.motion.q.compression[1])),
            ),
            (Summary::PeakFrictionAngle, worst(|(normal, tangential)| tangential.atan2(normal))),
            (
                Summary::PeakFrictionRatio,
                worst(|(normal, tangential)| if normal < 0.0 { f64::INFINITY } else { tangential / normal }),
            ),
            (Summary::PullingTime, integral(&pulls)),
            (
                Summary::SettlingTime,
                match moving {
                    _ if !end.completed || moving == Some(last.t) => f64::INFINITY,
                    None => 0.0,
                    Some(t) => t - end.from,
                },
            ),
            (
                Summary::MaxResidual,
                largest(&|now| now.now.residuals.into_iter().map(f64::abs).fold(0.0, f64::max)),
            ),
            (Summary::EnergyClosure, largest(&|now| now.closure.abs())),
            (Summary::PeakTorque, largest(&|now| now.now.torque[0].abs().max(now.now.torque[1].abs()))),
            (Summary::SlipDistance, end.slipped - seen[0].slipped),
            (Summary::FreeTime, end.free_time),
            (
                Summary::Margin,
                match -largest(&|now| -now.margins[0]) {
                    distance if !end.completed => distance.min(0.0) - end.missing,
                    distance if end.holds => distance.min(last.margins[1]).max(0.0),
                    distance => distance.min(last.margins[1]).min(0.0),
                },
            ),
        ] {
            values[kind as usize] = value;
        }
        values
    }

    proptest! {
        /// Lanes that see different instants at different times, or none, do not touch each other.
        #[test]
        fn summaries_of_each_lane_are_those_of_its_list(
            runs in proptest::collection::vec(instants(), 4),
            after in 0.0..2.0f64,
            completed in any::<bool>(),
            kept in any::<bool>(),
        ) {
            let set = SUMMARIES.into_iter().map(|(_, summary)| summary).collect();
            let wanted = Wanted { set, after, band: 1e-3 };
            let mut summaries = Summaries::<Row4>::new(&wanted);
            for k in 0..12 {
                // A lane whose list has ended repeats its last instant, which is not watched.
                let own = |lane: usize| runs[lane].get(k).or(runs[lane].last());
                let number = |of: &dyn Fn(&Own<f64>) -> f64| {
                    Row4::from_fn(|lane| own(lane).map_or(0.0, |(instant, _)| of(instant)))
                };
                let q = std::array::from_fn(|n| number(&|own| own.now.motion.q.row()[n])).into();
                let p = std::array::from_fn(|n| number(&|own| own.now.motion.p.row()[n])).into();
                let now = Evaluation {
                    motion: Motion { q, p, ..Motion::zero() },
                    multipliers: std::array::from_fn(|n| number(&|own| own.now.multipliers[n])),
                    residuals: std::array::from_fn(|n| number(&|own| own.now.residuals[n])),
                    torque: std::array::from_fn(|n| number(&|own| own.now.torque[n])),
                    ..Evaluation::nothing()
                };
                let instant = Own {
                    t: number(&|own| own.t),
                    now,
                    slipped: number(&|own| own.slipped),
                    closure: number(&|own| own.closure),
                    half_width: number(&|own| own.half_width),
                    margins: [0, 1].map(|n| number(&|own| own.margins[n])),
                };
                let seen = |lane: usize| runs[lane].get(k).is_some_and(|&(_, seen)| seen);
                let seen = (0..4).fold(0, |bits, lane| bits | Bits::from(seen(lane)) << lane);
                summaries.watch(&instant.instant(), seen);
                let memory = &mut summaries.memory[Summary::Margin as usize];
                take_margins(memory, instant.margins, seen & summaries.after.at_most(instant.t));
            }
            let end = RunEnd { from: after, completed, holds: completed && kept, missing: 0.375, free_time: 0.25, slipped: 3.0 };
            for (lane, run) in runs.iter().enumerate() {
                let counts = |&&(instant, seen): &&Watched| seen && instant.t >= after;
                let list: Vec<_> = run.iter().filter(counts).map(|&(instant, _)| instant).collect();
                let expected = by_definition(&list, &end);
                for ((name, _), (found, expected)) in
                    SUMMARIES.into_iter().zip(summaries.values(lane, &end).into_iter().zip(expected))
                {
                    let close = (found - expected).abs() <= 1e-12 * expected.abs().max(1.0);
                    let agree = close || found == expected || found.is_nan() && expected.is_nan();
                    prop_assert!(agree, "{} {} {}", name, found, expected);
                }
            }
        }
    }
}
