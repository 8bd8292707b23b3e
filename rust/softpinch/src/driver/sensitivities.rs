//! The derivatives of a run, in directions of the caller's choice: parameters, inputs, the start, and the times of
//! breakpoints and impulses. They are the derivatives of the numbers that the run computes, with the lengths of
//! its steps held.

use crate::driver::differentiated_run::{DifferentiatedRun, Ends, FollowRun, Request, Rows, Sink};
use crate::driver::simulate::simulate;
use crate::error::{Error, Result};
use crate::formulation::run_dual::RunDualEquations;
use crate::method::run_dual::RunDualMethod;
use crate::method::table::Method;
use crate::model::contact_modes::ContactModel;
use crate::model::energy::BILATERAL_WORKS;
use crate::model::inputs::Inputs;
use crate::model::motion::Motion;
use crate::model::parameters::{PARAMETER_COUNT, Parameters};
use crate::model::scene::Scene;
use crate::model::source::{DIRECTIONS, VariedParameters};
use crate::model::start::Start;
use crate::number::lanes::Lanes;
use crate::number::simd::dispatch::{LaneKernel, dispatch_four_lanes};
use crate::number::simd::level::Instructions;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::{Selection, reserved};
use crate::stepping::summary::Summary;

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
    let ends = &ends(scene, options, interrupted)?;
    let mut numbers = Vec::new();
    if let Wanted::Rows(times) = wanted {
        let count = times.len().saturating_mul(COMPONENTS * directions.len());
        numbers = reserved("the derivatives, in numbers,", count)?;
        numbers.resize(count, 0.0);
    }
    let request = Request { scene, options, start, ends, interrupted };
    let all = All { request, directions, wanted, numbers };
    dispatch_four_lanes(options.simd, all).flatten()
}

/// The ends of free steps, from the run itself. Refuses scenes whose derivatives are not computed.
fn ends(scene: &Scene, options: &Options, interrupted: &dyn Fn() -> bool) -> Result<Vec<f64>> {
    if options.contact != ContactModel::Bilateral || scene.inputs.sampled().is_some() {
        let allowed = "those with contact = \"bilateral\" and without a SampledController".to_owned();
        return Err(Error::Unknown { field: "sensitivities", name: "of this scene".to_owned(), allowed });
    }
    match &options.steps {
        Steps::Fixed(_) => Ok(Vec::new()),
        Steps::Free { .. } => {
            let ends = Options { record: Selection::default(), every: 1, times: None, ..options.clone() };
            Ok(simulate(scene, &ends, interrupted)?.0.recording.t)
        }
    }
}

/// All directions, in chunks of eight.
struct All<'a> {
    request: Request<'a>,
    directions: &'a [Direction],
    wanted: Wanted<'a>,
    numbers: Vec<f64>,
}

impl LaneKernel for All<'_> {
    type Output = Result<Option<Derivatives>>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { ref request, directions: all, wanted, mut numbers } = self;
        let Request { scene, options, .. } = *request;
        let runs = options.runs(instructions, scene);
        let mut failed = None;
        for (chunk, directions) in all.chunks(DIRECTIONS).enumerate() {
            let slopes = std::array::from_fn(|k| {
                let own = directions.get(k).map_or([0.0; PARAMETER_COUNT], |own| own.parameters);
                Parameters::unchecked(&own)
            });
            let source = VariedParameters { parameters: &scene.parameters, slopes };
            let twice = options.method == Method::Rosenbrock;
            let equations = RunDualEquations::<R>::new(instructions, runs.choice, &source, runs.gains, twice);
            let run = DifferentiatedRun { instructions, request, directions, source, equations };
            let mut sink = match wanted {
                Wanted::Rows(times) => {
                    let (numbers, first) = (&mut numbers[..], chunk * DIRECTIONS);
                    Sink::Rows(Rows { times, numbers, first, width: all.len(), taken: 0 })
                }
                Wanted::Ends { until, .. } => Sink::Ends(Ends::new(&options.summaries, until)),
            };
            let mut method = RunDualMethod::new(runs, options.method);
            match R::call(instructions, FollowRun(&run, &mut method, &mut sink)) {
                Ok(()) if sink.is_full() => {}
                Ok(()) => return Ok(None),
                Err(failure @ Error::NoDerivative { .. }) => {
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
        Ok(Some(Derivatives { numbers, failed }))
    }
}
