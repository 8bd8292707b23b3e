//! The most that one core of this machine does, at each level of instructions, for comparison with what the step loops do:
//! `cargo run --release --package softpinch --example peak`. Pin it to a core that is idle.

// Chains run in step: an index says so best.
#![allow(clippy::needless_range_loop)]

use std::hint::black_box;
use std::time::Instant;

use softpinch::error::Error;
use softpinch::number::lanes::{LaneTask, Lanes};
use softpinch::number::real::Real;
use softpinch::number::simd::dispatch::{LaneKernel, dispatch_lanes};
use softpinch::number::simd::level::{Instructions, LEVELS, Level};

/// Operations of each number between two looks at the clock.
const LENGTH: u64 = 200_000;
/// Looks at the clock, of which the shortest time counts: what else the machine does only adds.
const REPEATS: u32 = 200;

/// What is done over and over.
#[derive(Clone, Copy)]
enum Work {
    Fuse,
    Divide,
}

/// Nanoseconds that each operation takes on numbers of type `R`, with `CHAINS` of them side by side.
#[inline(always)]
fn time<R: Real, const CHAINS: usize>(work: Work) -> f64 {
    let small = R::constant(black_box(0.1));
    let mut shortest = f64::INFINITY;
    for _ in 0..REPEATS {
        let mut x = [R::constant(black_box(0.1)); CHAINS];
        let start = Instant::now();
        match work {
            Work::Fuse => {
                for _ in 0..LENGTH {
                    for k in 0..CHAINS {
                        // Neighbours differ and are entangled, or a compiler makes vectors of lone numbers.
                        let next = x[(k + 1) % CHAINS];
                        x[k] = if k % 2 == 0 { x[k].mul_add(next, small) } else { small.mul_add(x[k], next) };
                    }
                }
            }
            Work::Divide => {
                for _ in 0..LENGTH {
                    for k in 0..CHAINS {
                        x[k] = small / x[k];
                    }
                }
            }
        }
        shortest = shortest.min(start.elapsed().as_secs_f64());
        black_box(x);
    }
    1e9 * shortest / (LENGTH * CHAINS as u64) as f64
}

/// Prints what numbers of type `R` reach.
#[inline(always)]
fn report<R: Real>(name: &str, width: usize) {
    let (fused, waiting) = (time::<R, 12>(Work::Fuse), time::<R, 1>(Work::Fuse));
    let peak = 2.0 * width as f64 / fused;
    print!(
        "{name:<8} {width:>8} {peak:>9.1} {fused:>10.3} {waiting:>10.3} {:>10.3}",
        time::<R, 1>(Work::Divide)
    );
    // Of lone divisions side by side a compiler makes vectors.
    if width == 1 {
        println!("{:>11}", "-");
    } else {
        println!(" {:>10.3}", time::<R, 8>(Work::Divide));
    }
}

struct Alone;

impl LaneTask<f64> for Alone {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        report::<f64>("scalar", 1);
    }
}

struct Together(Level);

impl LaneKernel for Together {
    type Output = ();

    #[inline(always)]
    fn run<R: Lanes>(self, _: Instructions) {
        report::<R>(self.0.name(), R::WIDTH);
    }
}

fn main() -> Result<(), Error> {
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = cpu.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    println!("{}, one core", name.map_or("unknown processor", |(_, name)| name));
    println!("                     peak   multiply-add, ns           division, ns");
    println!("level       lanes  Gflop/s  side by side  in a chain");
    f64::call(Level::detect().require()?, Alone);
    for (_, level) in LEVELS.into_iter().filter(|(_, level)| level.is_available()) {
        dispatch_lanes(level, Together(level))?;
    }
    Ok(())
}
