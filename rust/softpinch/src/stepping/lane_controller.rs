//! The discrete controller of the run in a lane. Its work is done for this run alone, between steps.

use std::sync::Arc;

use crate::error::{Result, require};
use crate::formulation::Evaluation;
use crate::model::{
    ControllerState, FrameMotion, Inputs, Kept, Known, Measure, Measured, Sampled, SampledController, Scene,
    Scratch, require_length,
};
use crate::number::Lanes;
use crate::stepping::{Instant, LaneContact, Options, column};

pub struct LaneController {
    /// The blocks, the last one first, and their states.
    blocks: Vec<Arc<SampledController>>,
    now: Vec<ControllerState>,
    /// The states before the last change, in so far as they were changed, and the instant of that change, s.
    before: Vec<Kept>,
    changed: f64,
    scratch: Scratch,
}

impl LaneController {
    /// The controller of a run before it begins; `None` if the scene has none.
    pub fn new(scene: &Scene) -> Result<Option<Box<Self>>> {
        let Some(Sampled { controller, origin }) = &scene.inputs.sampled else { return Ok(None) };
        let now = match &scene.initial.controller {
            Some(row) => states(controller, row, scene.initial.time)?,
            None => controller.blocks().map(|block| ControllerState::new(block, *origin)).collect(),
        };
        Ok(Some(Box::new(Self {
            blocks: std::iter::successors(Some(controller.clone()), |block| block.outer.clone()).collect(),
            before: vec![Kept::default(); now.len()],
            changed: f64::NEG_INFINITY,
            scratch: Scratch::default(),
            now,
        })))
    }

    pub fn is_due(&self, t: f64) -> bool {
        self.now.iter().zip(&self.blocks).any(|(now, block)| now.is_due(block, t))
    }

    /// Keeps the states before a change at the instant `t`.
    fn keep(&mut self, t: f64) {
        if t > self.changed {
            for (now, before) in self.now.iter().zip(&mut self.before) {
                now.keep(before);
            }
            self.changed = t;
        }
    }

    /// Lets each block, before that to which it gives targets, sample what is `seen`, use measurements, and act at `t`.
    fn advance(&mut self, inputs: &Inputs, t: f64, seen: Option<&Measured<'_>>) {
        self.keep(t);
        let mut before = None;
        for (now, block) in self.now.iter_mut().zip(&self.blocks).rev() {
            let seen = seen.filter(|_| now.is_due(block, t));
            if seen.is_some() || now.uses(block, t) {
                let [schedule, rate] = inputs.target(t);
                let target = before.map_or([schedule, rate], |outputs| [outputs, [0.0; 2]]);
                let known = Known { target, schedule };
                if let Some(seen) = seen {
                    now.sample(block, (seen, &known), &mut self.scratch);
                }
                now.use_kept(block, t, &known, &mut self.scratch);
            }
            now.act(block, t);
            before = Some(now.torque);
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
            && self.blocks.iter().any(|block| block.measures.contains(&Measure::Multipliers))
        {
            // The contacts of a run that has not begun have no modes yet.
            let mut drive = scene.inputs.segment(t);
            drive.hold(self.held());
            // The length of a step only scales what counts as an event now, and a state without contacts has no
            // row that could be refused.
            let h = self.blocks[0].period;
            let found = LaneContact::multipliers(options, scene, drive, h);
            multipliers = found.unwrap_or(multipliers);
        }
        let frame = scene.inputs.frame_from(t).map_or_else(FrameMotion::still, |frame| frame.at(0.0));
        let frame = (frame, scene.parameters.surroundings.gravity);
        let seen = Measured { motion: &motion, multipliers: &multipliers, frame };
        self.advance(&scene.inputs, t, Some(&seen));
    }

    /// The torques that have acted so far, N m.
    pub fn held(&self) -> [f64; 2] {
        self.now[0].torque
    }

    /// The torques that act from the instant `t` on, N m. They are NaN, which ends the run, once a sample has
    /// overflowed, although its output may be limited, or under way.
    pub fn torque(&mut self, inputs: &Inputs, t: f64) -> [f64; 2] {
        let due = |(now, block): (&ControllerState, &Arc<_>)| now.uses(block, t) || now.acts(block, t);
        if self.now.iter().zip(&self.blocks).any(due) {
            self.advance(inputs, t, None);
        }
        if !self.now.iter().all(ControllerState::is_finite) {
            return [f64::NAN; 2];
        }
        self.held()
    }

    /// Puts the numbers of the state at an instant, which may be one before the last change, into a row.
    pub fn put_row(&self, watched: &Instant, row: &mut Vec<f64>) {
        row.clear();
        let earlier = watched.t < self.changed || watched.before_sample;
        for (now, before) in self.now.iter().zip(&self.before) {
            if earlier { row.extend(now.before(before).row()) } else { row.extend(now.row()) }
        }
    }
}

/// The states of all blocks from the numbers of a row, with which a run goes on at `time`.
fn states(controller: &SampledController, row: &[f64], time: f64) -> Result<Vec<ControllerState>> {
    require_length(row, controller.width())?;
    let mut rest = row;
    let one = |block: &SampledController| {
        let (own, others) = rest.split_at(block.own_width());
        rest = others;
        let state = ControllerState::from_row(block, own)?;
        let rule = "must be between the last sample of State.controller and the next one";
        require(state.holds_at(block, time), "State.time", time, rule)?;
        Ok(state)
    };
    controller.blocks().map(one).collect()
}
