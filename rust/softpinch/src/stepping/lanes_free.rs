//! Steps as long as the error allows, of a run in each lane. Every lane has its own step, accepted or not; what is rare (the
//! start of a stretch, an impulse, a look inside a step) is computed for its lane alone. What happens in a lane is what
//! [`free`](super::free) does with one run.

use std::marker::PhantomData;

use crate::energy::{Energies, closure};
use crate::ensemble::{Row, Shared};
use crate::error::Error;
use crate::formulation::{Choice, Chosen, Evaluation, Motion, ROOM, States, System};
use crate::grid::Span;
use crate::inputs::SegmentDrive;
use crate::integrator::newton::largest;
use crate::integrator::step_control::StepControl;
use crate::integrator::{Adaptive, Allowed, FreeInLanes, Integrator, Runs, Stats, Step};
use crate::lanes::{Bits, LaneTask, Lanes, MOST, each};
use crate::monitor::{Limits, Monitor, Set, VIOLATIONS, turning};
use crate::parameters::Parameters;
use crate::simd::{Instructions, LaneKernel};
use crate::simulate::{Scene, Status};
use crate::stepping::free::{Attempt, Sizes, first_step, fitted, too_many, too_small, unresolved};
use crate::stepping::lanes::{column, motion, numbers, put, resting};
use crate::stepping::{End, after_violation, finite, half_width, overflow, strike, works};
use crate::summary::{Close, Sight, Summaries};

/// Every so many attempts the lanes ask whether they should stop.
const POLL: u64 = 1 << 8;

/// One thread's runs, compiled once for each level of instructions.
pub struct FreeLanes<'a, I> {
    shared: &'a Shared<'a>,
    choice: Choice,
    tolerance: f64,
    method: PhantomData<I>,
}

impl<'a, I> FreeLanes<'a, I> {
    /// Steps whose errors are below `tolerance`.
    pub fn new(shared: &'a Shared<'a>, choice: Choice, tolerance: f64) -> Self {
        Self { shared, choice, tolerance, method: PhantomData }
    }
}

/// A watched instant: when, q and p.
type Seen = (f64, [f64; 9], [f64; 9]);

/// The run in a lane, and where its steps are.
struct Pilot {
    run: usize,
    scene: Scene,
    /// Its equations, alone.
    system: Chosen<f64>,
    limits: Limits<f64>,
    /// When it starts and ends, and the stretch between breakpoints that it is in.
    span: Span,
    stretch: (f64, f64),
    drive: SegmentDrive,
    t: f64,
    tau: f64,
    /// The next attempt.
    h: f64,
    control: StepControl,
    last: Attempt,
    steps: u64,
    attempts: u64,
    seen: Seen,
    first_times: [f64; VIOLATIONS.len()],
}

impl Pilot {
    fn length(&self) -> f64 {
        let (from, to) = self.stretch;
        to - from
    }
}

/// The lanes: which run is in each, and what its steps need.
struct Squadron<'a, R: Lanes> {
    shared: &'a Shared<'a>,
    instructions: Instructions,
    choice: Choice,
    rows: Vec<Row>,
    pilots: [Option<Pilot>; MOST],
    parameters: [Parameters; MOST],
    system: Chosen<R>,
    limits: Limits<R>,
    half_width: R,
    drive: SegmentDrive<R>,
    begun: Energies<R>,
    noted: [Bits; VIOLATIONS.len()],
    summaries: Summaries<R>,
    sizes: Sizes<R>,
    /// Lanes that have a run.
    active: Bits,
    /// The state of those that have none.
    resting: States<f64>,
    y: States<R>,
    /// What the formulation says of the states.
    here: Evaluation<R>,
    tau: R,
}

/// The state of one run at a share `x` of the step just taken, to `next`, in a stretch that starts at `from`; and when that is.
struct Look<'a, A> {
    alone: A,
    system: &'a Chosen<f64>,
    drive: &'a SegmentDrive,
    step: &'a Step<'a>,
    next: &'a States<f64>,
    from: f64,
    x: f64,
}

impl<A: Adaptive<f64, Chosen<f64>>> LaneTask<f64> for Look<'_, A> {
    type Output = (f64, States<f64>);

    #[inline(always)]
    fn run(mut self) -> Self::Output {
        let Step { tau, h, .. } = *self.step;
        self.alone.prepare(self.system, self.drive, self.step, self.next, &mut Stats::default());
        let time = self.from + self.x.mul_add(h, tau);
        let x = (((time - self.from) - tau) / h).clamp(0.0, 1.0);
        let mut between = self.alone.interpolate(self.step, self.next, x);
        self.system.correct(self.drive, time - self.from, &mut between);
        (time, between)
    }
}

/// The first step of one run in a stretch of this length, from `y` with these rates.
struct First<'a> {
    place: (&'a Chosen<f64>, &'a SegmentDrive),
    control: &'a StepControl,
    sizes: &'a mut Sizes,
    y: &'a States<f64>,
    rate: &'a States<f64>,
    length: f64,
}

impl LaneTask<f64> for First<'_> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        self.sizes.note(self.place.0.size(), self.y, 1);
        first_step(self.place, self.control, self.sizes, (self.y, self.rate), self.length)
    }
}

/// Whether an instant of one run is finite.
struct Finite<'a>(&'a Evaluation<f64>, f64);

impl LaneTask<f64> for Finite<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        finite(self.0, self.1) != 0
    }
}

/// An instant of one lane, for its summaries.
struct Watch<'a, R>(&'a mut Summaries<R>, &'a Sight<R>, Bits);

impl<R: Lanes> LaneTask<R> for Watch<'_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.watch(self.1, self.2);
    }
}

impl<R: Lanes> Squadron<'_, R> {
    /// Puts the next run into an empty lane, and on with it until it can step. `false` where there is none.
    #[inline(never)]
    fn board<I: FreeInLanes>(&mut self, lane: usize, tolerance: f64) -> Result<bool, Error> {
        let options = self.shared.options;
        while let Some((run, scene)) = self.shared.take()? {
            let parameters = &scene.parameters;
            let system =
                Chosen::<f64>::new(self.instructions, self.choice, parameters, &options.stabilization);
            let motion = Motion { q: scene.initial.q, p: scene.initial.p, memory: scene.initial.memory };
            let y = system.begin(&motion);
            let own = Sizes::new(
                tolerance,
                &system.begin(&Motion::sizes(parameters)),
                &system.begin(&Motion::slow_sizes(parameters)),
            );
            put(&mut self.sizes.largest, lane, &own.largest);
            put(&mut self.sizes.round_off, lane, &own.round_off);
            if self.choice.ledger {
                let Energies { kinetic, elastic, gravity } = system.energies(&motion);
                self.begun.kinetic.set(lane, kinetic);
                self.begun.elastic.set(lane, elastic);
                self.begun.gravity.set(lane, gravity);
            }
            put(&mut self.y, lane, &y);
            for noted in &mut self.noted {
                *noted &= !(1 << lane);
            }
            self.summaries.restart(lane);
            self.parameters[lane] = parameters.clone();
            self.active |= 1 << lane;
            let span = Span::new(&scene.inputs, &scene.initial, scene.duration)?;
            self.pilots[lane] = Some(Pilot {
                run,
                system,
                limits: Limits::new(parameters),
                // `enter` goes on to the first one.
                stretch: (span.start, span.start),
                drive: SegmentDrive::still(),
                t: span.start,
                tau: 0.0,
                h: 0.0,
                control: StepControl::new(I::CONTROL.0, I::CONTROL.1),
                last: Attempt::None,
                steps: 0,
                attempts: 0,
                seen: (scene.initial.time, scene.initial.q, scene.initial.p),
                first_times: [f64::NAN; VIOLATIONS.len()],
                span,
                scene,
            });
            if self.enter(lane) {
                return Ok(true);
            }
        }
        self.vacate(lane);
        Ok(false)
    }

    /// Makes a lane one without a run, with the parameters of [`resting`]: it takes steps of length zero, and accepts none.
    fn vacate(&mut self, lane: usize) {
        self.parameters[lane] = Parameters::default();
        self.drive.set(lane, &SegmentDrive::still());
        self.tau.set(lane, 0.0);
        put(&mut self.y, lane, &self.resting);
        put(&mut self.here.rate, lane, &[0.0; ROOM]);
    }

    /// The start of a lane's next stretch, up to its first step. `false` where the run ended.
    #[inline(never)]
    fn enter(&mut self, lane: usize) -> bool {
        let Some(mut pilot) = self.pilots[lane].take() else { return false };
        let (_, from) = pilot.stretch;
        pilot.stretch = (from, pilot.span.stretch_end(&pilot.scene.inputs, from));
        pilot.drive = pilot.scene.inputs.segment(from);
        (pilot.t, pilot.tau, pilot.last) = (from, 0.0, Attempt::None);
        pilot.control.restart();
        self.drive.set(lane, &pilot.drive);
        self.tau.set(lane, 0.0);
        let mut y = column(&self.y, lane);
        let mut now = pilot.system.evaluate(&pilot.drive, 0.0, &y);
        let ended = self.watch_alone(lane, &mut pilot, from, &y, &now);
        if ended.is_none() {
            if strike(&pilot.scene, &pilot.system, &pilot.drive, (from, 0.0), &mut y) {
                now = pilot.system.evaluate(&pilot.drive, 0.0, &y);
                put(&mut self.y, lane, &y);
            }
            let Allowed { tolerance, weights } = &self.sizes.allowed;
            let mut sizes = Sizes {
                largest: column(&self.sizes.largest, lane),
                round_off: column(&self.sizes.round_off, lane),
                allowed: Allowed { tolerance: *tolerance, weights: column(weights, lane) },
            };
            pilot.h = f64::call(
                self.instructions,
                First {
                    place: (&pilot.system, &pilot.drive),
                    control: &pilot.control,
                    sizes: &mut sizes,
                    y: &y,
                    rate: &now.rate,
                    length: pilot.length(),
                },
            );
            put(&mut self.sizes.largest, lane, &sizes.largest);
            put(&mut self.sizes.allowed.weights, lane, &sizes.allowed.weights);
            put(&mut self.here.rate, lane, &now.rate);
            put(&mut self.here.motion.q, lane, &now.motion.q);
            put(&mut self.here.motion.p, lane, &now.motion.p);
        }
        self.pilots[lane] = Some(pilot);
        if let Some(end) = ended {
            self.leave(lane, end);
            return false;
        }
        true
    }

    /// Watches an instant of one lane. Gives what ends the run there.
    #[inline(never)]
    fn watch_alone(
        &mut self,
        lane: usize,
        pilot: &mut Pilot,
        t: f64,
        y: &States<f64>,
        now: &Evaluation<f64>,
    ) -> Option<End> {
        let closure = if self.choice.ledger {
            let begun = Energies {
                kinetic: self.begun.kinetic.lane(lane),
                elastic: self.begun.elastic.lane(lane),
                gravity: self.begun.gravity.lane(lane),
            };
            let energies = pilot.system.energies(&now.motion);
            closure(&begun, &energies, &works(pilot.system.size(), y))
        } else {
            0.0
        };
        if !f64::call(self.instructions, Finite(now, closure)) {
            return Some(overflow(pilot.seen.0));
        }
        let Motion { q, p, .. } = now.motion;
        let found = pilot.limits.violated(&q, &now.sin_tilt, &now.multipliers);
        for (k, bits) in found.into_iter().enumerate() {
            if bits != 0 && pilot.first_times[k].is_nan() {
                pilot.first_times[k] = t;
                self.noted[k] |= 1 << lane;
            }
        }
        if !self.summaries.is_empty() {
            let sight = Sight {
                t: R::constant(t),
                q: q.map(R::constant),
                p: p.map(R::constant),
                multipliers: now.multipliers.map(R::constant),
                residuals: now.residuals.map(R::constant),
                closure: R::constant(closure),
                half_width: R::constant(half_width(&pilot.scene.parameters)),
                torque: now.torque.map(R::constant),
            };
            R::call(self.instructions, Watch(&mut self.summaries, &sight, 1 << lane));
        }
        pilot.seen = (t, q, p);
        self.end_of(&found, 0, (t, pilot.steps == 0), &q, &pilot.scene.parameters)
    }

    /// How a violation of a lane of `found` ends its run.
    fn end_of(
        &self,
        found: &[Bits; VIOLATIONS.len()],
        lane: usize,
        instant: (f64, bool),
        q: &[f64; 9],
        parameters: &Parameters,
    ) -> Option<End> {
        let violation = Set::of(found, lane).intersection(self.shared.options.stop_on).first()?;
        Some((Status::of(violation), Monitor::new(parameters).explain(violation, instant, q)))
    }

    /// Takes the run out of a lane, and keeps its row.
    #[inline(never)]
    fn leave(&mut self, lane: usize, (status, message): End) {
        self.active &= !(1 << lane);
        let Some(pilot) = self.pilots[lane].take() else { return };
        let (status, message) = after_violation((status, message), &pilot.first_times);
        let from = pilot.scene.initial.time.max(self.shared.options.summaries.after);
        let close = Close { from, completed: status == Status::Completed };
        let (t, q, p) = pilot.seen;
        self.rows.push(Row {
            run: pilot.run,
            status,
            message,
            t,
            q,
            p,
            violations: pilot.first_times,
            steps: pilot.steps,
            summaries: self.summaries.values(lane, &close),
        });
        self.shared.finished();
    }

    /// Looks inside a step, where a tip seems to be lost and to come back. Gives what ends the run there.
    #[cold]
    #[inline(never)]
    fn look_inside<I: FreeInLanes>(
        &mut self,
        lane: usize,
        method: &I::Method<R>,
        (taken, next, there): (f64, &States<f64>, &Motion<f64>),
    ) -> Option<End> {
        let Self { instructions, choice, .. } = *self;
        let gains = &self.shared.options.stabilization;
        let mut pilot = self.pilots[lane].take()?;
        let (q, p) = (column(&self.here.motion.q, lane), column(&self.here.motion.p, lane));
        let before = Motion { q, p, memory: [0.0; 2] };
        let monitor = Monitor::new(&pilot.scene.parameters);
        let ended = monitor.between(&before, there, taken).and_then(|x| {
            let (y, rate) = (column(&self.y, lane), column(&self.here.rate, lane));
            let step = Step { tau: pilot.tau, h: taken, y: &y, rate: &rate, allowed: None };
            let run = Runs { instructions, choice, parameters: &pilot.scene.parameters, gains };
            let alone = I::alone(method, lane, run);
            let (from, _) = pilot.stretch;
            let look = Look { alone, system: &pilot.system, drive: &pilot.drive, step: &step, next, from, x };
            let (time, between) = f64::call(instructions, look);
            let then = pilot.system.evaluate(&pilot.drive, time - from, &between);
            self.watch_alone(lane, &mut pilot, time, &between, &then)
        });
        self.pilots[lane] = Some(pilot);
        ended
    }

    /// What the lanes' method and equations are made for.
    fn runs(&self) -> Runs<'_, [Parameters; MOST]> {
        let Self { instructions, choice, ref parameters, .. } = *self;
        Runs { instructions, choice, parameters, gains: &self.shared.options.stabilization }
    }

    /// Numbers of the lanes' parameters, after some have changed.
    fn rebuild(&mut self) {
        (self.system, self.limits, self.half_width) = numbers(self.runs());
    }
}

impl<I: FreeInLanes> LaneKernel for FreeLanes<'_, I> {
    type Output = Result<Vec<Row>, Error>;

    #[inline(always)]
    #[allow(clippy::too_many_lines)] // one step, from the attempt to the next
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { shared, choice, tolerance, .. } = self;
        let options = shared.options;
        let gains = &options.stabilization;
        let parameters: [Parameters; MOST] = std::array::from_fn(|_| Parameters::default());
        let resting = resting(instructions, choice, gains)?;
        let zero = R::zero();
        let (system, limits, half_width) =
            numbers::<R>(Runs { instructions, choice, parameters: &parameters, gains });
        let size = system.size();
        let mut squadron = Squadron::<R> {
            shared,
            instructions,
            choice,
            rows: Vec::new(),
            pilots: [const { None }; MOST],
            system,
            limits,
            half_width,
            parameters,
            drive: SegmentDrive::still(),
            begun: Energies { kinetic: zero, elastic: zero, gravity: zero },
            noted: [0; VIOLATIONS.len()],
            summaries: Summaries::new(&options.summaries),
            sizes: Sizes {
                largest: [R::constant(1.0); ROOM],
                round_off: [R::constant(1.0); ROOM],
                allowed: Allowed { tolerance, weights: [R::constant(1.0); ROOM] },
            },
            active: 0,
            resting,
            y: resting.map(R::constant),
            here: Evaluation::nothing(),
            tau: zero,
        };
        for lane in 0..R::WIDTH {
            if !squadron.board::<I>(lane, tolerance)? {
                break;
            }
        }
        squadron.rebuild();
        let mut method = I::new::<R>(squadron.runs());
        let (mut next, mut stats) = (squadron.y, Stats::default());
        let mut attempts = 0u64;

        while squadron.active != 0 {
            attempts += 1;
            if attempts.is_multiple_of(POLL) && shared.stops() {
                break;
            }
            // Lanes whose run has just ended.
            let mut left: Bits = 0;
            let mut h = zero;
            for lane in each(squadron.active) {
                let Some(pilot) = &mut squadron.pilots[lane] else { continue };
                let rest = pilot.length() - pilot.tau;
                let taken = fitted(pilot.h, rest);
                let end = if taken < rest && unresolved(taken, pilot.t, pilot.length()) {
                    Some(too_small(pilot.t, taken, pilot.last))
                } else if pilot.attempts == options.max_steps {
                    Some(too_many(pilot.t, taken, options.max_steps))
                } else {
                    None
                };
                pilot.attempts += 1;
                if let Some(end) = end {
                    squadron.leave(lane, end);
                    left |= 1 << lane;
                }
                h.set(lane, taken);
            }

            let here = squadron.here;
            let (y, tau) = (squadron.y, squadron.tau);
            let step = Step { tau, h, y: &y, rate: &here.rate, allowed: None };
            let Ok(()) = method.step(&squadron.system, &squadron.drive, &step, &mut next, &mut stats);
            let errors = I::errors(&method, size, h, &squadron.sizes.allowed.weights);
            let mut arrived = next;
            squadron.system.correct(&squadron.drive, tau + h, &mut arrived);
            let mut moved = [zero; ROOM];
            size.each(|n| moved[n] = arrived[n] - next[n]);
            let weights = &squadron.sizes.allowed.weights;
            let shifts = largest(size, &moved, weights);
            let mut accepted: Bits = 0;
            for lane in each(squadron.active) {
                let Some(pilot) = &mut squadron.pilots[lane] else { continue };
                let (own, shift, taken) = (errors.lane(lane), shifts.lane(lane), h.lane(lane));
                let error = if shift > own || shift.is_nan() { shift } else { own };
                pilot.last = Attempt::Error(error);
                match pilot.control.judge(error) {
                    Ok(growth) => {
                        pilot.h = growth * taken;
                        pilot.steps += 1;
                        accepted |= 1 << lane;
                    }
                    Err(shrink) => pilot.h = shrink * taken,
                }
            }

            if accepted != 0 {
                let there = squadron.system.evaluate(&squadron.drive, tau + h, &arrived);
                // Where a tip seems to be lost and to come back inside the step.
                for lane in each(turning(&here.motion, &there.motion) & accepted) {
                    let (next, motion) = (column(&next, lane), motion(&there.motion, lane));
                    let step = (h.lane(lane), &next, &motion);
                    if let Some(end) = squadron.look_inside::<I>(lane, &method, step) {
                        squadron.leave(lane, end);
                        left |= 1 << lane;
                        accepted &= !(1 << lane);
                    }
                }
                size.each(|n| {
                    squadron.y[n] = R::select(accepted, arrived[n], y[n]);
                    squadron.here.rate[n] = R::select(accepted, there.rate[n], here.rate[n]);
                });
                for k in 0..9 {
                    squadron.here.motion.q[k] = R::select(accepted, there.motion.q[k], here.motion.q[k]);
                    squadron.here.motion.p[k] = R::select(accepted, there.motion.p[k], here.motion.p[k]);
                }
                squadron.sizes.note(size, &arrived, accepted);
                let (mut t, mut watched) = (zero, accepted);
                let mut entering: Bits = 0;
                let mut done: Bits = 0;
                for lane in each(accepted) {
                    let Some(pilot) = &mut squadron.pilots[lane] else { continue };
                    let (from, to) = pilot.stretch;
                    let taken = h.lane(lane);
                    let end = if taken == (to - from) - pilot.tau { to } else { from + (pilot.tau + taken) };
                    (pilot.tau, pilot.t) = (pilot.tau + taken, end);
                    squadron.tau.set(lane, pilot.tau);
                    t.set(lane, end);
                    if end == to {
                        if to == pilot.span.end {
                            done |= 1 << lane;
                        } else {
                            // A breakpoint is watched under the inputs that hold from there on.
                            entering |= 1 << lane;
                        }
                    }
                }
                watched &= !entering;
                let closure = if size.ledger {
                    let energies = squadron.system.energies(&there.motion);
                    closure(&squadron.begun, &energies, &works(size, &arrived))
                } else {
                    zero
                };
                let sound = finite(&there, closure);
                let seen = watched & sound;
                let Motion { q, p, .. } = there.motion;
                let found = squadron.limits.violated(&q, &there.sin_tilt, &there.multipliers);
                if !squadron.summaries.is_empty() {
                    let Evaluation { multipliers, residuals, torque, .. } = there;
                    let half_width = squadron.half_width;
                    let sight = Sight { t, q, p, multipliers, residuals, closure, half_width, torque };
                    squadron.summaries.watch(&sight, seen);
                }
                let fresh: [Bits; VIOLATIONS.len()] =
                    [0, 1, 2, 3, 4, 5].map(|v: usize| found[v] & seen & !squadron.noted[v]);
                for v in 0..VIOLATIONS.len() {
                    squadron.noted[v] |= fresh[v];
                    for lane in each(fresh[v]) {
                        if let Some(pilot) = &mut squadron.pilots[lane] {
                            pilot.first_times[v] = t.lane(lane);
                        }
                    }
                }
                for lane in each(watched) {
                    let bit = 1 << lane;
                    let Some(pilot) = &mut squadron.pilots[lane] else { continue };
                    let mut end = (sound & bit == 0).then(|| overflow(pilot.seen.0));
                    if end.is_none() {
                        pilot.seen = (t.lane(lane), column(&q, lane), column(&p, lane));
                        if found.iter().any(|bits| bits & bit != 0) {
                            let (t, q, _) = pilot.seen;
                            let parameters = &squadron.parameters[lane];
                            end = squadron.end_of(&found, lane, (t, false), &q, parameters);
                        }
                        if end.is_none() && done & bit != 0 {
                            end = Some((Status::Completed, String::new()));
                        }
                    }
                    if let Some(end) = end {
                        squadron.leave(lane, end);
                        left |= bit;
                    }
                }
                for lane in each(entering) {
                    if !squadron.enter(lane) {
                        left |= 1 << lane;
                    }
                }
            }

            if left != 0 {
                for lane in each(left) {
                    squadron.board::<I>(lane, tolerance)?;
                }
                squadron.rebuild();
                method = I::new::<R>(squadron.runs());
            }
        }
        Ok(squadron.rows)
    }
}
