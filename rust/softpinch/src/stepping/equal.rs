//! The loop of equal steps between breakpoints, for one run in each lane. Every lane has its own breakpoints,
//! steps and parameters, and loads the next run as soon as its own has ended. A single run is one lane.

use std::mem::swap;

use crate::error::Error;
use crate::formulation::equations::{Evaluation, ROOM};
use crate::formulation::system::System;
use crate::method::traits::{Integrator, Step};
use crate::model::scene::Scene;
use crate::number::lanes::Lanes;
use crate::number::simd::level::Instructions;
use crate::stepping::batch::LaneBatch;
use crate::stepping::ending::full;
use crate::stepping::equal_lanes::{EqualLanes, Instants, pack};
use crate::stepping::grid::Grid;
use crate::stepping::options::Options;
use crate::stepping::queue::{Equip, POLL, RunQueue};

/// The loop of equal steps before it runs.
pub struct EqualSteps<'a, Q, G, E> {
    /// Instructions to use.
    pub instructions: Instructions,
    /// The options of every run.
    pub options: &'a Options,
    /// The source and the destination of the runs.
    pub queue: Q,
    /// Finds the times of a scene's steps.
    pub grid: G,
    /// Makes the equations and the method for the runs in all lanes.
    pub equip: E,
}

impl<'a, Q: RunQueue<'a>, G: FnMut(&Scene) -> Result<Grid, Error>, E> EqualSteps<'a, Q, G, E> {
    /// Computes all runs of the queue, and returns the queue.
    #[inline(always)]
    pub fn run<R: Lanes, S: System<R>, I: Integrator<R, S>>(self) -> Result<Q, Error>
    where
        E: Equip<S, I>,
    {
        let Self { instructions, options, queue, grid, mut equip } = self;
        let zero = R::zero();
        let mut lanes = EqualLanes {
            batch: LaneBatch::new(instructions, queue, options),
            grid,
            anchor: zero,
            taken: zero,
            h: zero,
            fresh: 0,
            arrived: 0,
            striking: 0,
            struck: 0,
            entered: 0,
            clock: 0,
            arrival: u64::MAX,
            taken_at: None,
            serving: None,
            serving_last: None,
        };
        for lane in 0..R::WIDTH {
            lanes.load(lane, 0)?;
        }
        // The states now, the states after the step, and replacements for lanes that do not take the step.
        let (mut first, mut second, mut replacement) = ([zero; ROOM], [zero; ROOM], [zero; ROOM]);
        let (mut y, mut after) = (&mut first, &mut second);
        let (mut one, mut other) = (Evaluation::nothing(), Evaluation::nothing());
        let (mut now, mut before) = (&mut one, &mut other);
        let (mut system, mut method) = lanes.batch.equip(&mut equip, y);
        replacement.copy_from_slice(&y[..]);
        lanes.schedule();

        while lanes.batch.active != 0 {
            if lanes.entered != 0 {
                lanes.entered = 0;
                if method.keeps() {
                    lanes.keep(&system, &mut method);
                }
            }
            let tau = lanes.taken * lanes.h;
            let t = lanes.times(tau);
            swap(&mut now, &mut before);
            system.evaluate_into(&lanes.batch.drive, tau, y, now);
            lanes.batch.stats.evaluations += 1;
            let watching = lanes.batch.active & !lanes.struck;
            let seen = lanes.batch.watch(&system, now, y, t, watching);
            if method.keeps() && watching & seen.sound != 0 {
                lanes.serving_last = lanes.serving;
            }
            let at = Instants { now, y, before, y_before: after };
            if watching & seen.sound & 1 != 0
                && lanes.batch.queue.is_due(t.lane(0), false)
                && let Some(row) = lanes.now(&system, 0, &at)
                && let Err(error) = lanes.batch.record(&system, &row)
            {
                lanes.retire(&system, 0, full(row.instant.t, &error), &row);
                // The run cannot go on, and there is no other one: a recorded run has a loop of its own.
                break;
            }

            // Lanes that do not take the step, and those among them into which another run was loaded.
            let mut held = R::ALL & !lanes.batch.active;
            let mut loaded = 0;
            let leaving = (watching & !seen.sound) | seen.ended | lanes.arrived;
            let polls = (lanes.clock + 1).is_multiple_of(POLL);
            lanes.fresh = 0;
            if leaving | lanes.striking | lanes.struck != 0 || polls {
                let (holding, fresh) = lanes.hold(&system, (&seen, leaving, tau), &at, &mut replacement)?;
                (held, loaded) = (held | holding, fresh);
            }
            if held != R::ALL {
                let step = Step { tau, h: lanes.h, y, rate: &now.rate, allowed: None };
                let (drive, stats) = (&lanes.batch.drive, &mut lanes.batch.stats);
                let jacobians = stats.jacobians;
                match method.step(&system, drive, &step, after, stats) {
                    Ok(()) => {
                        if method.keeps() {
                            if stats.jacobians > jacobians {
                                lanes.taken_at = Some(pack(tau, &now.motion));
                            }
                            lanes.serving = lanes.taken_at.filter(|_| method.serves());
                        }
                        system.correct(drive, tau + lanes.h, after);
                    }
                    Err(failure) => {
                        let failed = R::ALL & !held;
                        let at = Instants { now, y, before, y_before: y };
                        lanes.fail(&system, (failed, failure.into()), &at)?;
                        (held, loaded) = (held | failed, loaded | failed);
                    }
                }
            }
            if loaded != 0 {
                if lanes.batch.active == 0 {
                    break;
                }
                lanes.batch.renew(&mut equip, (&mut system, &mut method), loaded, &mut replacement);
            }
            swap(&mut y, &mut after);
            if held != 0 {
                system.each(|n| y[n] = R::select(held, replacement[n], y[n]));
            }
            lanes.taken = R::select(held, lanes.taken, lanes.taken + R::constant(1.0));
            lanes.clock += 1;
            if lanes.clock == lanes.arrival {
                lanes.arrive();
            }
        }
        Ok(lanes.batch.queue)
    }
}
