//! A run with derivatives in some directions: its steps, which are those of the run itself, and what breakpoints and
//! impulses add to the derivatives; and what is kept of it. `contact_derivatives.rs` follows the events of unilateral contact.

use crate::driver::contact_derivatives::{DualStates, Place, Stepper};
use crate::driver::request::{COMPONENTS, Direction, Request};
use crate::error::Result;
use crate::formulation::{Evaluation, MAX_COMPONENTS, RunDual, RunDualEquations, StageState, System};
use crate::method::values;
use crate::model::{
    BILATERAL_WORKS, ContactModel, Contacts, Input, Motion, Scene, SegmentDrive, State, VariedParameters,
    relaxed, unpacked,
};
use crate::number::{LaneTask, Lanes, Real, task};
use crate::stepping::{
    Grid, Limits, Margins, Options, POLL, Segment, Span, Steps, Summaries, Summary, SummaryInstant,
};

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

/// A run with its derivatives in some directions, at most [`DIRECTIONS`](crate::model::DIRECTIONS).
pub(super) struct DifferentiatedRun<'a, R> {
    pub request: Request<'a>,
    pub ends: &'a [f64],
    pub directions: &'a [Direction],
    pub source: VariedParameters<'a>,
    pub equations: RunDualEquations<R>,
    /// What events are due at, and margins are distances to.
    pub limits: Limits<RunDual<R>>,
}

task! {
    pub(super) ['w, 's, R: Lanes]
    FollowRun<'w, 's, R>(run: &'w DifferentiatedRun<'w, R>, stepper: &'w mut Stepper<R>, kept: &'w mut Kept<'s, R>)
    for R => Result = run.follow(stepper, kept)
}

impl<R: Lanes> DifferentiatedRun<'_, R> {
    /// Follows the run with a method until nothing more of it is wanted.
    #[inline(always)]
    fn follow(&self, stepper: &mut Stepper<R>, kept: &mut Kept<'_, R>) -> Result {
        let (mut grid, mut ends) = self.times()?;
        let DifferentiatedRun { request: Request { scene, interrupted, .. }, equations, limits, .. } = self;
        let (inputs, initial) = (&scene.inputs, &scene.initial);
        let mut segment = grid.first;
        let mut drive = self.drive(segment.anchor);
        if let Some([.., right, left]) = initial.contact {
            drive.contacts.frozen_tilt = [RunDual::constant(right), RunDual::constant(left)];
        }
        let y = equations.system.begin(&self.start(&drive));
        let mut place = Place { equations, limits, anchor: segment.anchor, drive, tau: RunDual::zero(), y };
        let mut rate = [RunDual::zero(); MAX_COMPONENTS];
        let mut steps = 0u64;
        loop {
            let linearized = initial.linearized.filter(|_| segment.first > 0).map(|point| {
                let (tau, motion) = unpacked(&point);
                (tau, values(&equations.system.begin(&Motion::constant(&motion))))
            });
            stepper.method.begin(inputs.segment(segment.anchor), linearized);
            place.tau = RunDual::constant(segment.tau(segment.first));
            let h = next_step(&segment, 0, ends).map_or(segment.h, |step| step.h);
            let moves = |k: usize| self.directions[k].moves(segment.start);
            stepper.begin(&mut place, (&segment, inputs.segment(segment.anchor), h), moves)?;
            self.visit(segment.start, &place, &mut rate, kept);
            // A run that is resumed inside a segment has already had what happens at the start of the segment.
            if segment.first == 0 && self.pass((segment.start, h), stepper, &mut place)? {
                rate = self.rates(&place.drive.at(place.tau), &place);
            }
            let mut taken = 0;
            while let Some(times) = next_step(&segment, taken, ends) {
                // Summaries may have derivatives from before.
                if stepper.has_lost_all() && kept.summaries.is_none() {
                    kept.give_up();
                }
                if kept.is_full() {
                    return Ok(());
                }
                // A row may be inside a step: a step that ends there has its derivatives.
                let row = kept.next_before(times.end);
                let h = row.map_or(times.h, |row| (row - segment.anchor) - times.tau);
                let start = row.map(|row| {
                    let contact = stepper.contact.as_ref();
                    (row, place.clone(), contact.map(|of| (of.lane.run.clone(), of.passed.clone())))
                });
                stepper.step(&mut place, h, &rate)?;
                if let Some((row, start, before)) = start {
                    self.visit(row, &place, &mut { rate }, kept);
                    // The run goes on from the start of the step.
                    place = start;
                    if let (Some(contact), Some(before)) = (&mut stepper.contact, before) {
                        (contact.lane.run, contact.passed) = before;
                    }
                    continue;
                }
                place.tau = RunDual::constant(times.tau_end);
                taken += 1;
                ends = ends.map(|ends| &ends[1..]);
                steps += 1;
                if steps.is_multiple_of(POLL) && interrupted() {
                    return Ok(());
                }
                if times.end < segment.end {
                    self.visit(times.end, &place, &mut rate, kept);
                }
            }
            let Some(later) = grid.after(inputs, &segment).filter(|_| !kept.is_full()) else {
                self.visit(segment.end, &place, &mut rate, kept);
                return Ok(());
            };
            segment = later;
            let contacts = place.drive.contacts;
            (place.anchor, place.drive) = (segment.anchor, self.drive(segment.anchor));
            place.drive.contacts = contacts;
        }
    }

    /// The segments of the run, and the ends of its steps if these are free.
    fn times(&self) -> Result<(Grid, Option<&[f64]>)> {
        let Request { scene: Scene { inputs, initial, duration, .. }, options, .. } = self.request;
        match options.steps {
            Steps::Fixed(dt) => Ok((Grid::new(inputs, initial, *duration, dt, options.refine)?, None)),
            Steps::Free { .. } => {
                let span = Span::new(inputs, initial, *duration)?;
                // One step to each segment, of which only the segments count.
                let initial = &State { grid: None, ..initial.clone() };
                Ok((Grid::over(inputs, initial, span, f64::INFINITY, 1)?, Some(self.ends)))
            }
        }
    }

    #[inline(always)]
    fn start(&self, drive: &SegmentDrive<RunDual<R>>) -> Motion<RunDual<R>> {
        let initial = &self.request.scene.initial.motion;
        let mut row = Motion::<RunDual<R>>::constant(initial).row();
        if let Some(start) = self.request.start {
            let derived = start.varied(&self.source, &drive.at(RunDual::zero()), &initial.q);
            for (own, derived) in row.iter_mut().zip(derived.row()) {
                own.slope = derived.slope;
            }
        }
        for (n, own) in row.iter_mut().enumerate() {
            *own = *own + self.varied(0.0, |one| one.initial.row()[n]);
        }
        let mut motion = Motion::from(row);
        if self.request.start.is_some() {
            motion.relaxation = relaxed(&self.source, &motion.q);
        }
        motion
    }

    /// Applies the shifts of inputs whose jump moves at a breakpoint, then its impulses. Returns whether there are any.
    #[inline(always)]
    fn pass(
        &self,
        (time, h): (f64, f64),
        stepper: &mut Stepper<R>,
        place: &mut Place<'_, R>,
    ) -> Result<bool> {
        let (start, input) = (place.tau, place.drive.at(RunDual::zero()));
        let mut passes = self.directions.iter().any(|one| one.moves(time));
        if passes {
            self.shift(time, &input, place);
        }
        let inputs = &self.request.scene.inputs;
        for (number, impulse) in inputs.fixed_impulses_at(time).enumerate() {
            passes = true;
            let slope = |one: &Direction, c: usize| {
                one.inputs.fixed_impulses_at(time).nth(number).map_or(0.0, |slope| slope[c])
            };
            let component = |c: usize| self.varied(impulse[c], |one| slope(one, c));
            let number = inputs.impulses_before(time) + number;
            // An impulse that comes later by dt acts on the state that the rates before it reach in dt, and the
            // rates after it act for dt less.
            let by = self.varied(0.0, |one| one.impulse_times.get(number).copied().unwrap_or(0.0));
            self.carry(&input, place, by);
            // The angles of driven fingers are those of the instant to which the impulse moves.
            let mut impulse = std::array::from_fn(component);
            if let Some(frame) = &place.drive.frame {
                [impulse[0], impulse[1]] = frame.motion(by).in_hand_axes([impulse[0], impulse[1]]);
            }
            place.tau = by;
            stepper.strike(place, (h, impulse))?;
            place.tau = start;
            self.carry(&input, place, -by);
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

    /// Evaluates a state, and gives it to what is kept if that wants it.
    #[inline(always)]
    fn visit(&self, time: f64, place: &Place<'_, R>, rate: &mut DualStates<R>, kept: &mut Kept<'_, R>) {
        let (system, Place { drive, tau, y, .. }) = (&self.equations.system, place);
        if kept.wants(time) {
            let now = &system.evaluate(drive, *tau, y);
            *rate = now.rate;
            R::outlined(Take { kept, time, place, now });
        } else {
            *rate = self.rates(&drive.at(*tau), place);
        }
    }

    /// Adds the effect of the shifts at a breakpoint. The rates are affine in the inputs, so that the difference of
    /// the derivatives with and without a shift is exact.
    #[inline(always)]
    fn shift(&self, time: f64, input: &Input<RunDual<R>>, place: &mut Place<'_, R>) {
        let (mut moved, without, own) = (*input, self.rates(input, place), place.drive.frame.clone());
        let Input { target, target_acceleration, force, .. } = &mut moved;
        let frame = place.drive.frame.iter_mut().flat_map(|frame| frame.constants());
        let all = target.iter_mut().chain(target_acceleration).chain(force).chain(frame);
        for (c, number) in all.enumerate() {
            let here = |one: &Direction| {
                one.shifts.iter().filter(|shift| shift.time == time).map(|shift| shift.by[c]).sum()
            };
            *number = *number + self.varied(0.0, here);
        }
        let with = self.rates(&moved, place);
        place.drive.frame = own;
        for n in 0..MAX_COMPONENTS {
            place.y[n] = place.y[n] + (with[n] - without[n]);
        }
    }

    /// Carries the state on by the times `by` of the directions.
    #[inline(always)]
    fn carry(&self, input: &Input<RunDual<R>>, place: &mut Place<'_, R>, by: RunDual<R>) {
        if by.slope.iter().all(|by| by.is_zero() & R::ALL == R::ALL) {
            return;
        }
        let rate = self.rates(input, place);
        for n in 0..MAX_COMPONENTS {
            // `by` has the value zero, so that only the derivatives of the state change.
            place.y[n] = place.y[n] + by * rate[n];
        }
    }

    #[inline(always)]
    fn rates(&self, input: &Input<RunDual<R>>, Place { drive, y, .. }: &Place<'_, R>) -> DualStates<R> {
        let mut rate = [RunDual::zero(); MAX_COMPONENTS];
        let at = StageState { from: y, by: RunDual::zero(), along: y };
        self.equations.system.rates(input, drive, at, &mut rate);
        rate
    }
}

/// What is kept of a run with its derivatives in some directions.
pub(super) struct Kept<'a, R> {
    /// The times of the rows.
    pub times: &'a [f64],
    /// For each direction the components of all rows; NaN if they are not taken.
    pub numbers: &'a mut [f64],
    pub taken: usize,
    /// The summaries, if any are wanted, and the run's options.
    pub summaries: Option<Summaries<RunDual<R>>>,
    pub options: &'a Options,
}

impl<R: Lanes> Kept<'_, R> {
    /// Whether it needs no further instant.
    pub fn is_full(&self) -> bool {
        self.taken == self.times.len()
    }

    /// Whether it wants the instant at this end of a step.
    #[inline(always)]
    pub fn wants(&self, time: f64) -> bool {
        let next = self.times.get(self.taken);
        next.is_some_and(|&row| row == time || self.summaries.is_some())
    }

    /// The next row inside a step that ends at `end`.
    pub fn next_before(&self, end: f64) -> Option<f64> {
        self.times.get(self.taken).copied().filter(|&time| time < end)
    }

    /// Leaves out what is missing, because the run cannot be followed to it.
    pub fn give_up(&mut self) {
        (self.taken, self.summaries) = (self.times.len(), None);
    }

    #[inline(always)]
    fn take(
        &mut self,
        time: f64,
        Place { equations: RunDualEquations { system, .. }, limits, drive, y, .. }: &Place<'_, R>,
        now: &Evaluation<RunDual<R>>,
    ) {
        let zero = RunDual::zero();
        if let Some(summaries) = &mut self.summaries {
            let t = RunDual::constant(time);
            let instant = SummaryInstant { t, now, slipped: zero, closure: zero, half_width: zero };
            summaries.watch(&instant, R::ALL);
            if summaries.wanted.set.contains(Summary::Margin) {
                let &Options { contact, stop_on, .. } = self.options;
                let contacts = (contact == ContactModel::Unilateral).then_some(&drive.contacts);
                let seen = R::ALL & summaries.after.at_most(t);
                let memory = &mut summaries.memory[Summary::Margin as usize];
                Margins { limits, now, contacts, stop_on, memory, seen }.run();
            }
        }
        if self.times[self.taken] != time {
            return;
        }
        let mut energy = [zero; 3 + BILATERAL_WORKS];
        let size = system.size();
        if size.works > 0 {
            let energies = system.energies(&Contacts::sticking(), &now.motion);
            energy[..3].copy_from_slice(&[energies.kinetic, energies.elastic, energies.gravity]);
            energy[3..].copy_from_slice(&y[size.states..][..size.works]);
        }
        let row = now.motion.row().into_iter().chain(now.multipliers).chain(now.torque).chain(energy);
        for (component, number) in row.enumerate() {
            for (k, own) in self.numbers.chunks_mut(self.times.len() * COMPONENTS).enumerate() {
                own[self.taken * COMPONENTS + component] = number.direction(k);
            }
        }
        self.taken += 1;
    }

    /// The derivative of a summary; NaN if it has none, or has seen no instant.
    pub fn slope(&self, summary: Summary, direction: usize) -> f64 {
        let Some(Summaries { memory, .. }) = &self.summaries else { return f64::NAN };
        let memory = memory[summary as usize];
        let values = memory.map(|number| number.lane(0));
        summary.slope(values, memory.map(|number| number.direction(direction))).unwrap_or(f64::NAN)
    }
}

task! {
    /// Gives an instant to what is kept.
    ['a, 's, R: Lanes]
    Take<'a, 's, R>(kept: &'a mut Kept<'s, R>, time: f64, place: &'a Place<'a, R>, now: &'a Evaluation<RunDual<R>>)
    for R => () = kept.take(time, place, now)
}
