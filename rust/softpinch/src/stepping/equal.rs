//! The loop of equal steps between breakpoints, for one run in each lane. Every lane has its own breakpoints,
//! steps and parameters, and loads the next run as soon as its own has ended. A single run is one lane.

use std::mem::swap;
use std::ops::DerefMut;

use crate::error::Result;
use crate::formulation::{Evaluation, MAX_COMPONENTS};
use crate::method::{Integrator, Runs};
use crate::number::{LaneTask, Lanes};
use crate::stepping::{EqualLanes, Instants, LaneBatch, LoopSystem, POLL, Phase, RowsInside, RunLoop, full};

pub struct EqualSteps<'a, B> {
    pub runs: RunLoop<'a>,
    /// Makes the equations and the method for the runs in all lanes. The method is behind a pointer.
    pub build: B,
}

impl<R, S, B, M> LaneTask<R> for EqualSteps<'_, B>
where
    R: Lanes,
    S: LoopSystem<R>,
    B: FnOnce(Runs<'_>) -> (S, M),
    M: DerefMut<Target: Integrator<R, S>>,
{
    type Output = Result;

    #[inline(always)]
    fn run(self) -> Result {
        let Self { runs, build } = self;
        let zero = R::zero();
        let mut lanes = EqualLanes {
            grid: runs.grid,
            batch: LaneBatch::new(runs),
            anchor: zero,
            taken: zero,
            h: zero,
            at_start: 0,
            entered: false,
            stepped: 0,
            held: 0,
            clock: 0,
            arrival: u64::MAX,
            taken_at: None,
            in_use: None,
            in_use_last: None,
            inside: RowsInside::default(),
        };
        for lane in 0..R::WIDTH {
            lanes.load(lane, 0)?;
        }
        // The states now, the states after the step, and replacements for lanes that do not take the step.
        let (mut first, mut second, mut replacement) =
            ([zero; MAX_COMPONENTS], [zero; MAX_COMPONENTS], [zero; MAX_COMPONENTS]);
        let (mut y, mut after) = (&mut first, &mut second);
        let (mut one, mut other) = (Evaluation::nothing(), Evaluation::nothing());
        let (mut now, mut before) = (&mut one, &mut other);
        let (mut system, mut method) = lanes.batch.build(build, y);
        // Methods that keep a Jacobian have one lane.
        let keeps_jacobian = R::WIDTH == 1 && method.keeps_jacobian();
        replacement.copy_from_slice(&y[..]);
        lanes.schedule();

        while lanes.batch.active() != 0 {
            if std::mem::take(&mut lanes.entered) && keeps_jacobian {
                lanes.restart_jacobian(system.called(), &mut *method);
            }
            let tau = lanes.taken * lanes.h;
            let t = lanes.times(tau);
            swap(&mut now, &mut before);
            system.evaluate_into(&lanes.batch.drive, tau, y, now);
            lanes.batch.stats.evaluations += 1;
            let at = Instants { system: system.called(), now, y, before, y_before: after };
            // Lanes that do not take the step, and those among them into which another run was loaded.
            let (mut skipping, mut loaded) = (0, 0);
            if lanes.batch.holds {
                loaded = lanes.hold_lanes(tau, &at, &mut replacement)?;
                if lanes.held != 0 && keeps_jacobian {
                    method.restart();
                    lanes.in_use = None;
                }
            }
            let watching = lanes.watched_now();
            if lanes.has_rows_inside()
                && watching != 0
                && !lanes.record_inside(system.called(), f64::INFINITY)
            {
                break;
            }
            let seen = lanes.batch.watch(&system, now, y, t, watching);
            if keeps_jacobian && watching & seen.finite != 0 {
                lanes.in_use_last = lanes.in_use;
            }
            if watching & seen.finite & 1 != 0
                && lanes.batch.is_due(t.lane(0), false)
                && let Some(row) = lanes.now(0, &at)
                && let Err(error) = lanes.batch.record(system.called(), &row)
            {
                lanes.retire(system.called(), 0, full(row.t, &error), &row);
                // The run cannot go on, and there is no other one: a recorded run has a loop of its own.
                break;
            }

            let phases = &lanes.batch.phases;
            skipping |= R::ALL & !phases.active() | lanes.held;
            let leaving = (watching & !seen.finite) | seen.ended | (phases.at(Phase::End) & !lanes.held);
            let impulses = phases.at(Phase::Impulse) | phases.at(Phase::Struck);
            let polls = (lanes.clock + 1).is_multiple_of(POLL);
            if leaving | impulses != 0 || polls {
                let (skipped, reloaded) =
                    lanes.end_runs_and_apply_impulses((&seen, leaving, tau), &at, &mut replacement)?;
                (skipping, loaded) = (skipping | skipped, loaded | reloaded);
            }
            if skipping != R::ALL
                && let Err(unsolved) =
                    lanes.step((&system, &mut *method, keeps_jacobian), (tau, now, y), after)
            {
                let failed = R::ALL & !skipping;
                let at = Instants { system: system.called(), now, y, before, y_before: y };
                lanes.fail((failed, unsolved), &at)?;
                (skipping, loaded) = (skipping | failed, loaded | failed);
            }
            if loaded != 0 {
                if lanes.batch.active() == 0 {
                    break;
                }
                lanes.batch.renew((&mut system, &mut *method), loaded, &mut replacement);
            }
            swap(&mut y, &mut after);
            if skipping != 0 {
                system.size().each(|n| y[n] = R::select(skipping, replacement[n], y[n]));
            }
            lanes.stepped = !skipping;
            lanes.at_start &= skipping;
            // The sum is stored as a whole. A store of some lanes would delay the load in the next step.
            lanes.taken = lanes.taken + R::select(skipping, zero, R::constant(1.0));
            lanes.clock += 1;
            if lanes.clock == lanes.arrival {
                lanes.arrive();
            }
        }
        Ok(())
    }
}
