//! The source and the destination of the runs of step loops, the runs in the lanes of a loop, and the work of both loops
//! on them: loading, watching and retiring runs.

use std::borrow::Cow;

use crate::error::Result;
use crate::formulation::{
    Choice, Equations, Evaluation, Inlined, LaneParameters, SceneEquations, Size, States, System,
};
use crate::method::{Integrator, Runs, Stats};
use crate::model::energy;
use crate::model::{
    BILATERAL_WORKS, ContactModel, Energies, Motion, Parameters, Scene, SegmentDrive, Source, WORKS, apart,
};
use crate::number::{Bits, LaneTask, Lanes, MOST, each, inlined, task};
use crate::stepping::ending::{after_violation, unstable};
use crate::stepping::instant::{energies, put_motion};
use crate::stepping::monitor::{Margins, explain};
use crate::stepping::phase::Phases;
use crate::stepping::summary::RunEnd;
use crate::stepping::{
    End, GridOf, Instant, LaneContact, LaneController, Limits, Options, Phase, Recordable, Recorder,
    Recording, Run, Status, Steps, Summaries, Summary, SummaryInstant, SummarySet, VIOLATIONS, Violation,
    ViolationSet, all_finite, watched,
};

/// A closure error of the ledger below this share of the energy of gravity, whose zero is arbitrary, is round-off. So is
/// one below its square times E a^3 of the tips, even if the motion was given no energy at all.
const ROUND_OFF: f64 = 1e-9;

/// Number of steps or attempts after which a loop asks whether to stop. They take a few milliseconds.
pub const POLL: u64 = 1 << 12;

pub struct Taken<'a> {
    pub number: usize,
    pub scene: Cow<'a, Scene>,
    /// The contacts of an earlier run with the same parameters, if they were kept.
    pub contact: Option<Box<LaneContact>>,
}

/// The source and the destination of the runs of a step loop, which is compiled once for all of them.
pub struct RunQueue<'a> {
    /// The next run, or `None` if there is none.
    pub take: &'a mut dyn FnMut() -> Result<Option<Taken<'a>>>,
    pub stops: &'a dyn Fn() -> bool,
    pub finish: &'a mut dyn FnMut(Finished),
    pub recorder: Recorder<'a>,
}

pub struct Finished {
    pub number: usize,
    pub run: Run,
    pub contact: Option<Box<LaneContact>>,
}

/// The runs of one thread, over the times of `grid` if steps are equal. They have been checked.
pub struct RunLoop<'a> {
    pub queue: RunQueue<'a>,
    pub grid: &'a GridOf<'a>,
    pub options: &'a Options,
    /// One of the scenes. All have the same kinds of parts, fingers and inputs.
    pub scene: &'a Scene,
}

pub struct LaneRun<'a, P> {
    pub number: usize,
    pub scene: Cow<'a, Scene>,
    pub first_times: [f64; VIOLATIONS.len()],
    /// The last watched instant, if it is not the last one that the loop evaluated: the start of the run
    /// before any evaluation, the instant before an impulse, or an instant inside a step.
    pub saved_instant: Option<Instant>,
    pub segments: u64,
    pub contact: Option<Box<LaneContact>>,
    pub controller: Option<Box<LaneController>>,
    /// The place of the run in time, in the form that its loop needs.
    pub place: P,
}

pub struct Seen {
    pub finite: Bits,
    /// Lanes whose run ends because of a violation, or because its steps are unstable.
    pub ended: Bits,
    unstable: Bits,
    /// For each of [`VIOLATIONS`] the lanes in which it holds.
    pub found: [Bits; VIOLATIONS.len()],
}

/// The runs in the lanes, and the data that both step loops need of them. `P` is the place of a run in time,
/// in the form that its loop needs.
pub struct LaneBatch<'a, R, P> {
    pub queue: RunQueue<'a>,
    pub options: &'a Options,
    choice: Choice,
    pub runs: [Option<LaneRun<'a, P>>; MOST],
    pub phases: Phases,
    pub drive: SegmentDrive<R>,
    pub stats: Stats,
    /// Parameters for lanes without a run.
    resting: Parameters,
    start: Motion<R>,
    pub(super) limits: Limits<R>,
    half_width: R,
    initial_energies: Energies<R>,
    /// Lanes whose steps may be unstable, the energy that their motion was given at most so far, and the closure
    /// error of their ledger at the last watched instant.
    guarded: Bits,
    supplied: R,
    open: R,
    /// For each of [`VIOLATIONS`] the lanes in which it has been seen, and the lanes whose run it ends.
    pub(super) noted: [Bits; VIOLATIONS.len()],
    stop_on: [Bits; VIOLATIONS.len()],
    /// In a loop of one lane: whether the last watched instant showed any violation.
    shown: Bits,
    pub unilateral: bool,
    /// Whether contacts or a discrete controller may make a lane hold its state while an instant is evaluated again.
    pub holds: bool,
    /// For each of [`VIOLATIONS`] the lanes in which an event has shown it since the last watched instant.
    pub(super) occurred: [Bits; VIOLATIONS.len()],
    /// The lanes in which each tip was free and beyond the end of its side at the end of the last step.
    pub(super) beyond: [Bits; 2],
    /// Lanes whose grasp has not held since the summaries' `after`.
    lost_grip: Bits,
    summaries: Summaries<R>,
}

impl<'a, R: Lanes, P> LaneBatch<'a, R, P> {
    #[inline(always)]
    pub fn new(RunLoop { queue, options, scene, .. }: RunLoop<'a>) -> Self {
        let resting = Parameters::default();
        let lanes: LaneParameters<'_> = [&resting; MOST];
        let stops = |violation| if options.stop_on.contains(violation) { Bits::MAX } else { 0 };
        let zero = R::zero();
        Self {
            queue,
            options,
            choice: options.choice(&scene.inputs),
            runs: [const { None }; MOST],
            phases: Phases::idle(),
            drive: SegmentDrive::still(),
            stats: Stats::default(),
            start: Motion::zero(),
            limits: R::outlined(Numbers { source: &lanes }).0,
            half_width: zero,
            initial_energies: Energies { kinetic: zero, elastic: zero, gravity: zero },
            guarded: 0,
            supplied: zero,
            open: zero,
            noted: [0; VIOLATIONS.len()],
            stop_on: VIOLATIONS.map(|(_, violation)| stops(violation)),
            shown: 0,
            unilateral: options.contact == ContactModel::Unilateral,
            holds: options.contact == ContactModel::Unilateral,
            occurred: [0; VIOLATIONS.len()],
            beyond: [0; 2],
            lost_grip: 0,
            summaries: Summaries::new(&options.summaries),
            resting,
        }
    }

    /// Loads the next run into a lane, at the place that `place` gives for its number and scene. Returns `false` if
    /// there is no next run. If there are several lanes, this one then gets numbers that never overflow:
    /// after an overflow it would need the exact sine, which would slow down all lanes.
    pub fn load_lane(&mut self, lane: usize, place: impl FnOnce(usize, &Scene) -> Result<P>) -> Result<bool> {
        let bit = 1 << lane;
        self.phases.set(bit, Phase::Idle);
        self.runs[lane] = None;
        let Some(Taken { number, scene, contact: kept }) = (self.queue.take)()? else {
            if R::WIDTH > 1 {
                self.drive.set(lane, &SegmentDrive::still());
                let still = Motion { q: apart(&self.resting)?, ..Motion::zero() };
                put_motion(&mut self.start, lane, &still);
            }
            return Ok(false);
        };
        // Lanes without a run must have the kinds of the others.
        self.resting = Parameters::default().of_the_kinds(&scene.parameters);
        let place = place(number, &scene)?;
        let initial = &scene.initial;
        put_motion(&mut self.start, lane, &initial.motion);
        let sets = [&mut self.guarded, &mut self.shown, &mut self.lost_grip];
        for set in self.noted.iter_mut().chain(&mut self.occurred).chain(&mut self.beyond).chain(sets) {
            *set &= !bit;
        }
        if self.options.guard {
            self.guarded |= Bits::from(self.options.may_be_unstable(&scene)) << lane;
        }
        self.summaries.restart(lane);
        self.phases.set(bit, Phase::Start);
        let saved_instant = Some(Instant::start(initial));
        let contact = if self.unilateral {
            let new = || Box::new(LaneContact::new(self.options, &scene));
            let mut contact = kept.unwrap_or_else(new);
            contact.restart(self.options, &scene)?;
            contact.run.put_into(&mut self.drive.contacts, lane);
            self.queue.recorder.start = Some((initial.time, contact.run.modes()));
            Some(contact)
        } else {
            None
        };
        let controller = LaneController::new(&scene)?;
        self.holds |= controller.is_some();
        self.runs[lane] = Some(LaneRun {
            number,
            scene,
            first_times: [f64::NAN; VIOLATIONS.len()],
            saved_instant,
            segments: 0,
            contact,
            controller,
            place,
        });
        Ok(true)
    }

    /// Begins the segment of a lane that starts at `anchor` and goes on at the time `t`. Without a time it only sets the inputs
    /// before a sample of the discrete controller, which measures under the torques so far.
    pub(super) fn enter_segment(&mut self, lane: usize, anchor: f64, t: Option<f64>) {
        let Some(run) = &mut self.runs[lane] else { return };
        let inputs = &run.scene.inputs;
        let free = run.controller.is_none().then(|| inputs.segment(anchor));
        let controlled = run.controller.as_mut().map(|controller| controller.segment(inputs, anchor, t));
        let Some(drive) = free.as_ref().or(controlled) else { return };
        self.drive.set(lane, drive);
        if t.is_none() {
            return;
        }
        if let Some(contact) = &mut run.contact {
            contact.enter(anchor, drive.clone());
        }
        run.segments += 1;
    }

    /// Lets the discrete controller of a lane measure the instant `t`, which was just evaluated.
    pub(super) fn take_sample(&mut self, lane: usize, t: f64, now: &Evaluation<R>) {
        let Some(run) = &mut self.runs[lane] else { return };
        let Some(controller) = &mut run.controller else { return };
        let scene = (&*run.scene, run.contact.as_deref());
        controller.sample(scene, self.options, t, (now, lane));
    }

    fn parameters(&self) -> LaneParameters<'_> {
        std::array::from_fn(|lane| {
            self.runs[lane].as_ref().map_or(&self.resting, |run| &run.scene.parameters)
        })
    }

    /// Makes the equations and the method, and sets the states with which the runs start.
    #[inline(always)]
    pub fn build<S: LoopSystem<R>, I>(
        &mut self,
        build: impl FnOnce(Runs<'_>) -> (S, I),
        y: &mut States<R>,
    ) -> (S, I) {
        let built = build(self.lane_runs());
        self.begin(built.0.called(), R::ALL, y);
        built
    }

    fn lane_runs(&self) -> Runs<'_> {
        let Self { choice, options, .. } = *self;
        Runs { choice, parameters: self.parameters(), gains: &options.stabilization }
    }

    /// Renews the equations and the method in place, after the lanes of `changed` have got new runs, and sets
    /// the states with which these runs start.
    #[inline(always)]
    pub fn renew<S: LoopSystem<R>>(
        &mut self,
        (system, method): (&mut S, &mut (impl Integrator<R, S> + ?Sized)),
        changed: Bits,
        y: &mut States<R>,
    ) {
        let runs = self.lane_runs();
        system.renew(runs);
        method.renew(runs);
        self.begin(system.called(), changed, y);
    }

    /// Renews what depends on the runs, and sets the states with which the runs in the lanes of `changed` start.
    #[inline(always)]
    fn begin(&mut self, system: &SceneEquations<R>, changed: Bits, y: &mut States<R>) {
        let round_off;
        (self.limits, self.half_width, round_off) = R::outlined(Numbers { source: &self.parameters() });
        self.limits.ends = self.options.stop_on;
        let start = system.begin(&self.start);
        for (number, initial) in y.iter_mut().zip(start) {
            *number = R::select(changed, initial, *number);
        }
        if system.size().works > 0 {
            let Energies { kinetic, elastic, gravity } = system.energies(&self.drive.contacts, &self.start);
            let initial = &mut self.initial_energies;
            initial.kinetic = R::select(changed, kinetic, initial.kinetic);
            initial.elastic = R::select(changed, elastic, initial.elastic);
            initial.gravity = R::select(changed, gravity, initial.gravity);
            self.supplied = R::select(changed, round_off, self.supplied);
        }
    }

    /// Watches an instant of the lanes in `watched`: checks that its numbers are finite, looks for
    /// violations, and updates the summaries.
    #[inline(always)]
    pub fn watch(
        &mut self,
        system: &impl LoopSystem<R>,
        now: &Evaluation<R>,
        y: &States<R>,
        t: R,
        watched: Bits,
    ) -> Seen {
        let size = system.size();
        let (mut closure, mut unstable) = (R::zero(), 0);
        if size.works > 0 {
            let energies = system.called().energies(&self.drive.contacts, &now.motion);
            let works = &y[size.states..][..size.works];
            closure = energy::closure(&self.initial_energies, &energies, works);
            let guarded = self.guarded & watched;
            if guarded != 0 {
                unstable = self.beyond_supply(&energies, works, closure, guarded);
            }
        }
        let finite = all_finite(now, closure);
        let seen = watched & finite;
        let found =
            if self.unilateral { self.violated(now, watched) } else { self.limits.violated(now, None) };
        // Most instants show nothing.
        let (mut any, mut ended) = (0, 0);
        for bits in found {
            any |= bits & seen;
        }
        if any != 0 {
            for violation in 0..VIOLATIONS.len() {
                let first_seen = found[violation] & seen & !self.noted[violation];
                if first_seen != 0 {
                    self.note(violation, first_seen, t);
                }
                ended |= found[violation] & seen & self.stop_on[violation];
            }
            let loses = (found[Violation::Pulling as usize] | found[Violation::Slipping as usize]) & seen;
            if !self.unilateral {
                self.lost_grip |= loses & self.summaries.after.at_most(t);
            }
        }
        if R::WIDTH == 1 && seen != 0 && any | self.shown != 0 {
            self.queue.recorder.intervals.note(t.lane(0), ViolationSet::of(&found, 0));
            self.shown = any;
        }
        if self.summaries.wanted.set != SummarySet::default() {
            let instant =
                SummaryInstant { t, now, slipped: size.slipped(y), closure, half_width: self.half_width };
            self.summaries.watch(&instant, seen);
            if self.summaries.wanted.set.contains(Summary::Margin) {
                let contacts = self.unilateral.then_some(&self.drive.contacts);
                let (limits, stop_on, seen) =
                    (&self.limits, self.options.stop_on, seen & self.summaries.after.at_most(t));
                let memory = &mut self.summaries.memory[Summary::Margin as usize];
                R::outlined(Margins { limits, now, contacts, stop_on, memory, seen });
            }
        }
        unstable &= seen;
        Seen { finite, ended: ended | unstable, unstable, found }
    }

    /// The violations of unilateral contact at an instant, with those that events have shown before it.
    #[inline(always)]
    fn violated(&mut self, now: &Evaluation<R>, watched: Bits) -> [Bits; VIOLATIONS.len()] {
        let mut found = self.limits.violated(now, Some(&self.drive.contacts));
        for (found, occurred) in found.iter_mut().zip(&mut self.occurred) {
            *found |= *occurred & watched;
            *occurred &= !watched;
        }
        found
    }

    /// Those of the `guarded` lanes whose energy ledger is open by more than the energy that their motion was ever
    /// given: at its start, by torques, forces and impulses, and by gravity. Steps beyond the stability limit create
    /// energy from nothing; steps within it leave the ledger open by a small share of what the motion exchanges.
    ///
    /// All other lanes keep what they were given: their energies and works may be those of a trial.
    #[inline(always)]
    fn beyond_supply(&mut self, energies: &Energies<R>, works: &[R], closure: R, guarded: Bits) -> Bits {
        let &[control, external, ..] = works else { return 0 };
        let initial = &self.initial_energies;
        let fallen = energies.gravity - initial.gravity;
        let known =
            (initial.kinetic.abs() + initial.elastic.abs()) + R::constant(ROUND_OFF) * initial.gravity.abs();
        let mut given = known + ((control.abs() + external.abs()) + fallen.abs());
        if works.len() == BILATERAL_WORKS + 1 || works.len() == WORKS {
            given = given + works[works.len() - 1].abs();
        }
        self.supplied = self.supplied.max_in(given, guarded);
        self.open = closure;
        self.supplied.less(closure.abs()) & guarded
    }

    #[cold]
    #[inline(never)]
    fn note(&mut self, violation: usize, first_seen: Bits, t: R) {
        self.noted[violation] |= first_seen;
        for lane in each(first_seen) {
            if let Some(run) = &mut self.runs[lane] {
                run.first_times[violation] = t.lane(lane);
            }
        }
    }

    /// The end of the run in a lane because of a violation at an instant; `None` if no violation ends it.
    #[cold]
    pub fn violation(&self, lane: usize, seen: &Seen, instant: &Instant) -> Option<End> {
        let run = self.runs[lane].as_ref()?;
        if seen.unstable >> lane & 1 != 0 {
            let (Steps::Fixed(dt), scene) = (&self.options.steps, &run.scene) else { return None };
            let found = (self.open.lane(lane), self.supplied.lane(lane));
            let h = dt.min(scene.duration) / f64::from(self.options.refine);
            return Some(unstable(instant.t, h, found, self.options.surely_stable_step(scene)));
        }
        let (shown, stop_on) = (ViolationSet::of(&seen.found, lane), self.options.stop_on);
        let ends = |&violation: &Violation| shown.contains(violation) && stop_on.contains(violation);
        let violation = VIOLATIONS.into_iter().map(|(_, violation)| violation).find(ends)?;
        let begins = instant.t == run.scene.initial.time;
        let mut instant = *instant;
        if self.unilateral && matches!(violation, Violation::Slipping | Violation::Opened) {
            // Events know the time.
            instant.t = run.first_times[violation as usize];
        }
        Some((Status::of(violation), explain(&run.scene.parameters, violation, begins, &instant)))
    }

    /// An instant of the run in a lane, as evaluated at the state `y`.
    #[inline(always)]
    pub fn instant(
        &self,
        lane: usize,
        size: Size,
        (now, y): (&Evaluation<R>, &States<R>),
        t: f64,
        grid: (f64, u64),
    ) -> Instant {
        let run = self.runs[lane].as_ref().filter(|_| self.unilateral);
        let contact = run.and_then(|run| run.contact.as_ref()).map(|contact| contact.row());
        watched(size, (lane, contact), now, y, t, grid)
    }

    /// Gathers the motions that `of` gives for the parameters of each lane's run.
    pub fn gathered(&self, of: impl Fn(&Parameters) -> Motion<f64>) -> Motion<R> {
        let mut motion = Motion::zero();
        for lane in each(self.active()) {
            let Some(run) = &self.runs[lane] else { continue };
            put_motion(&mut motion, lane, &of(&run.scene.parameters));
        }
        motion
    }

    /// Removes the run from a lane, at its `last` instant and after so many steps.
    #[cold]
    #[inline(never)]
    pub fn retire_lane(
        &mut self,
        system: &SceneEquations<R>,
        lane: usize,
        end: End,
        last: &Instant,
        steps: u64,
    ) {
        self.phases.set(1 << lane, Phase::Ended);
        let Some(mut run) = self.runs[lane].take() else { return };
        let (status, message) = after_violation(end, last.t, &run.first_times);
        let from = run.scene.initial.time.max(self.options.summaries.after);
        let completed = status == Status::Completed;
        let found = run.contact.as_mut().map(|contact| (contact.free_time(last.t), contact.is_closed()));
        let (free_time, closed) = found.unwrap_or((0.0, true));
        let holds = completed && closed && self.lost_grip >> lane & 1 == 0;
        let missing = (run.scene.initial.time + run.scene.duration - last.t) / run.scene.duration;
        let run_end = RunEnd { from, completed, holds, missing, free_time, slipped: last.slipped };
        let initial_energies = (system.size().works > 0).then(|| self.initial_energies.lane(lane));
        let controller = run.controller.map(|controller| {
            let mut row = Vec::new();
            controller.put_row(last, &mut row);
            row
        });
        let mut finished = Run {
            recording: Recording::default(),
            last: *last,
            controller,
            initial_energies,
            branches: 4 * run.scene.parameters.branches(),
            status,
            message,
            first_times: run.first_times,
            violation_intervals: Vec::new(),
            contact_changes: Vec::new(),
            holds,
            summaries: self.summaries.values(lane, &run_end),
            stats: Stats { steps, segments: run.segments, ..self.stats },
        };
        if R::WIDTH == 1 {
            finished = self.queue.recorder.finish(finished, || energies(system, last));
        }
        (self.queue.finish)(Finished { number: run.number, run: finished, contact: run.contact });
    }

    /// Records a watched instant. The error says that there is no memory for it.
    #[inline(always)]
    pub fn record(&mut self, system: &SceneEquations<R>, watched: &Instant) -> Result {
        // A recorded run has a loop of its own, in lane 0.
        if self.options.record.contains(Recordable::State)
            && let Some(LaneRun { controller: Some(controller), .. }) = &self.runs[0]
        {
            controller.put_row(watched, &mut self.queue.recorder.controller);
        }
        self.queue.recorder.record(watched, || energies(system, watched))
    }

    inlined! {
        pub active(&self) -> Bits = R::ALL & self.phases.active();
        /// Whether to record the instant `t`, which was just watched. One inside a step is recorded only if asked for. Only
        /// loops of one lane record runs.
        pub is_due(&mut self, t: f64, inside: bool) -> bool = R::WIDTH == 1 && self.queue.recorder.is_due(t, inside);
        /// The first instant that was asked for and is not recorded yet; infinity if there is none.
        pub next_time(&self) -> f64 = if R::WIDTH == 1 { self.queue.recorder.next_time() } else { f64::INFINITY };
    }
}

task! {
    /// Computes the data of the lanes that depend on the parameters of their runs: the limits, half the width of the
    /// object, and an energy that is round-off for the tips. They change only when a run does, so the code is called.
    ['a, R: Lanes] Numbers<'a>(source: &'a LaneParameters<'a>) for R => (Limits<R>, R, R) = {
        let of_tip = |p: &Parameters, i: usize| {
            let radius = p.tips[i].radius;
            (ROUND_OFF * radius).powi(2) * (p.modulus(i) * radius)
        };
        let energy = source.number(|p| of_tip(p, 0) + of_tip(p, 1));
        (Limits::new(source), source.number(|p| 0.5 * p.grasped.width), energy)
    }
}

/// Equations for a step loop. The loop of RK4 has them inlined; its rare work calls them, so that its code exists once.
pub trait LoopSystem<R: Lanes>: System<R> {
    fn called(&self) -> &SceneEquations<R>;

    fn renew(&mut self, runs: Runs<'_>);
}

impl<R: Lanes> LoopSystem<R> for SceneEquations<R> {
    inlined! {
        called(&self) -> &SceneEquations<R> = self;
        renew(&mut self, runs: Runs<'_>) -> () = *self = runs.system();
    }
}

impl<E: Equations<f64>, const DRIVEN: bool> LoopSystem<f64> for Inlined<'_, f64, E, DRIVEN> {
    inlined! {
        called(&self) -> &SceneEquations<f64> = self.called;
        /// The equations are those of a single run, whose loop has no other one.
        renew(&mut self, _runs: Runs<'_>) -> () = ();
    }
}
