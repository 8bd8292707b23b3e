//! The manipulation of the paper (VI-A): the fingers go through eight pairs of angles, one pair each second,
//! and turn the object between them. `cargo run --release --example paper` prints where each operation ends.

use std::time::Instant;

use softpinch::driver::simulate;
use softpinch::error::Error;
use softpinch::model::start::{State, contact};
use softpinch::model::{Coordinates, Inputs, Parameters, PiecewisePolynomial, Scene};
use softpinch::stepping::{Column, Options, Run, Steps};

/// Targets of the right and the left finger, degrees.
const OPERATIONS: [[f64; 2]; 8] = [
    [6.0, 6.0],
    [20.0, -10.0],
    [-2.0, 13.0],
    [-10.0, 20.0],
    [-7.0, 17.0],
    [17.0, -7.0],
    [-15.0, 25.0],
    [5.0, 5.0],
];

/// The manipulation, from point contact at rest and without disturbances.
pub fn manipulation() -> Result<Scene, Error> {
    // The paper's parameters are lost, so these are ours. Other parameters are written as `Parameters {
    // grasped, ..Parameters::default() }`.
    let parameters = Parameters::default().checked()?;
    let angles = OPERATIONS.map(|pair| pair.map(f64::to_radians));
    let times = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let schedule = PiecewisePolynomial::steps("schedule", angles[0], &times, &angles)?;
    let (forces, sines, impulses, noises) = (vec![], vec![], vec![], vec![]);
    Ok(Scene {
        initial: State::at_rest(contact(&parameters)?),
        parameters,
        inputs: Inputs::new(schedule.into(), forces, sines, impulses, noises)?,
        check: true,
        duration: 8.0,
    })
}

/// Runs the manipulation by RK4 and the paper's constraint stabilisation, with a row each second.
pub fn run() -> Result<Run, Error> {
    let options = Options { steps: Steps::Fixed(1e-4), every: 10_000, ..Options::default() };
    // This caller never interrupts the run. It ignores the advice on stability that comes with the run.
    let (run, _) = simulate(&manipulation()?, &options, &|| false)?;
    Ok(run)
}

fn main() -> Result<(), Error> {
    let start = Instant::now();
    let run = run()?;
    let spent = start.elapsed();

    println!("  t, s     x, mm     y, mm  theta, deg  d_n1, mm  d_n2, mm");
    for (t, &q) in run.recording.t().iter().zip(run.recording.rows::<9>(Column::Q)) {
        let Coordinates { object: [x, y, theta], compression, .. } = Coordinates::from(q);
        let [x, y, right, left] = [x, y, compression[0], compression[1]].map(|length| 1e3 * length);
        println!("{t:6.1} {x:9.3} {y:9.3} {:11.3} {right:9.3} {left:9.3}", theta.to_degrees());
    }
    let steps = run.stats.steps;
    println!("{}: {}", run.status.name(), run.message);
    println!(
        "{steps} steps in {:.1} ms, {:.0} ns each",
        1e3 * spent.as_secs_f64(),
        1e9 * spent.as_secs_f64() / steps as f64
    );
    for (name, time) in run.violations() {
        println!("{name} first at {time} s");
    }
    Ok(())
}
