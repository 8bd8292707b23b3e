//! The derivatives of a run, in directions of the caller's choice: parameters, inputs, the start, and the times of
//! breakpoints and impulses. They are the derivatives of the numbers that the run computes, with the lengths of
//! its steps held.
//!
//! The run is computed again, step by step, with its derivatives beside it.

// Loops over several arrays at once are clearer with an index.
#![allow(clippy::needless_range_loop)]

use std::mem::swap;

use crate::driver::simulate::simulate;
use crate::error::Error;
use crate::formulation::equations::{Evaluation, MAX_COMPONENTS, States};
use crate::formulation::system::{StageState, System};
use crate::formulation::varied_equations::{DIRECTIONS, Varied, VariedEquations};
use crate::method::dop853::Dop853;
use crate::method::lone::{implicit_midpoint, radau5, rosenbrock};
use crate::method::rk4::Rk4;
use crate::method::table::Method;
use crate::method::traits::{Integrator, Runs, Stats, Step, Unsolved};
use crate::method::varied::{Segments, Solved, values};
use crate::model::contact_modes::{ContactModel, Contacts};
use crate::model::drive::{Drive, Input, SegmentDrive};
use crate::model::energy::BILATERAL_WORKS;
use crate::model::inputs::Inputs;
use crate::model::motion::{Motion, unpacked};
use crate::model::parameters::{PARAMETER_COUNT, Parameters};
use crate::model::scene::Scene;
use crate::model::source::VariedParameters;
use crate::model::start::Start;
use crate::number::lanes::{LaneTask, Lanes, MOST};
use crate::number::real::Real;
use crate::stepping::grid::{Grid, Segment, Span};
use crate::stepping::options::{Options, Steps};
use crate::stepping::queue::POLL;
use crate::stepping::record::Selection;

/// A direction in which a run is differentiated.
#[derive(Debug, Clone)]
pub struct Direction {
    /// The derivatives of the parameters.
    pub parameters: [f64; PARAMETER_COUNT],
    /// The derivatives of the inputs while the breakpoints stay: pieces, sinusoids and impulses as many as those of
    /// the scene, at the same times.
    pub inputs: Inputs,
    /// The derivative of the start.
    pub initial: Motion<f64>,
    /// What inputs that jump add where their breakpoint moves.
    pub shifts: Vec<Shift>,
    /// The derivative of the time of each impulse, in the order of their times; empty if all are zero.
    pub impulse_times: Vec<f64>,
}

impl Direction {
    /// A direction in which nothing changes.
    #[must_use]
    pub fn still() -> Self {
        Self {
            parameters: [0.0; PARAMETER_COUNT],
            inputs: Inputs::constant_targets([0.0; 2]),
            initial: Motion { q: [0.0; 9], p: [0.0; 9], memory: [0.0; 2] },
            shifts: Vec::new(),
            impulse_times: Vec::new(),
        }
    }
}

/// The derivative of inputs that jump at a breakpoint by the breakpoint's time is an impulse of the inputs:
/// minus the jump.
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

/// An instant of a run, with its derivatives.
#[derive(Debug, Clone, Copy)]
pub struct VariedRow {
    /// Coordinates, velocities and memories.
    pub motion: Motion<Varied>,
    /// The multipliers.
    pub multipliers: [Varied; 4],
    /// The torques on the fingers.
    pub torque: [Varied; 2],
    /// Kinetic, elastic and gravity energy and the works of the ledger; zero if the run has no ledger.
    pub energy: [Varied; 3 + BILATERAL_WORKS],
}

/// The derivatives of a run at the times `rows`, which are instants of the run: ends of its steps, or with free steps
/// any. `start` says what the scene's start follows from; `None` if it is given. Returns fewer rows if
/// `interrupted` says so.
///
/// At a breakpoint the row has the state before its shifts and impulses.
pub fn sensitivities(
    scene: &Scene,
    options: &Options,
    start: Option<Start>,
    directions: &[Direction; DIRECTIONS],
    rows: &[f64],
    interrupted: &dyn Fn() -> bool,
) -> Result<Vec<VariedRow>, Error> {
    if options.contact != ContactModel::Bilateral || scene.inputs.sampled().is_some() {
        return Err(Error::Unknown {
            field: "sensitivities",
            name: "of this scene".to_owned(),
            allowed: "those with contact = \"bilateral\" and without a SampledController".to_owned(),
        });
    }
    let slopes = |k: usize| Parameters::unchecked(&directions[k].parameters);
    let source = VariedParameters { parameters: &scene.parameters, slopes: std::array::from_fn(slopes) };
    let instructions = options.simd.require()?;
    let choice = options.choice(scene.inputs.fingers());
    let gains = &options.stabilization;
    let twice = options.method == Method::Rosenbrock;
    let system = VariedEquations::new(instructions, choice, &source, gains, twice);
    let ends = match &options.steps {
        Steps::Fixed(_) => None,
        Steps::Free { tolerance, .. } => {
            let steps = Steps::Free { tolerance: *tolerance, times: None };
            let record = Selection::default();
            let times = Options { steps, record, every: 1, ..options.clone() };
            Some(simulate(scene, &times, interrupted)?.0.recording.t)
        }
    };
    let walk = Walk { scene, options, start, directions, source, system, ends, rows, interrupted };
    let parameters = &[&scene.parameters; MOST];
    let runs = Runs { instructions, choice, parameters, gains };
    let own = runs.system::<f64>();
    match options.method {
        Method::Rk4 => f64::call(instructions, WalkTask(walk, Rk4::new())),
        Method::Dop853 => f64::call(instructions, WalkTask(walk, Dop853::new())),
        Method::ImplicitMidpoint => {
            f64::call(instructions, WalkTask(walk, Solved::new(implicit_midpoint(runs, &own), own)))
        }
        Method::Radau5 => f64::call(instructions, WalkTask(walk, Solved::new(radau5(runs, &own), own))),
        Method::Rosenbrock => {
            f64::call(instructions, WalkTask(walk, Solved::new(rosenbrock(runs, &own), own)))
        }
    }
}

/// A run with its derivatives.
struct Walk<'a> {
    scene: &'a Scene,
    options: &'a Options,
    start: Option<Start>,
    directions: &'a [Direction; DIRECTIONS],
    source: VariedParameters<'a, DIRECTIONS>,
    system: VariedEquations,
    /// The ends of free steps.
    ends: Option<Vec<f64>>,
    rows: &'a [f64],
    interrupted: &'a dyn Fn() -> bool,
}

/// Walks with a method.
struct WalkTask<'a, I>(Walk<'a>, I);

/// A step: its start since the segment's, its length, and the time at its end.
struct Stride {
    tau: f64,
    h: f64,
    end: f64,
}

/// The steps that a run takes.
enum Course {
    Equal(Grid),
    /// The ends of free steps, and the number of those that are behind.
    Free {
        span: Span,
        ends: Vec<f64>,
        behind: usize,
    },
}

impl Course {
    /// A segment of free steps.
    fn free(span: &Span, inputs: &Inputs, from: f64) -> Segment {
        let end = span.segment_end(inputs, from);
        Segment { anchor: from, start: from, end, h: 0.0, first: 0, count: 0 }
    }

    /// The segment in which the run starts.
    fn first(&self, inputs: &Inputs) -> Segment {
        match self {
            Self::Equal(grid) => grid.first,
            Self::Free { span, .. } => Self::free(span, inputs, span.start),
        }
    }

    /// The segment after this one; `None` after the last.
    fn after(&self, inputs: &Inputs, segment: &Segment) -> Option<Segment> {
        match self {
            Self::Equal(grid) => grid.after(inputs, segment),
            Self::Free { span, .. } => {
                (segment.end < span.end).then(|| Self::free(span, inputs, segment.end))
            }
        }
    }

    /// The step of a segment after `taken` steps of it.
    fn next(&mut self, segment: &Segment, taken: u64) -> Option<Stride> {
        match self {
            Self::Equal(_) => {
                let step = segment.first + taken;
                let (tau, h, end) = (segment.tau(step), segment.h, segment.time(step + 1));
                (step < segment.count).then_some(Stride { tau, h, end })
            }
            Self::Free { ends, behind, .. } => {
                let end = *ends.get(*behind).filter(|&&end| end <= segment.end)?;
                let from = if taken == 0 { segment.anchor } else { ends[*behind - 1] };
                *behind += 1;
                Some(Stride { tau: from - segment.anchor, h: end - from, end })
            }
        }
    }
}

impl<I: Integrator<Varied, VariedEquations> + Segments> LaneTask<f64> for WalkTask<'_, I> {
    type Output = Result<Vec<VariedRow>, Error>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self(mut walk, mut method) = self;
        let mut course = walk.course()?;
        let Walk { scene, system, rows, .. } = &walk;
        let inputs = &scene.inputs;
        let mut segment = course.first(inputs);
        let mut drive = walk.drive(segment.anchor);
        let mut y = system.begin(&walk.begin(&drive));
        let mut next = [Varied::zero(); MAX_COMPONENTS];
        let mut now = Evaluation::nothing();
        let mut found = Vec::new();
        let mut stats = Stats::default();
        loop {
            let linearized = scene.initial.linearized.filter(|_| segment.first > 0).map(|point| {
                let (tau, motion) = unpacked(&point);
                (tau, values(&system.begin(&constant(&motion))))
            });
            method.begin(inputs.segment(segment.anchor), linearized);
            let tau = Varied::constant(segment.tau(segment.first));
            system.evaluate_into(&drive, tau, &y, &mut now);
            walk.emit(segment.start, &now, &y, &mut found);
            // A run that is resumed inside a segment has already had what happens at the start of the segment.
            if segment.first == 0 && walk.pass(segment.start, &drive, &mut y) {
                system.evaluate_into(&drive, tau, &y, &mut now);
            }
            let mut taken = 0;
            while let Some(Stride { tau, h, end }) = course.next(&segment, taken) {
                if found.len() == rows.len() {
                    return Ok(found);
                }
                let tau = Varied::constant(tau);
                // With free steps a row may be inside a step: a step that ends there has its derivatives.
                while let Some(&row) = rows.get(found.len()).filter(|&&row| row < end) {
                    let part = Varied::constant((row - segment.anchor) - tau.value);
                    let step = Step { tau, h: part, y: &y, rate: &now.rate, allowed: None };
                    let mut inside = now;
                    let attempt = method.step(system, &drive, &step, &mut next, &mut stats);
                    attempt.map_err(|failure| unsolved(row, failure.into()))?;
                    system.correct(&drive, tau + part, &mut next);
                    system.evaluate_into(&drive, tau + part, &next, &mut inside);
                    walk.emit(row, &inside, &next, &mut found);
                }
                let length = Varied::constant(h);
                let step = Step { tau, h: length, y: &y, rate: &now.rate, allowed: None };
                let attempt = method.step(system, &drive, &step, &mut next, &mut stats);
                attempt.map_err(|failure| unsolved(end, failure.into()))?;
                system.correct(&drive, tau + length, &mut next);
                swap(&mut y, &mut next);
                taken += 1;
                stats.steps += 1;
                if stats.steps.is_multiple_of(POLL) && (walk.interrupted)() {
                    return Ok(found);
                }
                if end < segment.end {
                    let tau = match course {
                        Course::Equal(_) => segment.tau(segment.first + taken),
                        Course::Free { .. } => end - segment.anchor,
                    };
                    system.evaluate_into(&drive, Varied::constant(tau), &y, &mut now);
                    walk.emit(end, &now, &y, &mut found);
                }
            }
            let Some(later) = course.after(inputs, &segment).filter(|_| found.len() < rows.len()) else {
                let tau = Varied::constant(segment.end - segment.anchor);
                system.evaluate_into(&drive, tau, &y, &mut now);
                walk.emit(segment.end, &now, &y, &mut found);
                return Ok(found);
            };
            segment = later;
            drive = walk.drive(segment.anchor);
        }
    }
}

impl Walk<'_> {
    /// The steps that the run takes.
    fn course(&mut self) -> Result<Course, Error> {
        let Scene { inputs, initial, duration, .. } = self.scene;
        let span = Span::new(inputs, initial, *duration)?;
        match (&self.options.steps, self.ends.take()) {
            (Steps::Fixed(dt), _) => {
                Ok(Course::Equal(Grid::new(inputs, initial, *duration, *dt, self.options.refine)?))
            }
            (_, ends) => Ok(Course::Free { span, ends: ends.unwrap_or_default(), behind: 1 }),
        }
    }

    /// The inputs of the segment from `anchor` on.
    fn drive(&self, anchor: f64) -> SegmentDrive<Varied> {
        let slopes = std::array::from_fn(|k| self.directions[k].inputs.segment(anchor));
        SegmentDrive::varied(&self.scene.inputs.segment(anchor), &slopes)
    }

    /// The start of the run.
    fn begin(&self, drive: &SegmentDrive<Varied>) -> Motion<Varied> {
        let mut motion = constant(&Motion {
            q: self.scene.initial.q,
            p: self.scene.initial.p,
            memory: self.scene.initial.memory,
        });
        if let Some(start) = self.start {
            let input = drive.at(Varied::zero());
            let derived = start.varied(&self.source, &input, &self.scene.initial.q);
            for n in 0..9 {
                motion.q[n].slope = derived.q[n].slope;
                motion.p[n].slope = derived.p[n].slope;
            }
        }
        for (k, Direction { initial, .. }) in self.directions.iter().enumerate() {
            for n in 0..9 {
                motion.q[n].slope[k] += initial.q[n];
                motion.p[n].slope[k] += initial.p[n];
            }
            for i in 0..2 {
                motion.memory[i].slope[k] += initial.memory[i];
            }
        }
        motion
    }

    /// Adds a row if `time` is the next one that is wanted.
    fn emit(&self, time: f64, now: &Evaluation<Varied>, y: &States<Varied>, found: &mut Vec<VariedRow>) {
        if self.rows.get(found.len()) != Some(&time) {
            return;
        }
        let mut energy = [Varied::zero(); 3 + BILATERAL_WORKS];
        let size = self.system.size();
        if size.works > 0 {
            let energies = self.system.energies(&Contacts::sticking(), &now.motion);
            energy[..3].copy_from_slice(&[energies.kinetic, energies.elastic, energies.gravity]);
            energy[3..].copy_from_slice(&y[size.states..size.all()]);
        }
        found.push(VariedRow {
            motion: now.motion,
            multipliers: now.multipliers,
            torque: now.torque,
            energy,
        });
    }

    /// Applies what happens at a breakpoint: the shifts of inputs whose jump moves, and the impulses. Returns whether
    /// anything did.
    ///
    /// An impulse whose time moves by dt acts on the state that the rates before it reach in dt, and the rates
    /// after it act for dt less.
    fn pass(&self, time: f64, drive: &SegmentDrive<Varied>, y: &mut States<Varied>) -> bool {
        let Self { scene, system, directions, .. } = self;
        let input = drive.at(Varied::zero());
        let rates = |input: &Input<Varied>, y: &States<Varied>| {
            let mut rate = [Varied::zero(); MAX_COMPONENTS];
            let at = StageState { from: y, by: Varied::zero(), along: y };
            system.rates(input, &drive.contacts, at, &mut rate);
            rate
        };
        let mut moved = input;
        let mut passes = false;
        for (k, direction) in directions.iter().enumerate() {
            for shift in direction.shifts.iter().filter(|shift| shift.time == time) {
                passes = true;
                for i in 0..2 {
                    moved.target[i].slope[k] += shift.target[i];
                    moved.target_acceleration[i].slope[k] += shift.acceleration[i];
                }
                for c in 0..3 {
                    moved.force[c].slope[k] += shift.force[c];
                }
            }
        }
        if passes {
            let (with, without) = (rates(&moved, y), rates(&input, y));
            for n in 0..system.size().all() {
                for k in 0..DIRECTIONS {
                    y[n].slope[k] += with[n].slope[k] - without[n].slope[k];
                }
            }
        }
        let first = scene.inputs.impulses_before(time);
        for (place, impulse) in scene.inputs.impulses_at(time).enumerate() {
            passes = true;
            let own = |direction: &Direction, c: usize| {
                direction.inputs.impulses_at(time).nth(place).map_or(0.0, |slope| slope.impulse[c])
            };
            let varied = std::array::from_fn(|c| Varied {
                value: impulse.impulse[c],
                slope: std::array::from_fn(|k| own(&directions[k], c)),
            });
            let by: [f64; DIRECTIONS] = std::array::from_fn(|k| {
                directions[k].impulse_times.get(first + place).copied().unwrap_or(0.0)
            });
            let moves = by.iter().any(|&by| by != 0.0);
            let carry = |y: &mut States<Varied>, sign: f64| {
                let rate = rates(&input, y);
                for n in 0..system.size().all() {
                    for k in 0..DIRECTIONS {
                        y[n].slope[k] += sign * by[k] * rate[n].value;
                    }
                }
            };
            if moves {
                carry(y, 1.0);
            }
            system.jump(&input, y, &varied);
            if moves {
                carry(y, -1.0);
            }
        }
        passes
    }
}

/// A motion without derivatives.
fn constant(motion: &Motion<f64>) -> Motion<Varied> {
    let Motion { q, p, memory } = motion;
    Motion { q: q.map(Varied::constant), p: p.map(Varied::constant), memory: memory.map(Varied::constant) }
}

/// The error of a step whose equations were solved in the run, but not again to round-off.
fn unsolved(time: f64, Unsolved { correction, .. }: Unsolved) -> Error {
    Error::NoDerivative { time, correction }
}
