//! The derivatives of a run, in directions of the caller's choice: parameters, inputs, the start, and the times of
//! breakpoints and impulses. They are the derivatives of the numbers that the run computes, with the lengths of
//! its steps held. `contact_derivatives.rs` follows the events of unilateral contact.

use std::mem::swap;

use crate::driver::contact_derivatives::{ContactDerivatives, Place, Stepper};
use crate::driver::simulate;
use crate::error::{Error, Result};
use crate::formulation::{
    Evaluation, MAX_COMPONENTS, RunDual, RunDualEquations, RunDualSystem, StageState, States, System,
};
use crate::method::{Method, RunDualMethod, Step, Unsolved, values};
use crate::model::{
    BILATERAL_WORKS, ContactModel, Contacts, DIRECTIONS, Input, Inputs, Motion, PARAMETER_COUNT, Parameters,
    Scene, SegmentDrive, Start, State, VariedParameters, unpacked,
};
use crate::number::{LaneKernel, LaneTask, Lanes, Real, call_four_lanes, task};
use crate::stepping::{
    Grid, LaneContact, Limits, Moment, Options, POLL, Recordable, Segment, Selection, Span, Steps, Summaries,
    Summary, SummaryInstant, reserved,
};

/// A direction in which a run is differentiated.
#[derive(Debug, Clone)]
pub struct Direction {
    /// The derivatives of the parameters.
    pub parameters: [f64; PARAMETER_COUNT],
    /// The derivatives of the inputs while the breakpoints stay, with as many pieces, sinusoids and impulses.
    pub inputs: Inputs,
    /// The derivative of the start, besides what [`Start::varied`](crate::model::start::Start::varied) gives.
    pub initial: Motion<f64>,
    /// What inputs that jump add where their breakpoint moves.
    pub shifts: Vec<Shift>,
    /// The derivative of the time of each impulse, in the order of their times; empty if all are zero.
    pub impulse_times: Vec<f64>,
}

/// The derivative of inputs by the time of a breakpoint at which they jump: an impulse of minus the jump.
#[derive(Debug, Clone, Copy)]
pub struct Shift {
    /// The time of the breakpoint, s.
    pub time: f64,
    /// Minus the jump of the targets, rad or N m, times the derivative of the time.
    pub target: [f64; 2],
    /// The same for the accelerations of driven fingers.
    pub acceleration: [f64; 2],
    /// The same for the forces on the object, N and N m.
    pub force: [f64; 3],
}

/// The quantities whose derivatives a row has, with the number of components of each.
pub const QUANTITIES: [(&str, usize); 5] =
    [("state", 18), ("integral", 2), ("multipliers", 4), ("torque", 2), ("energy", 3 + BILATERAL_WORKS)];

/// Number of components of a row.
pub const COMPONENTS: usize = 18 + 2 + 4 + 2 + 3 + BILATERAL_WORKS;

/// The derivatives of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Derivatives {
    /// The numbers, one for each direction together.
    pub numbers: Vec<f64>,
    /// The derivatives of the times of changes of contacts' modes, for each change one for every direction.
    pub changes: Vec<f64>,
    /// Why the run could not be followed to its end, if so; the numbers from there on are NaN.
    pub failed: Option<String>,
}

/// What is wanted of the derivatives of a run.
#[derive(Debug, Clone, Copy)]
pub enum Wanted<'a> {
    /// Rows at these instants of the run: the components of [`QUANTITIES`] row by
    /// row, each with one number for every direction. At a breakpoint the row has the state before its shifts and impulses.
    Rows(&'a [f64]),
    /// The last state, 18 numbers, and the summaries: one row for each direction. A summary that has no derivative, or
    /// has seen no instant, gives NaN.
    Ends {
        /// The time of the last instant, s.
        until: f64,
        /// The summaries.
        summaries: &'a [Summary],
    },
}

/// The derivatives of a run; `None` if it is interrupted. `start` says what the scene's start follows from, if not given.
pub fn sensitivities(
    scene: &Scene,
    options: &Options,
    start: Option<Start>,
    directions: &[Direction],
    wanted: Wanted<'_>,
    interrupted: &dyn Fn() -> bool,
) -> Result<Option<Derivatives>> {
    let ends = &ends(scene, options, wanted, interrupted)?;
    let request = Request { scene, options, start, ends, directions, wanted, interrupted };
    options.simd.require()?;
    call_four_lanes(request)
}

/// The ends of free steps, from the run itself. Refuses scenes whose derivatives are not computed.
fn ends(
    scene: &Scene,
    options: &Options,
    wanted: Wanted<'_>,
    interrupted: &dyn Fn() -> bool,
) -> Result<Vec<f64>> {
    let refused = |allowed: &str| Err(Error::unknown("sensitivities", "of this scene", allowed));
    if scene.inputs.sampled().is_some() {
        return refused("those without a SampledController");
    }
    let explicit = matches!(options.method, Method::Rk4 | Method::Dop853);
    let follows =
        explicit && !options.record.contains(Recordable::Energy) && matches!(wanted, Wanted::Rows(_));
    if options.contact == ContactModel::Unilateral && !follows {
        return refused("in unilateral contact rows without the energy, with \"rk4\" or \"dop853\"");
    }
    if !scene.parameters.has_the_papers_parts() {
        return refused("those of rotary fingers, parallel faces and the law (5)");
    }
    match &options.steps {
        Steps::Fixed(_) => Ok(Vec::new()),
        Steps::Free { .. } => {
            let ends = Options { record: Selection::default(), every: 1, times: None, ..options.clone() };
            Ok(simulate(scene, &ends, interrupted)?.0.recording.t().to_vec())
        }
    }
}

impl LaneKernel for Request<'_> {
    type Output = Result<Option<Derivatives>>;

    #[inline(always)]
    fn run<R: Lanes>(self) -> Self::Output {
        let request = &self;
        let Self { scene, options, directions: all, wanted, .. } = self;
        let mut numbers = Vec::new();
        if let Wanted::Rows(times) = wanted {
            // They are written in place.
            let count = times.len().saturating_mul(COMPONENTS * all.len());
            numbers = reserved("the derivatives, in numbers,", count)?;
            numbers.resize(count, 0.0);
        }
        let runs = options.runs(scene);
        let (mut failed, mut changes) = (None, Vec::new());
        for (chunk, directions) in all.chunks(DIRECTIONS).enumerate() {
            let slopes = std::array::from_fn(|k| {
                let own = directions.get(k).map_or([0.0; PARAMETER_COUNT], |own| own.parameters);
                Parameters::unchecked(&own)
            });
            let source = VariedParameters { parameters: &scene.parameters, slopes };
            let twice = options.method == Method::Rosenbrock;
            let equations = RunDualEquations::<R>::new(runs.choice, &source, runs.gains, twice);
            let run = DifferentiatedRun { request, directions, source, equations };
            let mut sink = match wanted {
                Wanted::Rows(times) => {
                    let (numbers, first) = (&mut numbers[..], chunk * DIRECTIONS);
                    Sink::Rows(Rows { times, numbers, first, width: all.len(), taken: 0 })
                }
                Wanted::Ends { until, .. } => {
                    Sink::Ends(Ends { summaries: Summaries::new(&options.summaries), until, last: None })
                }
            };
            let mut contact = None;
            if options.contact == ContactModel::Unilateral {
                let mut lane = LaneContact::new(options, scene);
                lane.restart(options, scene)?;
                let limits = Limits::new(&run.source);
                contact = Some(ContactDerivatives { lane, limits, between: [0.0; 2], changes: Vec::new() });
            }
            let method = RunDualMethod::new(runs, options.method);
            let stepper = &mut Stepper { method, contact };
            let followed = R::outlined(FollowRun { run: &run, stepper, sink: &mut sink });
            let times = stepper.contact.as_ref().map_or(&[][..], |contact| &contact.changes);
            changes.resize(changes.len().max(times.len() * all.len()), f64::NAN);
            for (change, time) in times.iter().enumerate() {
                for k in 0..directions.len() {
                    changes[change * all.len() + chunk * DIRECTIONS + k] = time.direction(k);
                }
            }
            match followed {
                Ok(()) if sink.is_full() => {}
                Ok(()) => return Ok(None),
                Err(failure @ (Error::NoDerivative { .. } | Error::NoEventDerivative { .. })) => {
                    sink.give_up();
                    failed = Some(failure.to_string());
                }
                Err(error) => return Err(error),
            }
            if let (Sink::Ends(ends), Wanted::Ends { summaries, .. }) = (&sink, wanted) {
                for k in 0..directions.len() {
                    numbers.extend(ends.state(k));
                    numbers.extend(summaries.iter().map(|&summary| ends.slope(summary, k)));
                }
            }
        }
        Ok(Some(Derivatives { numbers, changes, failed }))
    }
}

/// The place of the derivatives of some directions among those of all.
struct Rows<'a> {
    times: &'a [f64],
    /// The components of all rows, each with one number for every direction.
    numbers: &'a mut [f64],
    /// The first of the directions, and the number of all directions.
    first: usize,
    width: usize,
    taken: usize,
}

/// The summaries of a run and its last state, with their derivatives.
struct Ends<R> {
    summaries: Summaries<RunDual<R>>,
    until: f64,
    last: Option<Motion<RunDual<R>>>,
}

/// What takes the instants of a run with derivatives.
enum Sink<'a, R> {
    Rows(Rows<'a>),
    Ends(Ends<R>),
}

impl<R: Lanes> Sink<'_, R> {
    /// Whether it needs no further instant.
    fn is_full(&self) -> bool {
        match self {
            Self::Rows(rows) => rows.taken == rows.times.len(),
            Self::Ends(ends) => ends.last.is_some(),
        }
    }

    /// Whether it wants the instant at this end of a step.
    #[inline(always)]
    fn wants(&self, time: f64) -> bool {
        match self {
            Self::Rows(rows) => rows.times.get(rows.taken) == Some(&time),
            Self::Ends(ends) => ends.last.is_none(),
        }
    }

    /// The next instant that it wants inside a step that ends at `end`.
    fn next_before(&self, end: f64) -> Option<f64> {
        match self {
            Self::Rows(rows) => rows.times.get(rows.taken).copied().filter(|&time| time < end),
            Self::Ends(_) => None,
        }
    }

    /// Writes NaN for the rows that are missing, because the run cannot be followed to them.
    fn give_up(&mut self) {
        if let Self::Rows(rows) = self {
            let Rows { times, numbers, first, width, taken } = rows;
            let columns = *first..(*width).min(*first + DIRECTIONS);
            for component in *taken * COMPONENTS..times.len() * COMPONENTS {
                numbers[component * *width..][columns.clone()].fill(f64::NAN);
            }
        }
    }
}

task! {
    ['a, 's, R: Lanes]
    Take<'a, 's, R>(sink: &'a mut Sink<'s, R>, system: &'a RunDualSystem<R>, time: f64, y: &'a States<RunDual<R>>,
        now: &'a Evaluation<RunDual<R>>)
    for R => () = match sink {
        Sink::Rows(rows) => rows.take(system, now, y),
        Sink::Ends(ends) => ends.take(time, now),
    }
}

impl Rows<'_> {
    #[inline(always)]
    fn take<R: Lanes>(
        &mut self,
        system: &RunDualSystem<R>,
        now: &Evaluation<RunDual<R>>,
        y: &States<RunDual<R>>,
    ) {
        let mut energy = [RunDual::zero(); 3 + BILATERAL_WORKS];
        let size = system.size();
        if size.works > 0 {
            let energies = system.energies(&Contacts::sticking(), &now.motion);
            energy[..3].copy_from_slice(&[energies.kinetic, energies.elastic, energies.gravity]);
            energy[3..].copy_from_slice(&y[size.states..size.all()]);
        }
        let Motion { q, p, memory, .. } = now.motion;
        let motion = q.row().into_iter().chain(p.row()).chain(memory);
        let row = motion.chain(now.multipliers).chain(now.torque).chain(energy);
        let Self { first, width, .. } = *self;
        for (component, number) in row.enumerate() {
            let from = (self.taken * COMPONENTS + component) * width;
            for k in first..width.min(first + DIRECTIONS) {
                self.numbers[from + k] = number.direction(k - first);
            }
        }
        self.taken += 1;
    }
}

impl<R: Lanes> Ends<R> {
    #[inline(always)]
    fn take(&mut self, time: f64, now: &Evaluation<RunDual<R>>) {
        let zero = RunDual::zero();
        let t = RunDual::constant(time);
        let instant = SummaryInstant { t, now, slip_speed: zero, closure: zero, half_width: zero };
        self.summaries.watch(&instant, R::ALL);
        if time >= self.until {
            self.last = Some(now.motion);
        }
    }

    /// The derivatives of the last state; NaN if the run did not get so far.
    fn state(&self, direction: usize) -> [f64; 18] {
        let Some(Motion { q, p, .. }) = self.last else { return [f64::NAN; 18] };
        let (q, p) = (q.row(), p.row());
        std::array::from_fn(|n| if n < 9 { q[n] } else { p[n - 9] }.direction(direction))
    }

    /// The derivative of a summary; NaN if it has none, or has seen no instant.
    fn slope(&self, summary: Summary, direction: usize) -> f64 {
        let memory = self.summaries.memory[summary as usize];
        let values = memory.map(|number| number.lane(0));
        if self.last.is_none() || !values[0].is_finite() {
            return f64::NAN;
        }
        summary.slope(values, memory.map(|number| number.direction(direction))).unwrap_or(f64::NAN)
    }
}

/// The inputs of an instant and their segment.
type InputIn<'a, R> = (&'a Input<RunDual<R>>, &'a SegmentDrive<RunDual<R>>);

/// A step: its start since the segment's, its length, and the times at its end.
struct StepTimes {
    tau: f64,
    h: f64,
    tau_end: f64,
    end: f64,
}

/// The step of a segment after `taken` steps of it. `ends` has the start of a free step, and the ends from there on.
fn next_step(segment: &Segment, taken: u64, ends: Option<&[f64]>) -> Option<StepTimes> {
    let Some(ends) = ends else {
        let step = segment.first + taken;
        let (tau, tau_end, end) = (segment.tau(step), segment.tau(step + 1), segment.time(step + 1));
        return (step < segment.count).then_some(StepTimes { tau, h: segment.h, tau_end, end });
    };
    let &[from, end, ..] = ends else { return None };
    let from = if taken == 0 { segment.anchor } else { from };
    let (tau, tau_end) = (from - segment.anchor, end - segment.anchor);
    (end <= segment.end).then_some(StepTimes { tau, h: end - from, tau_end, end })
}

/// What is computed: all directions, in chunks of eight.
struct Request<'a> {
    scene: &'a Scene,
    options: &'a Options,
    start: Option<Start>,
    ends: &'a [f64],
    directions: &'a [Direction],
    wanted: Wanted<'a>,
    interrupted: &'a dyn Fn() -> bool,
}

/// A run with its derivatives in some directions, at most eight.
struct DifferentiatedRun<'a, R> {
    request: &'a Request<'a>,
    directions: &'a [Direction],
    source: VariedParameters<'a>,
    equations: RunDualEquations<R>,
}

task! {
    ['w, 's, R: Lanes]
    FollowRun<'w, 's, R>(run: &'w DifferentiatedRun<'w, R>, stepper: &'w mut Stepper<R>, sink: &'w mut Sink<'s, R>)
    for R => Result = run.follow(stepper, sink)
}

impl<R: Lanes> DifferentiatedRun<'_, R> {
    /// Follows the run with a method until its sink needs no more.
    #[inline(always)]
    fn follow(&self, stepper: &mut Stepper<R>, sink: &mut Sink<'_, R>) -> Result {
        let (grid, mut ends) = self.times()?;
        let DifferentiatedRun { request: Request { scene, interrupted, .. }, equations, .. } = self;
        let system = &equations.system;
        let inputs = &scene.inputs;
        let mut segment = grid.first;
        let mut drive = self.drive(segment.anchor);
        if let Some([.., right, left]) = scene.initial.contact {
            drive.contacts.frozen_tilt = [RunDual::constant(right), RunDual::constant(left)];
        }
        let none = [RunDual::zero(); 3];
        let mut y = system.begin(&self.start(&drive));
        let mut next = [RunDual::zero(); MAX_COMPONENTS];
        let mut rate = next;
        let mut steps = 0u64;
        loop {
            let linearized = scene.initial.linearized.filter(|_| segment.first > 0).map(|point| {
                let (tau, motion) = unpacked(&point);
                (tau, values(&system.begin(&Motion::constant(&motion))))
            });
            stepper.method.begin(inputs.segment(segment.anchor), linearized);
            let mut tau = RunDual::constant(segment.tau(segment.first));
            let h = next_step(&segment, 0, ends).map_or(segment.h, |step| step.h);
            if let Some(contact) = &mut stepper.contact {
                let (modes, start, known) = (contact.lane.run.modes(), tau.lane(0), contact.changes.len());
                contact.lane.enter(segment.anchor, inputs.segment(segment.anchor));
                contact.between = [start, segment.end - segment.anchor];
                let place = Place { equations, drive: &mut drive, tau, y };
                let begun = stepper.follow(place, (0.0, &none), |lane, y| {
                    lane.begin(&Moment { earlier: false, tau: start, h, y })
                })?;
                y = begun.unwrap_or(y);
                let changed = stepper.contact.as_mut().filter(|contact| contact.lane.run.modes() != modes);
                if let Some(contact) = changed.filter(|_| self.shifts_at(segment.start)) {
                    contact.changes.truncate(known);
                    let why = "the modes of contacts change at a breakpoint that a path moves";
                    return Err(Error::NoEventDerivative { time: segment.start, why });
                }
            }
            self.visit(segment.start, &drive, (tau, &y), &mut rate, sink);
            // A run that is resumed inside a segment has already had what happens at the start of the segment.
            if segment.first == 0 && self.pass((segment.start, h), stepper, &mut drive, &mut y)? {
                rate = self.rates((&drive.at(tau), &drive), &y);
            }
            let mut taken = 0;
            while let Some(times) = next_step(&segment, taken, ends) {
                if sink.is_full() {
                    return Ok(());
                }
                let from = RunDual::constant(times.tau);
                loop {
                    // A row may be inside a step: a step that ends there has its derivatives.
                    let row = sink.next_before(times.end);
                    let h = row.map_or(times.h, |row| (row - segment.anchor) - times.tau);
                    let (tau, h) = (from, RunDual::constant(h));
                    let step = Step { system, drive: &drive, tau, h, y: &y, rate: &rate, allowed: None };
                    let attempt = stepper.method.step(equations, &step, &mut next);
                    // The equations were solved in the run, but not again to round-off.
                    let time = row.unwrap_or(times.end);
                    attempt
                        .map_err(|Unsolved { correction, .. }| Error::NoDerivative { time, correction })?;
                    system.correct(&drive, tau + h, &mut next);
                    let (contacts, arrived, length) = (drive.contacts, values(&next), h.lane(0));
                    let before = stepper
                        .contact
                        .as_ref()
                        .map(|contact| (contact.lane.run.clone(), contact.between, contact.changes.len()));
                    let place = Place { equations, drive: &mut drive, tau, y };
                    let passed = stepper.follow(place, (length, &none), |lane, y| {
                        lane.advance(&Moment { earlier: false, tau: tau.lane(0), h: length, y }, &arrived)
                    })?;
                    next = passed.unwrap_or(next);
                    let Some(row) = row else { break };
                    self.visit(row, &drive, (tau + h, &next), &mut { rate }, sink);
                    // The run goes on from the start of the step.
                    drive.contacts = contacts;
                    if let (Some(contact), Some((run, between, changes))) = (&mut stepper.contact, before) {
                        (contact.lane.run, contact.between) = (run, between);
                        contact.changes.truncate(changes);
                    }
                }
                swap(&mut y, &mut next);
                tau = RunDual::constant(times.tau_end);
                taken += 1;
                ends = ends.map(|ends| &ends[1..]);
                steps += 1;
                if steps.is_multiple_of(POLL) && interrupted() {
                    return Ok(());
                }
                if times.end < segment.end {
                    self.visit(times.end, &drive, (tau, &y), &mut rate, sink);
                }
            }
            let Some(later) = grid.after(inputs, &segment).filter(|_| !sink.is_full()) else {
                self.visit(segment.end, &drive, (tau, &y), &mut rate, sink);
                return Ok(());
            };
            segment = later;
            let contacts = drive.contacts;
            drive = self.drive(segment.anchor);
            drive.contacts = contacts;
        }
    }

    /// The segments of the run, and the ends of its steps if these are free.
    fn times(&self) -> Result<(Grid, Option<&[f64]>)> {
        let &Request { scene: Scene { inputs, initial, duration, .. }, options, ends, .. } = self.request;
        match options.steps {
            Steps::Fixed(dt) => Ok((Grid::new(inputs, initial, *duration, dt, options.refine)?, None)),
            Steps::Free { .. } => {
                let span = Span::new(inputs, initial, *duration)?;
                // One step to each segment, of which only the segments count.
                let initial = &State { grid: None, ..initial.clone() };
                Ok((Grid::over(inputs, initial, span, f64::INFINITY, 1)?, Some(ends)))
            }
        }
    }

    #[inline(always)]
    fn start(&self, drive: &SegmentDrive<RunDual<R>>) -> Motion<RunDual<R>> {
        let initial = &self.request.scene.initial;
        let Motion { q, p, mut memory, relaxation } = Motion::<RunDual<R>>::constant(&initial.motion);
        let (mut q, mut p) = (q.row(), p.row());
        if let Some(start) = self.request.start {
            let derived = start.varied(&self.source, &drive.at(RunDual::zero()), &initial.motion.q);
            let (derived_q, derived_p) = (derived.q.row(), derived.p.row());
            for n in 0..9 {
                (q[n].slope, p[n].slope) = (derived_q[n].slope, derived_p[n].slope);
            }
        }
        for n in 0..9 {
            q[n] = q[n] + self.varied(0.0, |one| one.initial.q.row()[n]);
            p[n] = p[n] + self.varied(0.0, |one| one.initial.p.row()[n]);
        }
        for i in 0..2 {
            memory[i] = memory[i] + self.varied(0.0, |one| one.initial.memory[i]);
        }
        Motion { q: q.into(), p: p.into(), memory, relaxation }
    }

    fn shifts_at(&self, time: f64) -> bool {
        self.directions.iter().any(|one| one.shifts.iter().any(|shift| shift.time == time))
    }

    /// Applies the shifts of inputs whose jump moves at a breakpoint, then its impulses. Returns whether there are any.
    #[inline(always)]
    fn pass(
        &self,
        (time, h): (f64, f64),
        stepper: &mut Stepper<R>,
        drive: &mut SegmentDrive<RunDual<R>>,
        y: &mut States<RunDual<R>>,
    ) -> Result<bool> {
        let input = drive.at(RunDual::zero());
        let mut passes = self.shifts_at(time);
        if passes {
            self.shift(time, (&input, &*drive), y);
        }
        let inputs = &self.request.scene.inputs;
        for (place, impulse) in inputs.fixed_impulses_at(time).enumerate() {
            passes = true;
            let slope = |one: &Direction, c: usize| {
                one.inputs.fixed_impulses_at(time).nth(place).map_or(0.0, |slope| slope[c])
            };
            let component = |c: usize| self.varied(impulse[c], |one| slope(one, c));
            let number = inputs.impulses_before(time) + place;
            // An impulse that comes later by dt acts on the state that the rates before it reach in dt, and the
            // rates after it act for dt less.
            let by = self.varied(0.0, |one| one.impulse_times.get(number).copied().unwrap_or(0.0));
            self.carry((&input, drive), y, by);
            // The angles of driven fingers are those of the instant to which the impulse moves.
            let mut impulse = std::array::from_fn(component);
            if let Some(frame) = &drive.frame {
                [impulse[0], impulse[1]] = frame.motion(by).in_hand_axes([impulse[0], impulse[1]]);
            }
            if stepper.contact.is_some() {
                let plain = [impulse[0].lane(0), impulse[1].lane(0), impulse[2].lane(0)];
                let place = Place { equations: &self.equations, drive, tau: by, y: *y };
                let struck = stepper.follow(place, (0.0, &impulse), |lane, y| {
                    let at = Moment { earlier: false, tau: 0.0, h, y };
                    lane.change(&at, |stepper, place| stepper.strike(place, &plain))
                })?;
                *y = struck.unwrap_or(*y);
            } else {
                self.equations.system.jump(&drive.at(by), y, &impulse);
            }
            self.carry((&input, drive), y, -by);
        }
        Ok(passes)
    }

    fn drive(&self, anchor: f64) -> SegmentDrive<RunDual<R>> {
        let slopes: Vec<_> = self.directions.iter().map(|one| one.inputs.segment(anchor)).collect();
        SegmentDrive::varied(&self.request.scene.inputs.segment(anchor), &slopes)
    }

    /// A number with its derivative in each direction.
    fn varied(&self, value: f64, of: impl Fn(&Direction) -> f64) -> RunDual<R> {
        RunDual::varied(value, &self.directions.iter().map(of).collect::<Vec<_>>())
    }

    /// Evaluates a state at time `tau` of the segment, and gives it to the sink if that wants it.
    #[inline(always)]
    fn visit(
        &self,
        time: f64,
        drive: &SegmentDrive<RunDual<R>>,
        (tau, y): (RunDual<R>, &States<RunDual<R>>),
        rate: &mut States<RunDual<R>>,
        sink: &mut Sink<'_, R>,
    ) {
        if sink.wants(time) {
            let now = self.equations.system.evaluate(drive, tau, y);
            *rate = now.rate;
            R::outlined(Take { sink, system: &self.equations.system, time, now: &now, y });
        } else {
            let at = StageState { from: y, by: RunDual::zero(), along: y };
            self.equations.system.rates(&drive.at(tau), drive, at, rate);
        }
    }

    /// Adds the effect of the shifts at a breakpoint. The rates are affine in the inputs, so that the difference of
    /// the derivatives with and without a shift is exact.
    #[inline(always)]
    fn shift(&self, time: f64, (input, drive): InputIn<'_, R>, y: &mut States<RunDual<R>>) {
        let shift = |of: &dyn Fn(&Shift) -> f64| {
            let here = |one: &Direction| one.shifts.iter().filter(|shift| shift.time == time).map(of).sum();
            self.varied(0.0, here)
        };
        let mut moved = *input;
        for i in 0..2 {
            moved.target[i] = moved.target[i] + shift(&|shift| shift.target[i]);
            moved.target_acceleration[i] =
                moved.target_acceleration[i] + shift(&|shift| shift.acceleration[i]);
        }
        for c in 0..3 {
            moved.force[c] = moved.force[c] + shift(&|shift| shift.force[c]);
        }
        let (with, without) = (self.rates((&moved, drive), y), self.rates((input, drive), y));
        for n in 0..MAX_COMPONENTS {
            y[n] = y[n] + (with[n] - without[n]);
        }
    }

    /// Carries the state on by the times `by` of the directions.
    #[inline(always)]
    fn carry(&self, instant: InputIn<'_, R>, y: &mut States<RunDual<R>>, by: RunDual<R>) {
        if by.slope.iter().all(|by| by.is_zero() & R::ALL == R::ALL) {
            return;
        }
        let rate = self.rates(instant, y);
        for n in 0..MAX_COMPONENTS {
            // `by` has the value zero, so that only the derivatives of the state change.
            y[n] = y[n] + by * rate[n];
        }
    }

    #[inline(always)]
    fn rates(&self, (input, drive): InputIn<'_, R>, y: &States<RunDual<R>>) -> States<RunDual<R>> {
        let mut rate = [RunDual::zero(); MAX_COMPONENTS];
        let at = StageState { from: y, by: RunDual::zero(), along: y };
        self.equations.system.rates(input, drive, at, &mut rate);
        rate
    }
}
