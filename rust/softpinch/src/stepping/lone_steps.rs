//! Steps of one run outside of its loop, by a method of its own: those that locate the events of its contacts, and
//! those that end inside a step, where a row was asked for. Taking them leaves the loop's method as it is, and a row is as
//! accurate as the ends of steps, whatever the method.

use std::mem::take;

use crate::formulation::{MAX_COMPONENTS, SceneEquations, States, System};
use crate::method::{AnyMethod, Stats, Step, StepResult, Unsolved};
use crate::model::{Contacts, Scene, SegmentDrive};
use crate::number::Lanes;
use crate::stepping::equal_lanes::Place;
use crate::stepping::{Instant, LaneBatch, Moment, Options, column, round_off, watched};

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

/// A row closer to the start of its step than this share of the step has the state there.
const SLIVER: f64 = 1.0 / (1u64 << 44) as f64;

/// The rows inside the last step, and the steps that lead to them.
#[derive(Default)]
pub struct RowsInside {
    /// The equations and the method, once there was a row; runs with unilateral contact have their own.
    steps: Option<Box<LoneSteps>>,
    /// The rows, until it is known how far the run gets in this step.
    pub rows: Vec<Instant>,
}

impl RowsInside {
    /// Computes the instants that were asked for before the end of the step that the run in lane 0 takes from the time
    /// `tau` of its segment and the state `y`.
    #[cold]
    #[inline(never)]
    pub fn look_inside<R: Lanes>(
        &mut self,
        batch: &mut LaneBatch<'_, R, Place>,
        clock: u64,
        system: &SceneEquations<R>,
        (tau, y): (R, &States<R>),
    ) -> StepResult {
        let (tau, y) = (tau.lane(0), column(y, 0));
        let Some(run) = &mut batch.runs[0] else { return Ok(()) };
        let (start, end) = (run.place.now(clock).0, run.place.now(clock + 1).0);
        if let Some(steps) = &mut self.steps {
            steps.method.forget_start();
        }
        loop {
            let time = batch.queue.recorder.next_time();
            if time >= end {
                return Ok(());
            }
            batch.queue.recorder.is_due(time, true);
            // A step as short as round-off might not be solved.
            let shortest = round_off(start, end).max(SLIVER * (end - start));
            let length = if time - start <= shortest { 0.0 } else { time - start };
            let row = if let Some(contact) = &mut run.contact {
                contact.inside(&Moment { earlier: false, tau, h: length, y: &y })?
            } else {
                let mut drive = run.scene.inputs.segment(run.place.segment.anchor);
                if let Some(controller) = &run.controller {
                    drive.hold(controller.held());
                }
                let options = batch.options;
                let new = || Box::new(LoneSteps::new(options, &run.scene));
                let steps = self.steps.get_or_insert_with(new);
                let LoneSteps { system: alone, method } = &mut **steps;
                let next = if length > 0.0 { method.step(alone, &drive, (tau, &y), length)? } else { y };
                let now = alone.evaluate(&drive, tau + length, &next);
                batch.stats.evaluations += 1;
                batch.stats.add(&take(&mut method.stats));
                watched(system.size(), (0, None), &now, &next, time, (time, 0))
            };
            // After an overflow the run ends at this step.
            if row.is_finite() {
                self.rows.push(Instant { t: time, grid: (time, 0), ..row });
            }
        }
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
