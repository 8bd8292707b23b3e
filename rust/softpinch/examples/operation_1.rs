//! The paper's operation 1, as in the crate's documentation.

use softpinch::prelude::*;

pub(crate) fn main() -> Result<(), Error> {
    let parameters = Parameters::default().checked()?;
    let initial = State::at_rest(contact(&parameters)?);
    let inputs = Inputs::constant_targets([6_f64.to_radians(); 2]);
    let scene = Scene { parameters, inputs, initial, check: true, duration: 1.0 };
    let (run, _) = simulate(&scene, &Options::default(), &|| false)?;
    println!("{}: d_n = {:.2} mm", run.status.name(), 1e3 * run.last.motion.q.compression[0]);
    assert_eq!(run.status, Status::Completed);
    Ok(())
}
