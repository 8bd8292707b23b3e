//! lab
use std::time::Instant;
use softpinch::ensemble::ensemble;
use softpinch::error::Error;
use softpinch::formulation::Formulation;
use softpinch::inputs::{Inputs, PiecewisePolynomial};
use softpinch::parameters::Parameters;
use softpinch::simd::Level;
use softpinch::simulate::{Options, Scene, Steps, simulate};
use softpinch::start::{State, contact};
const OPERATIONS: [[f64; 2]; 8] = [[6.0, 6.0],[20.0, -10.0],[-2.0, 13.0],[-10.0, 20.0],[-7.0, 17.0],[17.0, -7.0],[-15.0, 25.0],[5.0, 5.0]];
fn scene(run: usize) -> Result<Scene, Error> {
    let mut parameters = Parameters::default();
    parameters.tips[0].youngs_modulus *= 1.0 + 0.001 * (run % 64) as f64;
    let parameters = parameters.checked()?;
    let angles = OPERATIONS.map(|pair| pair.map(f64::to_radians));
    let times = [0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875];
    let schedule = PiecewisePolynomial::steps("schedule", angles[0], &times, &angles)?;
    Ok(Scene { initial: State::at_rest(contact(&parameters)?), parameters,
        inputs: Inputs::new(schedule.into(), vec![], vec![], vec![], vec![])?, check: true, duration: 1.0 })
}
fn main() -> Result<(), Error> {
    for (name, formulation) in [("csm", Formulation::Csm), ("nullspace", Formulation::Nullspace)] {
        for level in [Level::Avx2, Level::Avx512] {
            let options = Options { steps: Steps::Fixed(1e-4), formulation, simd: level, stop_on: Default::default(), ..Options::default() };
            let mut best = f64::INFINITY; let mut sum = 0.0;
            for _ in 0..9 {
                let start = Instant::now();
                let rows = ensemble(&scene, 64, &options, 1, &mut |_| false)?;
                best = best.min(start.elapsed().as_secs_f64());
                let steps: u64 = rows.iter().map(|r| r.steps).sum(); assert_eq!(steps, 640_000);
                sum = rows.iter().map(|r| r.q[2]).sum();
            }
            let mut alone = f64::INFINITY;
            for _ in 0..9 {
                let start = Instant::now();
                let mut o = options.clone(); o.every = 1_000_000;
                let _ = simulate(&scene(0)?, &o, &|| false)?;
                alone = alone.min(start.elapsed().as_secs_f64());
            }
            println!("{name:10} {level:?} lanes {:6.2} M steps/s   alone {:6.1} ns/step  check {sum:e}", 0.64 / best, alone * 1e5);
        }
    }
    Ok(())
}
