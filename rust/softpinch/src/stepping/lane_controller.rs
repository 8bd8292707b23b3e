//! The discrete controller of the run in a lane. Its work is done for this run alone, between steps.

use std::borrow::Cow;
use std::sync::Arc;

use crate::error::{Result, require};
use crate::formulation::Evaluation;
use crate::model::{
    ControllerState, FrameMotion, Kept, Measure, Measured, Sampled, SampledController, Scene, Scratch,
};
use crate::number::Lanes;
use crate::stepping::{Instant, LaneContact, Options, column};

pub struct LaneController {
    controller: Arc<SampledController>,
    now: ControllerState,
    /// The state before the last change, in so far as it was changed, and the instant of that change, s.
    before: Kept,
    changed: f64,
    scratch: Scratch,
}

impl LaneController {
    /// The controller of a run before it begins; `None` if the scene has none.
    pub fn new(scene: &Scene) -> Result<Option<Box<Self>>> {
        let Some(Sampled { controller, origin }) = scene.inputs.sampled() else { return Ok(None) };
        let now = match &scene.initial.controller {
            Some(row) => {
                let state = ControllerState::from_row(controller, row)?;
                let (time, rule) = (
                    scene.initial.time,
                    "must be between the last sample of State.controller and the next one",
                );
                require(state.holds_at(controller, time), "State.time", time, rule)?;
                state
            }
            None => ControllerState::new(controller, *origin),
        };
        Ok(Some(Box::new(Self {
            controller: controller.clone(),
            before: Kept::default(),
            changed: f64::NEG_INFINITY,
            scratch: Scratch::default(),
            now,
        })))
    }

    pub fn is_due(&self, t: f64) -> bool {
        self.now.is_due(&self.controller, t)
    }

    /// Keeps the state before a change at the instant `t`.
    fn keep(&mut self, t: f64) {
        if t > self.changed {
            self.now.keep(&mut self.before);
            self.changed = t;
        }
    }

    /// Takes the sample of the instant `t`, at which a lane has been evaluated under the torques before it.
    #[cold]
    pub fn sample<R: Lanes>(
        &mut self,
        run: (&Scene, Option<&LaneContact>),
        options: &Options,
        t: f64,
        (now, lane): (&Evaluation<R>, usize),
    ) {
        let (scene, contact) = run;
        let motion = now.motion.lane(lane);
        let mut multipliers = column(&now.multipliers, lane);
        if contact.is_some_and(LaneContact::is_unset)
            && self.controller.measures.contains(&Measure::Multipliers)
        {
            // The contacts of a run that has not begun have no modes yet.
            let mut drive = scene.inputs.segment(t);
            drive.hold(self.now.torque());
            // The length of a step only scales what counts as an event now, and a state without contacts has no
            // row that could be refused.
            let h = self.controller.period;
            let found = LaneContact::multipliers(options, scene, drive, h);
            multipliers = found.unwrap_or(multipliers);
        }
        let frame = scene.inputs.frame_from(t).map_or_else(FrameMotion::still, |frame| frame.at(0.0));
        let frame = (frame, scene.parameters.surroundings.gravity);
        let target = scene.inputs.target(t);
        let seen = Measured { motion: &motion, multipliers: &multipliers, target, frame };
        self.keep(t);
        self.now.sample(&self.controller, &seen, &mut self.scratch);
    }

    /// The torques that have acted so far, N m.
    pub fn held(&self) -> [f64; 2] {
        self.now.torque()
    }

    /// The torques that act from the instant `t` on, N m. They are NaN, which ends the run, once a sample has
    /// overflowed, although its output may be limited, or under way.
    pub fn torque(&mut self, t: f64) -> [f64; 2] {
        if self.now.row().any(|number| !number.is_finite()) {
            return [f64::NAN; 2];
        }
        if self.now.acts(&self.controller, t) {
            self.keep(t);
            self.now.act(&self.controller, t);
        }
        self.now.torque()
    }

    /// The state at an instant, which may be one before the last change.
    pub fn state_at(&self, watched: &Instant) -> Cow<'_, ControllerState> {
        if watched.t < self.changed || watched.before_sample {
            Cow::Owned(self.now.before(&self.before))
        } else {
            Cow::Borrowed(&self.now)
        }
    }
}
