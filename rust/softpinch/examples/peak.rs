//! The peak performance of one core of this machine at each SIMD level, for comparison with the step loops:
//! `cargo run --release --package softpinch --example peak`. Pin it to an idle core.

// Loops over several chains at once are clearer with an index.
#![allow(clippy::needless_range_loop)]

use std::hint::black_box;
use std::time::Instant;

use softpinch::error::Error;
use softpinch::number::{LEVELS, LaneKernel, LaneTask, Lanes, Level, Real, dispatch_lanes};

/// Operations on each number between two readings of the clock.
const LENGTH: u64 = 200_000;
/// Number of measurements, of which the shortest counts: other work of the machine only adds time.
const REPEATS: u32 = 200;

/// The operation that is repeated.
#[derive(Clone, Copy)]
enum Work {
    Fuse,
    Divide,
}

/// Nanoseconds for each operation on numbers of type `R`, with `CHAINS` chains of operations side by side.
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
                        // Neighbouring chains differ and depend on each other; otherwise a compiler would
                        // make vectors of single numbers.
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

/// Prints the results for numbers of type `R`.
#[inline(always)]
fn report<R: Real>(name: &str, width: usize) {
    let (fused, waiting) = (time::<R, 12>(Work::Fuse), time::<R, 1>(Work::Fuse));
    let peak = 2.0 * width as f64 / fused;
    print!(
        "{name:<8} {width:>8} {peak:>9.1} {fused:>10.3} {waiting:>10.3} {:>10.3}",
        time::<R, 1>(Work::Divide)
    );
    // A compiler makes vectors of single divisions side by side, so there is no result for them.
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
    fn run<R: Lanes>(self) {
        report::<R>(self.0.name(), R::WIDTH);
    }
}

fn main() -> Result<(), Error> {
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = cpu.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    println!("{}, one core", name.map_or("unknown processor", |(_, name)| name));
    println!("                     peak   multiply-add, ns           division, ns");
    println!("level       lanes  Gflop/s  side by side  in a chain");
    f64::outlined(Alone);
    for (_, level) in LEVELS.into_iter().filter(|(_, level)| level.is_available()) {
        dispatch_lanes(level, Together(level))?;
    }
    Ok(())
}
