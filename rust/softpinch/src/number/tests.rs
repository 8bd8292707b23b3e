//! Every kind of lanes gives each lane the bits that the lane has alone.

use crate::number::lanes::{Lanes, each};
use crate::number::linear::{LaneEntry, Lu, MOST_ROWS};
use crate::number::row::Row4;
use crate::number::simd::dispatch::{LaneKernel, dispatch_lanes};
use crate::number::simd::level::LEVELS;

/// Numbers of all magnitudes, among them signed zeros, a subnormal number, huge angles, infinity and NaN.
fn numbers(k: usize) -> f64 {
    const ODD: [f64; 8] = [0.0, -0.0, 1e-310, 3e8, -1e22, f64::INFINITY, f64::NAN, 1.0];
    let u = libm::sin(12.9898 * k as f64) * 43_758.547;
    if k % 7 == 3 { ODD[k / 7 % 8] } else { u * libm::pow(10.0, (k % 11) as f64 - 5.0) }
}

/// Applies every operation of lanes to three numbers.
fn everything<R: Lanes>(a: R, b: R, c: R) -> [R; 12] {
    let (sin, cos) = a.sin_cos();
    [
        a.mul_add(b, c),
        a.neg_mul_add(b, c),
        a / b,
        (a + b) * (b - c),
        -a,
        a.abs().sqrt(),
        sin,
        cos,
        a.max_in(b, R::ALL),
        a.min_in(b, R::ALL),
        R::select(a.less(b), b, c),
        R::select(a.at_most(b) | a.is_zero(), b, c),
    ]
}

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
}

/// Compares each lane with the result of the same operations on `f64`.
struct Compare;

impl LaneKernel for Compare {
    type Output = usize;

    #[inline(always)]
    fn run<R: Lanes>(self) -> usize {
        for start in 0..500 {
            let at = |shift: usize| move |lane: usize| numbers(3 * (start + lane) + shift);
            let (a, b, c) = (at(0), at(1), at(2));
            let together = everything(R::from_fn(a), R::from_fn(b), R::from_fn(c));
            for lane in 0..R::WIDTH {
                let alone = everything(a(lane), b(lane), c(lane));
                for (number, (ours, theirs)) in together.iter().zip(alone).enumerate() {
                    assert!(same(ours.lane(lane), theirs), "{number}: {} {theirs}", ours.lane(lane));
                }
            }
        }
        let entry = |r: usize, c: usize| move |lane: usize| libm::sin((1 + 9 * r + c + 100 * lane) as f64);
        let matrix: [[LaneEntry<R>; 9]; 9] =
            std::array::from_fn(|r| std::array::from_fn(|c| LaneEntry(R::from_fn(entry(r, c)))));
        let load: [LaneEntry<R>; 9] = std::array::from_fn(|r| LaneEntry(R::from_fn(entry(r, 9))));
        let together = Lu::new(MOST_ROWS, matrix).solve(MOST_ROWS, &load);
        for lane in 0..R::WIDTH {
            let matrix: [[f64; 9]; 9] = std::array::from_fn(|r| std::array::from_fn(|c| entry(r, c)(lane)));
            let load = std::array::from_fn(|r| entry(r, 9)(lane));
            let alone = Lu::new(MOST_ROWS, matrix).solve(MOST_ROWS, &load);
            for (ours, theirs) in together.iter().zip(alone) {
                assert_eq!(ours.0.lane(lane).to_bits(), theirs.to_bits());
            }
        }
        R::WIDTH
    }
}

#[test]
fn every_lane_gives_the_bits_of_a_lone_f64() {
    for (_, level) in LEVELS {
        match dispatch_lanes(level, Compare) {
            Ok(width) => {
                assert_eq!(Compare.run::<Row4>(), 4);
                assert!([4, 8].contains(&width));
            }
            Err(error) => assert_eq!(level.require().err(), Some(error)),
        }
    }
}

#[test]
fn the_lanes_of_a_set_come_in_order() {
    assert_eq!(each(0b1010_0110).collect::<Vec<_>>(), [1, 2, 5, 7]);
    assert_eq!(each(0).count(), 0);
}
