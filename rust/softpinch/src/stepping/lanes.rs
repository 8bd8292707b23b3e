//! Equal steps between breakpoints, of a run in each lane. Every lane has its own breakpoints, steps and parameters, and
//! takes the next run as soon as its own has ended. What happens in a lane is what [`fixed`](super::fixed) does with one run.

use std::marker::PhantomData;

use crate::energy::{Energies, closure};
use crate::ensemble::{Row, Shared};
use crate::error::Error;
use crate::formulation::{Choice, Chosen, Evaluation, Motion, States, System};
use crate::grid::{Grid, Segment};
use crate::inputs::{Drive, SegmentDrive};
use crate::integrator::{InLanes, Integrator, Runs, Stats, Step};
use crate::lanes::{Bits, LaneTask, Lanes, MOST, each};
use crate::monitor::{Limits, Monitor, Set, VIOLATIONS};
use crate::parameters::{Parameters, Stabilization};
use crate::simd::{Instructions, LaneKernel};
use crate::simulate::{Scene, Status};
use crate::start::contact;
use crate::stepping::{after_violation, finite, half_width, overflow, works};
use crate::summary::{Close, Sight, Summaries};

/// Every so many steps the lanes ask whether they should stop.
const POLL: u64 = 1 << 10;

/// One thread's runs, compiled once for each level of instructions.
pub struct FixedLanes<'a, I> {
    shared: &'a Shared<'a>,
    choice: Choice,
    dt: f64,
    method: PhantomData<I>,
}

impl<'a, I> FixedLanes<'a, I> {
    /// Steps of at most `dt`.
    pub fn new(shared: &'a Shared<'a>, choice: Choice, dt: f64) -> Self {
        Self { shared, choice, dt, method: PhantomData }
    }
}

/// The run in a lane.
struct Occupant {
    run: usize,
    scene: Scene,
    grid: Grid,
    /// The segment that it is in, the one before, and the steps taken until its start.
    segment: Segment,
    earlier: Option<Segment>,
    steps_before: u64,
    /// The clock when the segment ends.
    arrival: u64,
    first_times: [f64; VIOLATIONS.len()],
    /// The state before the impulses that last struck, and the clock of the first instant after.
    unstruck: Option<(u64, States<f64>)>,
}

impl Occupant {
    fn new(run: usize, scene: Scene, dt: f64) -> Result<Self, Error> {
        let grid = Grid::new(&scene.inputs, &scene.initial, scene.duration, dt, 1)?;
        Ok(Self {
            run,
            scene,
            segment: grid.first,
            earlier: None,
            steps_before: 0,
            grid,
            arrival: 0,
            first_times: [f64::NAN; VIOLATIONS.len()],
            unstruck: None,
        })
    }

    /// Goes on to the next segment. `false` where there is none.
    fn advance(&mut self) -> bool {
        let Some(next) = self.grid.after(&self.scene.inputs, &self.segment) else { return false };
        self.steps_before += self.segment.steps();
        self.earlier = Some(std::mem::replace(&mut self.segment, next));
        true
    }

    /// Steps taken in its segment at this clock, by this run or one that it goes on from.
    fn step(&self, clock: u64) -> u64 {
        self.segment.count - (self.arrival - clock)
    }

    /// Steps that it has taken in all.
    fn steps(&self, clock: u64) -> u64 {
        self.steps_before + self.step(clock) - self.segment.first
    }

    /// The instant before: its segment, and the steps taken since that one's start.
    fn before(&self, clock: u64) -> (Segment, u64) {
        match (self.step(clock) - self.segment.first, self.earlier) {
            (0, None) => (self.segment, self.segment.first),
            (0, Some(earlier)) => (earlier, earlier.count - 1),
            _ => (self.segment, self.step(clock) - 1),
        }
    }

    /// Its motion, at state `y`.
    fn motion(&self, alone: &Chosen<f64>, (segment, step): (Segment, u64), y: &States<f64>) -> Motion<f64> {
        let drive = self.scene.inputs.segment(segment.anchor);
        alone.evaluate(&drive, segment.tau(step), y).motion
    }
}

/// The lanes: which run is in each, and what its steps need.
struct Fleet<'a, R: Lanes> {
    shared: &'a Shared<'a>,
    instructions: Instructions,
    choice: Choice,
    dt: f64,
    rows: Vec<Row>,
    occupants: [Option<Occupant>; MOST],
    parameters: [Parameters; MOST],
    system: Chosen<R>,
    limits: Limits<R>,
    half_width: R,
    drive: SegmentDrive<R>,
    anchor: R,
    /// Steps taken since the anchor, and how long they are.
    taken: R,
    h: R,
    /// The energies at the runs' starts.
    begun: Energies<R>,
    /// Where each of [`VIOLATIONS`] has been seen.
    noted: [Bits; VIOLATIONS.len()],
    summaries: Summaries<R>,
    /// Lanes that have a run.
    active: Bits,
    /// Of these, those at their runs' first instants, and at their last.
    fresh: Bits,
    arrived: Bits,
    /// Those whose impulses strike now, and those whose impulses have struck, so that the instant has been seen.
    striking: Bits,
    struck: Bits,
    clock: u64,
    /// When the next segment of any lane ends.
    arrival: u64,
}

impl<'a, R: Lanes> Fleet<'a, R> {
    /// Without any run.
    #[inline(always)]
    fn new(instructions: Instructions, shared: &'a Shared<'a>, choice: Choice, dt: f64) -> Self {
        let parameters: [Parameters; MOST] = std::array::from_fn(|_| Parameters::default());
        let gains = &shared.options.stabilization;
        let (system, limits, half_width) =
            numbers(Runs { instructions, choice, parameters: &parameters, gains });
        Self {
            shared,
            instructions,
            choice,
            dt,
            rows: Vec::new(),
            occupants: [const { None }; MOST],
            system,
            limits,
            half_width,
            parameters,
            drive: SegmentDrive::still(),
            anchor: R::zero(),
            taken: R::zero(),
            h: R::zero(),
            begun: Energies { kinetic: R::zero(), elastic: R::zero(), gravity: R::zero() },
            noted: [0; VIOLATIONS.len()],
            summaries: Summaries::new(&shared.options.summaries),
            active: 0,
            fresh: 0,
            arrived: 0,
            striking: 0,
            struck: 0,
            clock: 0,
            arrival: u64::MAX,
        }
    }

    /// Puts a run into a lane; it is at its start when the clock says `from`. Gives its state.
    #[inline(never)]
    fn board(&mut self, lane: usize, run: usize, scene: Scene, from: u64) -> Result<States<f64>, Error> {
        let bit = 1 << lane;
        self.parameters[lane] = scene.parameters.clone();
        let alone = self.alone(&scene.parameters);
        let initial = &scene.initial;
        let motion = Motion { q: initial.q, p: initial.p, memory: initial.memory };
        let y = alone.begin(&motion);
        if self.choice.ledger {
            let Energies { kinetic, elastic, gravity } = alone.energies(&motion);
            self.begun.kinetic.set(lane, kinetic);
            self.begun.elastic.set(lane, elastic);
            self.begun.gravity.set(lane, gravity);
        }
        self.occupants[lane] = Some(Occupant::new(run, scene, self.dt)?);
        self.active |= bit;
        self.fresh |= bit;
        for noted in &mut self.noted {
            *noted &= !bit;
        }
        self.summaries.restart(lane);
        self.enter(lane, from);
        Ok(y)
    }

    /// Puts a lane at the start of its segment, where it is when the clock says `from`.
    fn enter(&mut self, lane: usize, from: u64) {
        let Some(occupant) = &mut self.occupants[lane] else { return };
        let Segment { anchor, start, h, first, count, .. } = occupant.segment;
        occupant.arrival = from + (count - first);
        self.drive.set(lane, &occupant.scene.inputs.segment(anchor));
        self.anchor.set(lane, anchor);
        self.h.set(lane, h);
        #[allow(clippy::cast_precision_loss)] // at most 1e11
        self.taken.set(lane, first as f64);
        // A run that goes on inside a segment has had the impulses at its anchor.
        if first == 0 && occupant.scene.inputs.impulses_at(start).next().is_some() {
            self.striking |= 1 << lane;
        }
    }

    /// Makes a lane one without a run, with the parameters of [`resting`]: it takes steps of length zero.
    fn vacate(&mut self, lane: usize) {
        self.parameters[lane] = Parameters::default();
        self.drive.set(lane, &SegmentDrive::still());
        self.anchor.set(lane, 0.0);
        self.taken.set(lane, 0.0);
        self.h.set(lane, 0.0);
    }

    /// The equations of one run.
    fn alone(&self, parameters: &Parameters) -> Chosen<f64> {
        Chosen::new(self.instructions, self.choice, parameters, &self.shared.options.stabilization)
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

    /// Looks for the lane that arrives next.
    fn schedule(&mut self) {
        let active = each(self.active & !self.arrived).filter_map(|lane| self.occupants[lane].as_ref());
        self.arrival = active.map(|occupant| occupant.arrival).min().unwrap_or(u64::MAX);
    }

    /// Lanes at the ends of their segments go on to the next, or have arrived.
    #[cold]
    #[inline(never)]
    fn arrive(&mut self) {
        for lane in each(self.active & !self.arrived) {
            let Some(occupant) = &mut self.occupants[lane] else { continue };
            if occupant.arrival == self.clock {
                if occupant.advance() {
                    self.enter(lane, self.clock);
                } else {
                    self.arrived |= 1 << lane;
                }
            }
        }
        self.schedule();
    }

    /// The times of all lanes, exact at the ends.
    #[inline(always)]
    fn times(&self, tau: R) -> R {
        let mut t = self.anchor + tau;
        let exact = self.arrived | self.fresh;
        if exact != 0 {
            for lane in each(exact) {
                if let Some(occupant) = &self.occupants[lane] {
                    t.set(lane, occupant.segment.time(occupant.step(self.clock)));
                }
            }
        }
        t
    }

    #[cold]
    #[inline(never)]
    fn note(&mut self, violation: usize, fresh: Bits, t: R) {
        self.noted[violation] |= fresh;
        for lane in each(fresh) {
            if let Some(occupant) = &mut self.occupants[lane] {
                occupant.first_times[violation] = t.lane(lane);
            }
        }
    }

    /// Takes the run out of a lane, and keeps its row.
    #[inline(never)]
    fn leave(&mut self, lane: usize, (status, message): (Status, String), t: f64, q: [f64; 9], p: [f64; 9]) {
        let bit = 1 << lane;
        self.active &= !bit;
        self.arrived &= !bit;
        self.fresh &= !bit;
        self.striking &= !bit;
        let Some(occupant) = self.occupants[lane].take() else { return };
        let (status, message) = after_violation((status, message), &occupant.first_times);
        let from = occupant.scene.initial.time.max(self.shared.options.summaries.after);
        let close = Close { from, completed: status == Status::Completed };
        self.rows.push(Row {
            run: occupant.run,
            status,
            message,
            t,
            q,
            p,
            violations: occupant.first_times,
            steps: occupant.steps(self.clock),
            summaries: self.summaries.values(lane, &close),
        });
        self.shared.finished();
    }
}

/// The equations of the runs in all lanes, their monitors' limits and W / 2.
type Numbers<R> = (Chosen<R>, Limits<R>, R);

/// What lanes need of the parameters of their runs. It changes when a run does: called, not inlined.
pub(super) fn numbers<R: Lanes>(runs: Runs<'_, [Parameters; MOST]>) -> Numbers<R> {
    struct Of<'a>(Runs<'a, [Parameters; MOST]>);
    impl<R: Lanes> LaneTask<R> for Of<'_> {
        type Output = Numbers<R>;
        #[inline(always)]
        fn run(self) -> Numbers<R> {
            let Self(Runs { instructions, choice, parameters, gains }) = self;
            let system = Chosen::new(instructions, choice, parameters, gains);
            (system, Limits::new(parameters), half_width(parameters))
        }
    }
    R::call(runs.instructions, Of(runs))
}

/// The state of a lane without a run: the default hand at rest. Nobody looks at it, but numbers that overflow there would send the
/// sines of all lanes the slow way.
pub(super) fn resting(
    instructions: Instructions,
    choice: Choice,
    gains: &Stabilization,
) -> Result<States<f64>, Error> {
    let parameters = Parameters::default();
    let motion = Motion { q: contact(&parameters)?, p: [0.0; 9], memory: [0.0; 2] };
    Ok(Chosen::<f64>::new(instructions, choice, &parameters, gains).begin(&motion))
}

#[inline(always)]
pub(super) fn column<R: Lanes, const N: usize>(y: &[R; N], lane: usize) -> [f64; N] {
    let mut column = [0.0; N];
    for n in 0..N {
        column[n] = y[n].lane(lane);
    }
    column
}

#[inline(always)]
pub(super) fn put<R: Lanes, const N: usize>(y: &mut [R; N], lane: usize, column: &[f64; N]) {
    for n in 0..N {
        y[n].set(lane, column[n]);
    }
}

/// The motion of one lane, as far as monitors ask.
#[inline(always)]
pub(super) fn motion<R: Lanes>(motion: &Motion<R>, lane: usize) -> Motion<f64> {
    Motion { q: column(&motion.q, lane), p: column(&motion.p, lane), memory: [0.0; 2] }
}

impl<I: InLanes> LaneKernel for FixedLanes<'_, I> {
    type Output = Result<Vec<Row>, Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { shared, choice, dt, .. } = self;
        let mut fleet = Fleet::<R>::new(instructions, shared, choice, dt);
        let resting = resting(instructions, choice, &shared.options.stabilization)?;
        let size = fleet.system.size();
        // States now, a step before, and of the lanes that do not take the step that the others take.
        let mut y = resting.map(R::constant);
        let mut aside = y;
        for lane in 0..R::WIDTH {
            let Some((number, scene)) = shared.take()? else { break };
            put(&mut y, lane, &fleet.board(lane, number, scene, 0)?);
        }
        fleet.rebuild();
        let mut method = I::new::<R>(fleet.runs());
        fleet.schedule();
        let mut before = y;
        let mut stats = Stats::default();
        let (mut now, mut after) = (Evaluation::nothing(), y);

        let stops = |violation| if shared.options.stop_on.contains(violation) { Bits::MAX } else { 0 };
        let stop_on = VIOLATIONS.map(|(_, violation)| stops(violation));

        while fleet.active != 0 {
            let tau = fleet.taken * fleet.h;
            let t = fleet.times(tau);
            fleet.system.evaluate_into(&fleet.drive, tau, &y, &mut now);
            let Motion { q, p, .. } = now.motion;

            let watched = fleet.active & !fleet.struck;
            let closure = if size.ledger {
                let energies = fleet.system.energies(&now.motion);
                closure(&fleet.begun, &energies, &works(size, &y))
            } else {
                R::zero()
            };
            let sound = finite(&now, closure);
            let seen = watched & sound;
            let found = fleet.limits.violated(&q, &now.sin_tilt, &now.multipliers);
            let mut ended = 0;
            for v in 0..VIOLATIONS.len() {
                let fresh = found[v] & seen & !fleet.noted[v];
                if fresh != 0 {
                    fleet.note(v, fresh, t);
                }
                ended |= found[v] & seen & stop_on[v];
            }
            if !fleet.summaries.is_empty() {
                let Evaluation { multipliers, residuals, torque, .. } = now;
                let half_width = fleet.half_width;
                let sight = Sight { t, q, p, multipliers, residuals, closure, half_width, torque };
                fleet.summaries.watch(&sight, seen);
            }

            // Lanes that do not take the step: they have no run, or their runs end, and others begin; or impulses strike.
            let mut detour = R::ALL & !fleet.active;
            let leaving = (watched & !sound) | ended | fleet.arrived;
            let boarded_before = fleet.fresh;
            fleet.fresh = 0;
            fleet.struck = 0;
            if leaving | fleet.striking != 0 || fleet.clock.is_multiple_of(POLL) {
                if shared.stops() {
                    break;
                }
                for lane in each(leaving) {
                    let bit = 1 << lane;
                    let (end, t, q, p) = if sound & bit == 0 {
                        let Some(occupant) = &fleet.occupants[lane] else { continue };
                        let place = occupant.before(fleet.clock);
                        let t = place.0.time(place.1);
                        let mut last = before;
                        if let Some((clock, unstruck)) = &occupant.unstruck
                            && *clock == fleet.clock
                        {
                            put(&mut last, lane, unstruck);
                        }
                        let Motion { mut q, mut p, .. } = occupant.motion(
                            &fleet.alone(&occupant.scene.parameters),
                            place,
                            &column(&last, lane),
                        );
                        if boarded_before & bit != 0 {
                            (q, p) = (occupant.scene.initial.q, occupant.scene.initial.p);
                        }
                        (overflow(t), t, q, p)
                    } else {
                        let (t, q, p) = (t.lane(lane), column(&q, lane), column(&p, lane));
                        let first = Set::of(&found, lane).intersection(shared.options.stop_on).first();
                        let end = first.map_or((Status::Completed, String::new()), |violation| {
                            let monitor = Monitor::new(&fleet.parameters[lane]);
                            (
                                Status::of(violation),
                                monitor.explain(violation, (t, boarded_before & bit != 0), &q),
                            )
                        });
                        (end, t, q, p)
                    };
                    fleet.leave(lane, end, t, q, p);
                    let next = match shared.take()? {
                        Some((number, scene)) => fleet.board(lane, number, scene, fleet.clock + 1)?,
                        None => {
                            fleet.vacate(lane);
                            resting
                        }
                    };
                    put(&mut aside, lane, &next);
                    detour |= bit;
                }
                if leaving != 0 {
                    fleet.rebuild();
                    method = I::new::<R>(fleet.runs());
                }
                let striking = fleet.striking & !detour;
                fleet.striking &= !striking;
                for lane in each(striking) {
                    let Some(occupant) = &mut fleet.occupants[lane] else { continue };
                    // The next step is the one after this, which the lane waits out.
                    occupant.unstruck = Some((fleet.clock + 2, column(&y, lane)));
                    occupant.arrival += 1;
                    let mut jumped = y;
                    for impulse in occupant.scene.inputs.impulses_at(occupant.segment.anchor) {
                        let input = fleet.drive.at(tau);
                        fleet.system.jump(&input, &mut jumped, &impulse.impulse.map(R::constant));
                    }
                    put(&mut aside, lane, &column(&jumped, lane));
                }
                fleet.struck = striking;
                detour |= striking;
                fleet.schedule();
            }

            let step = Step { tau, h: fleet.h, y: &y, rate: &now.rate, allowed: None };
            let Ok(()) = method.step(&fleet.system, &fleet.drive, &step, &mut after, &mut stats);
            fleet.system.correct(&fleet.drive, tau + fleet.h, &mut after);
            size.each(|n| (before[n], y[n]) = (y[n], after[n]));
            if detour != 0 {
                size.each(|n| y[n] = R::select(detour, aside[n], y[n]));
            }
            fleet.taken = R::select(detour, fleet.taken, fleet.taken + R::constant(1.0));
            fleet.clock += 1;
            if fleet.clock == fleet.arrival {
                fleet.arrive();
            }
        }
        Ok(fleet.rows)
    }
}
