//! The derivatives of a run, in directions of the caller's choice: parameters, inputs, the start, and the times of
//! breakpoints and impulses. They are the derivatives of the numbers that the run computes, with the lengths of
//! its steps held. `differentiated_run.rs` follows the run; what is asked for, and kept of it, is here.

use crate::driver::contact_derivatives::{LimitsOf, Place, Stepper};
use crate::driver::differentiated_run::{DifferentiatedRun, FollowRun};
use crate::driver::simulate;
use crate::error::{Error, Result};
use crate::formulation::{Evaluation, RunDual, RunDualEquations, System};
use crate::method::Method;
use crate::model::{
    BILATERAL_WORKS, ContactModel, Contacts, DIRECTIONS, Inputs, Motion, PARAMETER_COUNT, Parameters,
    RELAXATIONS, Scene, Start, VariedParameters,
};
use crate::number::{LaneKernel, LaneTask, Lanes, Real, call_four_lanes, task};
use crate::stepping::{
    Margins, Options, Recordable, Selection, Steps, Summaries, Summary, SummaryInstant, reserved,
};

/// A step below this share of the run leads to an event at its start. It is too short to choose modes by: the next one has it.
const SLIVER: f64 = 1e-13;

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

impl Direction {
    /// Whether a breakpoint at which inputs jump moves.
    pub(super) fn moves(&self, time: f64) -> bool {
        self.shifts.iter().any(|shift| shift.time == time)
    }
}

/// The derivative of inputs by the time of a breakpoint at which they jump: an impulse of minus the jump.
#[derive(Debug, Clone, Copy)]
pub struct Shift {
    /// The time of the breakpoint, s.
    pub time: f64,
    /// Minus the jumps, times the derivative of the time: of the targets (rad or N m), of the accelerations of driven
    /// fingers, of the forces on the object (N and N m), and of the acceleration of the hand along fixed axes.
    pub by: [f64; 9],
}

/// The quantities whose derivatives a row has, with the number of components of each.
pub const QUANTITIES: [(&str, usize); 6] = [
    ("state", 18),
    ("integral", 2),
    ("relaxation", RELAXATIONS),
    ("multipliers", 4),
    ("torque", 2),
    ("energy", 3 + BILATERAL_WORKS),
];

/// Number of components of a row.
pub const COMPONENTS: usize = 20 + RELAXATIONS + 4 + 2 + 3 + BILATERAL_WORKS;

/// Why a run could not be followed to its end in a direction, if so; the numbers from there on are NaN. And the derivatives of
/// the times of the changes of contacts' modes until then.
pub type DirectionEnd = (Option<String>, Vec<f64>);

/// The derivatives of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Derivatives {
    /// For each direction the components of [`QUANTITIES`], row by row.
    pub numbers: Vec<f64>,
    /// The summaries, for each direction together. A summary that has no derivative, or has seen no instant, gives NaN.
    pub summaries: Vec<f64>,
    /// For each direction where its numbers end.
    pub ends: Vec<DirectionEnd>,
}

/// A run, and what is wanted of its derivatives.
#[derive(Clone, Copy)]
#[allow(missing_docs)] // of fields that their types explain
pub struct Request<'a> {
    pub scene: &'a Scene,
    pub options: &'a Options,
    /// What the scene's start follows from, if it is not given.
    pub start: Option<Start>,
    pub directions: &'a [Direction],
    /// The instants of the rows. At a breakpoint a row has the state before its shifts and impulses. Without rows, the scene is
    /// only checked.
    pub rows: &'a [f64],
    /// Summaries until the last row.
    pub summaries: &'a [Summary],
    /// Called every few milliseconds, says whether to stop.
    pub interrupted: &'a dyn Fn() -> bool,
}

/// The derivatives of a run; `None` if it is interrupted. Refuses scenes whose derivatives are not computed.
pub fn sensitivities(request: Request<'_>) -> Result<Option<Derivatives>> {
    let Request { scene, options, .. } = request;
    let unilateral = options.contact == ContactModel::Unilateral;
    let energy = options.record.contains(Recordable::Energy);
    let remembers = scene.parameters.branches() > 0 && options.method == Method::Radau5;
    let refused = [
        (scene.inputs.sampled.is_some(), "control", "SampledController", "the others"),
        (remembers, "method", "radau5", "the others with Maxwell branches"),
        (unilateral && energy, "record", "energy", "the others in unilateral contact"),
    ];
    if let Some((_, field, name, allowed)) = refused.into_iter().find(|(refused, ..)| *refused) {
        return Err(Error::unknown(field, name, format_args!("{allowed} with sensitivities")));
    }
    if request.rows.is_empty() {
        return Ok(Some(Derivatives::default()));
    }
    let mut ends = Vec::new();
    if let Steps::Free { .. } = options.steps {
        let every = Options { record: Selection::default(), every: 1, times: None, ..options.clone() };
        ends = simulate(scene, &every, request.interrupted)?.0.recording.t().to_vec();
        ends.dedup_by(|end, start| *end - *start < SLIVER * scene.duration);
    }
    options.simd.require()?;
    call_four_lanes(Followed { request, ends: &ends })
}

/// A run that is followed: all directions, in chunks of [`DIRECTIONS`]. `ends` has the ends of free steps.
struct Followed<'a> {
    request: Request<'a>,
    ends: &'a [f64],
}

impl LaneKernel for Followed<'_> {
    type Output = Result<Option<Derivatives>>;

    #[inline(always)]
    fn run<R: Lanes>(self) -> Self::Output {
        let Self { request, ends } = self;
        let Request { scene, options, directions: all, rows: times, summaries: wanted, .. } = request;
        let mut found = Derivatives::default();
        let count = times.len().saturating_mul(COMPONENTS * all.len());
        found.numbers = reserved("the derivatives, in numbers,", count)?;
        found.numbers.resize(count, f64::NAN);
        let runs = options.runs(scene);
        let parts = found.numbers.chunks_mut(times.len() * COMPONENTS * DIRECTIONS);
        for (directions, numbers) in all.chunks(DIRECTIONS).zip(parts) {
            let slopes = std::array::from_fn(|k| {
                let own = directions.get(k).map_or([0.0; PARAMETER_COUNT], |own| own.parameters);
                Parameters::unchecked(&own)
            });
            let source = VariedParameters { parameters: &scene.parameters, slopes };
            let twice = options.method == Method::Rosenbrock;
            let equations = RunDualEquations::<R>::new(runs.choice, &source, runs.gains, twice);
            let stepper = &mut Stepper::new(runs, &request, directions.len())?;
            let limits = RunDual::outlined(LimitsOf { source: &source });
            let run = DifferentiatedRun { request, ends, directions, source, equations, limits };
            let summaries = (!wanted.is_empty()).then(|| Summaries::new(&options.summaries));
            let mut kept = Kept { times, numbers, taken: 0, summaries, options };
            let mut unsolved = None;
            match R::outlined(FollowRun { run: &run, stepper, kept: &mut kept }) {
                Ok(()) if kept.is_full() => {}
                Ok(()) => return Ok(None),
                Err(error @ Error::NoDerivative { .. }) => {
                    kept.give_up();
                    unsolved = Some(error.to_string());
                }
                Err(error) => return Err(error),
            }
            for k in 0..directions.len() {
                found.summaries.extend(wanted.iter().map(|&summary| kept.slope(summary, k)));
                let (lost, changes) = stepper.changes(k);
                found.ends.push((unsolved.clone().or(lost), changes));
            }
        }
        Ok(Some(found))
    }
}

/// What is kept of a run with its derivatives in some directions.
pub(super) struct Kept<'a, R> {
    /// The times of the rows.
    times: &'a [f64],
    /// For each direction the components of all rows; NaN if they are not taken.
    numbers: &'a mut [f64],
    taken: usize,
    /// The summaries, if any are wanted, and the run's options.
    pub summaries: Option<Summaries<RunDual<R>>>,
    options: &'a Options,
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
    fn slope(&self, summary: Summary, direction: usize) -> f64 {
        let Some(Summaries { memory, .. }) = &self.summaries else { return f64::NAN };
        let memory = memory[summary as usize];
        let values = memory.map(|number| number.lane(0));
        summary.slope(values, memory.map(|number| number.direction(direction))).unwrap_or(f64::NAN)
    }
}

task! {
    /// Gives an instant to what is kept.
    pub(super) ['a, 's, R: Lanes]
    Take<'a, 's, R>(kept: &'a mut Kept<'s, R>, time: f64, place: &'a Place<'a, R>, now: &'a Evaluation<RunDual<R>>)
    for R => () = kept.take(time, place, now)
}
