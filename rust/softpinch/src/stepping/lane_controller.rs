//! The discrete controller of the run in a lane. Its work is done for this run alone, between steps.

use std::sync::Arc;

use crate::error::{Result, require};
use crate::formulation::Evaluation;
use crate::model::{
    ControllerState, FrameMotion, Inputs, Known, Measure, Measured, Sampled, SampledController, Scene,
    Scratch, SegmentDrive, require_length,
};
use crate::number::Lanes;
use crate::stepping::{Instant, LaneContact, Options, column};

pub struct LaneController {
    /// The last block first.
    blocks: Vec<LaneBlock>,
    scratch: Scratch,
    /// The inputs of the present segment, and the instant until which all but the torques are constant, s.
    drive: SegmentDrive,
    constant_until: f64,
}

struct LaneBlock {
    block: Arc<SampledController>,
    now: ControllerState,
    /// When it next does something, and when it last did, s, with its state before that as numbers.
    next: f64,
    last: f64,
    before: Vec<f64>,
}

impl LaneController {
    /// The controller of a run before it begins; `None` if the scene has none.
    pub fn new(scene: &Scene) -> Result<Option<Box<Self>>> {
        let Some(Sampled { controller, origin }) = &scene.inputs.sampled else { return Ok(None) };
        let (time, mut rest) = (scene.initial.time, scene.initial.controller.as_deref());
        rest.map_or(Ok(()), |row| require_length(row, controller.width()))?;
        let (never, mut blocks) = (f64::NEG_INFINITY, Vec::new());
        for block in std::iter::successors(Some(controller.clone()), |block| block.outer.clone()) {
            let mut now = ControllerState::new(&block, *origin);
            if let Some(row) = rest {
                let (own, others) = row.split_at(block.own_width());
                (now, rest) = (ControllerState::from_row(&block, own)?, Some(others));
                let rule = "must be between the last sample of State.controller and the next one";
                require(now.holds_at(&block, time), "State.time", time, rule)?;
            }
            blocks.push(LaneBlock { block, now, next: never, last: never, before: Vec::new() });
        }
        let (scratch, drive) = (Scratch::default(), SegmentDrive::still());
        Ok(Some(Box::new(Self { blocks, scratch, drive, constant_until: never })))
    }

    pub fn is_due(&self, t: f64) -> bool {
        self.blocks.iter().any(|own| own.next <= t && own.now.is_due(&own.block, t))
    }

    /// Lets each block, before that to which it gives targets, sample what is `seen`, use measurements, and act at `t`.
    fn advance(&mut self, inputs: &Inputs, t: f64, seen: Option<&Measured<'_>>) {
        let mut outputs = None;
        for LaneBlock { block, now, next, last, before } in self.blocks.iter_mut().rev() {
            if *next <= t {
                if t > *last {
                    before.clear();
                    now.put_row(before);
                    *last = t;
                }
                let seen = seen.filter(|_| now.is_due(block, t));
                if seen.is_some() || now.uses(block, t) {
                    let [schedule, rate] = inputs.target(t);
                    let target = outputs.map_or([schedule, rate], |outputs| [outputs, [0.0; 2]]);
                    let known = Known { target, schedule };
                    if let Some(seen) = seen {
                        now.sample(block, (seen, &known), &mut self.scratch);
                    }
                    now.use_kept(block, t, &known, &mut self.scratch);
                }
                now.act(block, t);
                *next = now.next(block);
            }
            outputs = Some(now.torque);
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
            && self.blocks.iter().any(|own| own.block.measures.contains(&Measure::Multipliers))
        {
            // The contacts of a run that has not begun have no modes yet.
            let mut drive = scene.inputs.segment(t);
            drive.hold(self.held());
            // The length of a step only scales what counts as an event now, and a state without contacts has no
            // row that could be refused.
            let h = self.blocks[0].block.period;
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
        self.blocks[0].now.torque
    }

    /// The inputs of the segment from `anchor` on, with the torques that act from the instant `t` on, or have acted so far.
    /// They are NaN, which ends the run, once a sample has overflowed, although its output may be limited, or under way.
    pub fn segment(&mut self, inputs: &Inputs, anchor: f64, t: Option<f64>) -> &SegmentDrive {
        if anchor >= self.constant_until {
            self.drive = inputs.segment(anchor);
            self.constant_until = if self.drive.is_constant() { inputs.next_other(anchor) } else { anchor };
        }
        if let Some(t) = t
            && self.blocks.iter().any(|own| own.next <= t)
        {
            self.advance(inputs, t, None);
        }
        let finite = t.is_none() || self.blocks.iter().all(|own| own.now.is_finite());
        self.drive.hold(if finite { self.held() } else { [f64::NAN; 2] });
        &self.drive
    }

    /// Puts the numbers of the state at an instant, which may be one before the last change, into a row.
    pub fn put_row(&self, watched: &Instant, row: &mut Vec<f64>) {
        row.clear();
        for LaneBlock { now, last, before, .. } in &self.blocks {
            if watched.t < *last || watched.before_sample && watched.t == *last {
                row.extend(before);
            } else {
                now.put_row(row);
            }
        }
    }
}
