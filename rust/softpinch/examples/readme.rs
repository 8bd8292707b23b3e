//! The example of the crate's README.

use softpinch::prelude::*;

pub(crate) fn main() -> Result<(), Error> {
    // Tips softer than the default ones. The fingers close by 6 degrees, and a push of 2 N lasts 10 ms.
    let soft = Fingertip { youngs_modulus: 0.2e6, ..Fingertip::default() };
    let parameters = Parameters { tips: [soft; 2], ..Parameters::default() }.checked()?;
    let scene = Scene {
        initial: State::at_rest(contact(&parameters)?),
        parameters,
        inputs: Inputs::constant_targets([6_f64.to_radians(); 2]).with_pulse(0.3, 0.01, [2.0, 0.0, 0.0])?,
        check: true,
        duration: 0.5,
    };
    let options = Options { steps: Steps::Fixed(1e-4), every: 10, ..Options::default() };
    let (run, _) = simulate(&scene, &options, &|| false)?;
    assert_eq!(run.status, Status::Completed, "{}", run.message);
    println!("after {} s: theta = {} rad", run.last.t, run.last.motion.q.object[2]);
    Ok(())
}
