//! The runs in the lanes of a step loop, and what both loops do with them: load, watch and retire runs.

use std::borrow::Cow;

use crate::error::Error;
use crate::formulation::equations::{Evaluation, States};
use crate::formulation::system::System;
use crate::method::traits::Stats;
use crate::model::drive::{Drive, SegmentDrive};
use crate::model::energy::{Energies, WORKS, closure};
use crate::model::motion::Motion;
use crate::model::parameters::Parameters;
use crate::model::scene::Scene;
use crate::model::source::Source;
use crate::model::start::contact;
use crate::number::lanes::{Bits, LaneTask, Lanes, MOST, each};
use crate::number::simd::level::Instructions;
use crate::stepping::ending::{End, after_violation};
use crate::stepping::instant::{column, finite, ledger, put, put_motion, works};
use crate::stepping::monitor::{Limits, Set, VIOLATIONS, explain};
use crate::stepping::options::Options;
use crate::stepping::queue::{Equip, Finished, LaneParameters, RunQueue, Watched};
use crate::stepping::record::Instant;
use crate::stepping::status::Status;
use crate::stepping::summary::{Close, Sight, Summaries};

/// The run in a lane.
pub struct LaneRun<'a, P> {
    /// Its number.
    pub number: usize,
    /// What is simulated.
    pub scene: Cow<'a, Scene>,
    /// When each violation was first seen, s; NaN for never.
    pub first_times: [f64; VIOLATIONS.len()],
    /// The last instant that was watched, where the loop's last evaluation is another one: the run's start before anything was
    /// evaluated, the instant before an impulse, or one inside a step.
    pub held: Option<Watched>,
    /// Steps that it has taken.
    pub steps: u64,
    /// Stretches between breakpoints that it has entered.
    pub segments: u64,
    /// Where it is, as far as its loop needs to know.
    pub place: P,
}

/// What was seen at an instant of the runs in all lanes.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Lanes in which everything is finite.
    pub sound: Bits,
    /// Lanes whose run ends on a violation.
    pub ended: Bits,
    /// Where each of [`VIOLATIONS`] holds.
    pub found: [Bits; VIOLATIONS.len()],
}

/// The runs in the lanes, and what both step loops need of them. `P` is where a run is, as far as its loop needs to know.
pub struct LaneBatch<'a, R: Lanes, P, Q> {
    /// Where runs come from and go.
    pub queue: Q,
    /// How each run is simulated.
    pub options: &'a Options,
    instructions: Instructions,
    /// The run in each lane.
    pub runs: [Option<LaneRun<'a, P>>; MOST],
    /// Lanes that have a run.
    pub active: Bits,
    /// The inputs of each lane's segment.
    pub drive: SegmentDrive<R>,
    /// Counted work.
    pub stats: Stats,
    /// Parameters of a lane without a run.
    resting: Parameters,
    /// The motions that runs start with.
    start: Motion<R>,
    limits: Limits<R>,
    half_width: R,
    /// The energies at the runs' starts.
    begun: Energies<R>,
    /// Where each of [`VIOLATIONS`] has been seen, and whether it ends a run.
    noted: [Bits; VIOLATIONS.len()],
    stop_on: [Bits; VIOLATIONS.len()],
    summaries: Summaries<R>,
}

impl<'a, R: Lanes, P, Q: RunQueue<'a>> LaneBatch<'a, R, P, Q> {
    /// Without any run.
    #[inline(always)]
    pub fn new(instructions: Instructions, queue: Q, options: &'a Options) -> Self {
        let resting = Parameters::default();
        let lanes: LaneParameters<'_> = [&resting; MOST];
        let stops = |violation| if options.stop_on.contains(violation) { Bits::MAX } else { 0 };
        let zero = R::zero();
        Self {
            queue,
            options,
            instructions,
            runs: [const { None }; MOST],
            active: 0,
            drive: SegmentDrive::still(),
            stats: Stats::default(),
            start: Motion { q: [zero; 9], p: [zero; 9], memory: [zero; 2] },
            limits: Limits::new(&lanes),
            half_width: zero,
            begun: Energies { kinetic: zero, elastic: zero, gravity: zero },
            noted: [0; VIOLATIONS.len()],
            stop_on: VIOLATIONS.map(|(_, violation)| stops(violation)),
            summaries: Summaries::new(&options.summaries),
            resting,
        }
    }

    /// Puts the next run into a lane, at the place that its scene gives. `false` where there is none: then the lane, where others
    /// have runs, gets numbers that overflow nowhere, since the exact sine that these need would slow down all lanes.
    pub fn load_lane(
        &mut self,
        lane: usize,
        place: impl FnOnce(&Scene) -> Result<P, Error>,
    ) -> Result<bool, Error> {
        let bit = 1 << lane;
        self.active &= !bit;
        self.runs[lane] = None;
        let Some((number, scene)) = self.queue.take()? else {
            if R::WIDTH > 1 {
                self.drive.set(lane, &SegmentDrive::still());
                let still = Motion { q: contact(&self.resting)?, p: [0.0; 9], memory: [0.0; 2] };
                put_motion(&mut self.start, lane, &still);
            }
            return Ok(false);
        };
        let place = place(&scene)?;
        let initial = &scene.initial;
        let start = Motion { q: initial.q, p: initial.p, memory: initial.memory };
        put_motion(&mut self.start, lane, &start);
        for noted in &mut self.noted {
            *noted &= !bit;
        }
        self.summaries.restart(lane);
        self.active |= bit;
        let held = Some(Watched { instant: Instant::start(initial), works: [0.0; WORKS], linearized: None });
        let first_times = [f64::NAN; VIOLATIONS.len()];
        self.runs[lane] = Some(LaneRun { number, scene, first_times, held, steps: 0, segments: 0, place });
        Ok(true)
    }

    fn parameters(&self) -> LaneParameters<'_> {
        std::array::from_fn(|lane| {
            self.runs[lane].as_ref().map_or(&self.resting, |run| &run.scene.parameters)
        })
    }

    /// Makes equations and method, and gives the states that the runs start with.
    #[inline(always)]
    pub fn equip<S: System<R>, I>(&mut self, equip: &mut impl Equip<S, I>, y: &mut States<R>) -> (S, I) {
        let equipment = equip.equip(&self.parameters());
        self.begin(&equipment.0, R::ALL, y);
        equipment
    }

    /// The same in place, after the runs in the lanes of `fresh` have changed.
    #[inline(always)]
    pub fn renew<S: System<R>, I>(
        &mut self,
        equip: &mut impl Equip<S, I>,
        (system, method): (&mut S, &mut I),
        fresh: Bits,
        y: &mut States<R>,
    ) {
        equip.renew(&self.parameters(), system, method);
        self.begin(system, fresh, y);
    }

    /// Numbers of the runs in the lanes, of which those in `fresh` have changed, and the states that these start with.
    #[inline(always)]
    fn begin(&mut self, system: &impl System<R>, fresh: Bits, y: &mut States<R>) {
        (self.limits, self.half_width) = R::call(self.instructions, Numbers(&self.parameters()));
        let start = system.begin(&self.start);
        for (number, begun) in y.iter_mut().zip(start) {
            *number = R::select(fresh, begun, *number);
        }
        if system.size().ledger {
            let Energies { kinetic, elastic, gravity } = system.energies(&self.start);
            let begun = &mut self.begun;
            begun.kinetic = R::select(fresh, kinetic, begun.kinetic);
            begun.elastic = R::select(fresh, elastic, begun.elastic);
            begun.gravity = R::select(fresh, gravity, begun.gravity);
        }
    }

    /// Watches an instant of the lanes in `watched`: whether it is finite, what is violated, and the summaries.
    #[inline(always)]
    pub fn watch(
        &mut self,
        system: &impl System<R>,
        now: &Evaluation<R>,
        y: &States<R>,
        t: R,
        watched: Bits,
    ) -> Seen {
        let size = system.size();
        let closure = if size.ledger {
            closure(&self.begun, &system.energies(&now.motion), &works(size, y))
        } else {
            R::zero()
        };
        let sound = finite(now, closure);
        let seen = watched & sound;
        let found = self.limits.violated(&now.motion.q, &now.sin_tilt, &now.multipliers);
        let mut ended = 0;
        for violation in 0..VIOLATIONS.len() {
            let fresh = found[violation] & seen & !self.noted[violation];
            if fresh != 0 {
                self.note(violation, fresh, t);
            }
            ended |= found[violation] & seen & self.stop_on[violation];
        }
        if !self.summaries.is_empty() {
            let Evaluation { motion: Motion { q, p, .. }, multipliers, residuals, torque, .. } = *now;
            let half_width = self.half_width;
            self.summaries
                .watch(&Sight { t, q, p, multipliers, residuals, closure, half_width, torque }, seen);
        }
        Seen { sound, ended, found }
    }

    /// Notes the first time of a violation in the lanes of `fresh`.
    #[cold]
    #[inline(never)]
    fn note(&mut self, violation: usize, fresh: Bits, t: R) {
        self.noted[violation] |= fresh;
        for lane in each(fresh) {
            if let Some(run) = &mut self.runs[lane] {
                run.first_times[violation] = t.lane(lane);
            }
        }
    }

    /// How a violation that was seen at an instant ends the run of a lane; `None` where none does.
    #[cold]
    pub fn violation(&self, lane: usize, seen: &Seen, instant: &Instant) -> Option<End> {
        let run = self.runs[lane].as_ref()?;
        let violation = Set::of(&seen.found, lane).intersection(self.options.stop_on).first()?;
        let at = (instant.t, run.steps == 0);
        Some((Status::of(violation), explain(&run.scene.parameters, violation, at, &instant.q)))
    }

    /// Lets the impulses at time `t` strike the run in a lane, `tau` after its segment's start. Whether there were any.
    pub fn strike(
        &self,
        system: &impl System<R>,
        lane: usize,
        (t, tau): (f64, R),
        y: &mut States<R>,
    ) -> bool {
        let Some(run) = &self.runs[lane] else { return false };
        let mut struck = false;
        for impulse in run.scene.inputs.impulses_at(t) {
            let mut jumped = *y;
            R::call(self.instructions, Jump(system, (&self.drive, tau), &mut jumped, impulse.impulse));
            put(y, lane, &column(&jumped, lane));
            struck = true;
        }
        struck
    }

    /// Numbers of the motions of all lanes, as their runs' parameters give them.
    pub fn gathered(&self, of: impl Fn(&Parameters) -> Motion<f64>) -> Motion<R> {
        let zero = R::zero();
        let mut motion = Motion { q: [zero; 9], p: [zero; 9], memory: [zero; 2] };
        for lane in each(self.active) {
            let Some(run) = &self.runs[lane] else { continue };
            put_motion(&mut motion, lane, &of(&run.scene.parameters));
        }
        motion
    }

    /// Takes the run out of a lane, whose last instant is `last`.
    #[cold]
    #[inline(never)]
    pub fn retire_lane(&mut self, system: &impl System<R>, lane: usize, end: End, last: &Watched) {
        self.active &= !(1 << lane);
        let Some(run) = self.runs[lane].take() else { return };
        let (status, message) = after_violation(end, &run.first_times);
        let from = run.scene.initial.time.max(self.options.summaries.after);
        let close = Close { from, completed: status == Status::Completed };
        let begun = system.size().ledger.then(|| self.begun.lane(lane));
        let finished = Finished {
            number: run.number,
            status,
            message,
            last: *last,
            begun,
            first_times: run.first_times,
            summaries: self.summaries.values(lane, &close),
            stats: Stats { steps: run.steps, segments: run.segments, ..self.stats },
        };
        self.queue.finish(finished, |watched| ledger(system, watched));
    }

    /// Records an instant that was watched; how the run ends where there is no memory for it.
    #[inline(always)]
    pub fn record(&mut self, system: &impl System<R>, watched: &Watched) -> Result<(), Error> {
        self.queue.record(watched, |watched| ledger(system, watched))
    }
}

/// What lanes need of the parameters of their runs. It changes when a run does: called, not inlined.
struct Numbers<'a>(&'a LaneParameters<'a>);

impl<R: Lanes> LaneTask<R> for Numbers<'_> {
    type Output = (Limits<R>, R);

    #[inline(always)]
    fn run(self) -> (Limits<R>, R) {
        (Limits::new(self.0), self.0.number(|p| 0.5 * p.grasped.width))
    }
}

/// The velocity jumps that an impulse makes, if it strikes in all lanes.
struct Jump<'a, R, S>(&'a S, (&'a SegmentDrive<R>, R), &'a mut States<R>, [f64; 3]);

impl<R: Lanes, S: System<R>> LaneTask<R> for Jump<'_, R, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(system, (drive, tau), y, impulse) = self;
        system.jump(&drive.at(tau), y, &impulse.map(R::constant));
    }
}
