//! Steps of one run outside of its loop, by a method of its own: those that locate the events of its contacts, and
//! those that end inside a step, where a row was asked for. Taking them leaves the loop's method as it is, and a row is as
//! accurate as the ends of steps, whatever the method.

use crate::formulation::{MAX_COMPONENTS, SceneEquations, States, System};
use crate::method::{AnyMethod, Stats, Step, Unsolved};
use crate::model::{Contacts, Scene, SegmentDrive};
use crate::stepping::Options;

/// The start of the last step, with the derivative of its state.
struct KnownStart {
    tau: f64,
    y: States<f64>,
    contacts: Contacts<f64>,
    rate: States<f64>,
}

/// The method of one run, with the start of its last step.
pub struct LoneMethod {
    method: AnyMethod,
    start: Option<KnownStart>,
    /// The work that was done and has not been counted yet.
    pub stats: Stats,
}

impl LoneMethod {
    /// The state a step of length `h` after the state `y`, which is at the time `tau` of the segment. Steps from the
    /// same start share its evaluation and its Jacobian; nothing else is kept from one step to the next.
    pub fn step(
        &mut self,
        system: &SceneEquations<f64>,
        drive: &SegmentDrive,
        (tau, y): (f64, &States<f64>),
        h: f64,
    ) -> Result<States<f64>, Unsolved> {
        let Self { method, start, stats } = self;
        let contacts = drive.contacts;
        let is_start = |last: &KnownStart| last.tau == tau && last.y == *y && last.contacts == contacts;
        if start.as_ref().is_some_and(is_start) {
            method.repeat();
        } else {
            method.restart();
            *start = None;
        }
        let start = start.get_or_insert_with(|| {
            stats.evaluations += 1;
            KnownStart { tau, y: *y, contacts, rate: system.evaluate(drive, tau, y).rate }
        });
        let step = Step { system, drive, tau, h, y, rate: &start.rate, allowed: None };
        let mut next = [0.0; MAX_COMPONENTS];
        method.step(&step, &mut next, stats)?;
        system.correct(drive, tau + h, &mut next);
        Ok(next)
    }

    /// Forgets the start of the last step, because the inputs may be others.
    pub fn forget_start(&mut self) {
        self.start = None;
    }
}

pub struct LoneSteps {
    pub system: SceneEquations<f64>,
    pub method: LoneMethod,
}

impl LoneSteps {
    pub fn new(options: &Options, scene: &Scene) -> Self {
        let make = options.method.entry().alone;
        let (system, method) = options.runs(scene).with_method(make);
        Self { system, method: LoneMethod { method, start: None, stats: Stats::default() } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::table::METHODS;
    use crate::model::contact_modes::ContactModel;
    use crate::model::inputs::Inputs;
    use crate::model::motion::Motion;
    use crate::model::parameters::{Friction, Parameters};
    use crate::model::start::{State, contact};

    /// Steps from the same start share its Jacobian, and have the bits of steps alone.
    #[test]
    fn a_repeated_step_has_the_bits_of_a_step_alone() {
        let friction = Friction { right: 0.5, left: 0.5 };
        let parameters = Parameters { friction, ..Parameters::default() };
        let initial = State::at_rest(contact(&parameters).unwrap());
        let motion = Motion { p: [0.01; 9].into(), ..initial.motion };
        let inputs = Inputs::constant_targets([0.12; 2]);
        let scene = Scene { initial, parameters, inputs, check: false, duration: 1.0 };
        let drive = scene.inputs.segment(0.0);
        for (name, method) in METHODS {
            for contact in [ContactModel::Bilateral, ContactModel::Unilateral] {
                let options = Options { method, contact, ..Options::default() };
                let steps = || LoneSteps::new(&options, &scene);
                let mut repeated = steps();
                let mut y = repeated.system.begin(&motion);
                for start in 1..=2 {
                    for h in [1e-4, 3e-5, 7e-5, 3e-5] {
                        let step = |LoneSteps { system, method }: &mut LoneSteps| {
                            method.step(system, &drive, (0.0, &y), h).unwrap()
                        };
                        assert_eq!(step(&mut repeated), step(&mut steps()), "{name} {h}");
                    }
                    assert!(repeated.method.stats.jacobians <= start, "{name}");
                    y[0] += 1e-6;
                }
            }
        }
    }
}
