//! Equal steps between breakpoints.

use crate::formulation::{Evaluation, Motion, System};
use crate::grid::Grid;
use crate::integrator::{Integrator, Step};
use crate::lanes::LaneTask;
use crate::record::{Linearized, Recording};
use crate::simulate::Run;
use crate::stepping::{End, Job, Observer, instant, interruption, strike, unsolved, works};

/// The step loop of one run.
pub struct Fixed<'a, S, I> {
    /// What is run.
    pub job: Job<'a>,
    /// Its times.
    pub grid: &'a Grid,
    /// Its equations.
    pub system: &'a S,
    /// How they are stepped.
    pub integrator: I,
    /// Where its rows go.
    pub recording: Recording,
}

fn pack(tau: f64, motion: &Motion<f64>) -> Linearized {
    let mut point = [tau; 21];
    point[1..10].copy_from_slice(&motion.q);
    point[10..19].copy_from_slice(&motion.p);
    point[19..].copy_from_slice(&motion.memory);
    point
}

fn unpack(point: &Linearized) -> (f64, Motion<f64>) {
    let motion = Motion {
        q: std::array::from_fn(|k| point[1 + k]),
        p: std::array::from_fn(|k| point[10 + k]),
        memory: [point[19], point[20]],
    };
    (point[0], motion)
}

impl<S: System<f64>, I: Integrator<f64, S>> LaneTask<f64> for Fixed<'_, S, I> {
    type Output = Run;

    #[inline(always)]
    fn run(self) -> Run {
        let Self { job, grid, system, mut integrator, recording } = self;
        let scene = job.scene;
        let initial = &scene.initial;
        let mut y = system.begin(&Motion { q: initial.q, p: initial.p, memory: initial.memory });
        let mut observer = Observer::new(job, recording, integrator.keeps());
        observer.begin(system);
        let mut ended: Option<End> = None;
        let (mut after, mut now) = (y, Evaluation::nothing());
        // Where the last Jacobian was taken.
        let mut taken = [f64::NAN; 21];

        let mut next = Some(grid.first);
        'run: while let Some(segment) = next {
            next = grid.after(&scene.inputs, &segment);
            let drive = scene.inputs.segment(segment.anchor);
            observer.stats.segments += 1;
            integrator.restart();
            observer.linearized = None;
            if let (true, Some(point)) = (integrator.keeps() && segment.first > 0, initial.linearized) {
                let (tau, motion) = unpack(&point);
                integrator.keep(&drive, tau, &system.begin(&motion));
                observer.linearized = Some(point);
                taken = point;
            }
            let final_step = if next.is_none() { segment.count } else { segment.count - 1 };
            for step in segment.first..=final_step {
                let tau = segment.tau(step);
                let t = segment.time(step);
                system.evaluate_into(&drive, tau, &y, &mut now);
                observer.stats.evaluations += 1;
                let closure = match observer.require_finite(system, &now, &y) {
                    Ok(closure) => closure,
                    Err(end) => {
                        ended = Some(end);
                        break 'run;
                    }
                };
                let at = instant(t, (segment.anchor, step), &now);
                ended = observer.watch(at, &now.sin_tilt, works(system.size(), &y), closure);
                observer.record_if_due(system);
                if ended.is_some() || step == segment.count {
                    break 'run;
                }
                if observer.is_interrupted(job) {
                    ended = Some(interruption(t));
                    break 'run;
                }
                // A run that goes on inside a segment has had the impulses at its anchor.
                if step == 0 && strike(scene, system, &drive, (t, tau), &mut y) {
                    system.evaluate_into(&drive, tau, &y, &mut now);
                    observer.stats.evaluations += 1;
                }
                let at = Step { tau, h: segment.h, y: &y, rate: &now.rate, allowed: None };
                let jacobians = observer.stats.jacobians;
                match integrator.step(system, &drive, &at, &mut after, &mut observer.stats) {
                    Ok(()) => {
                        if integrator.keeps() {
                            if observer.stats.jacobians > jacobians {
                                taken = pack(tau, &now.motion);
                            }
                            observer.linearized = integrator.serves().then_some(taken);
                        }
                        y = after;
                    }
                    Err(failure) => {
                        ended = Some(unsolved(t, segment.h, failure.into()));
                        break 'run;
                    }
                }
                system.correct(&drive, tau + segment.h, &mut y);
                observer.stats.steps += 1;
            }
        }
        observer.finish(system, ended)
    }
}
