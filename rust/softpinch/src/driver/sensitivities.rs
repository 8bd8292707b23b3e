//! The derivatives of a run, in directions of the caller's choice: parameters, inputs, the start, and the times of
//! breakpoints and impulses. They are the derivatives of the numbers that the run computes, with the lengths of
//! its steps held.

use crate::driver::derivative_sink::{Ends, Rows, Sink};
use crate::driver::differentiated_run::{DifferentiatedRun, FollowRun};
use crate::driver::direction::{COMPONENTS, Direction};
use crate::driver::simulate::simulate;
use crate::error::Error;
use crate::formulation::run_dual::RunDualEquations;
use crate::method::run_dual::RunDualMethod;
use crate::method::table::Method;
use crate::method::traits::Runs;
use crate::model::contact_modes::ContactModel;
use crate::model::parameters::{PARAMETER_COUNT, Parameters};
use crate::model::scene::Scene;
use crate::model::source::{DIRECTIONS, VariedParameters};
use crate::model::start::Start;
use crate::number::lanes::{Lanes, MOST};
use crate::number::simd::dispatch::{LaneKernel, dispatch_four_lanes};
use crate::number::simd::level::Instructions;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::{Selection, reserved};
use crate::stepping::summary::Summary;

/// The derivatives of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Derivatives {
    /// The numbers, one for each direction together.
    pub numbers: Vec<f64>,
    /// Why the run could not be followed to its end, if so; the numbers from there on are NaN.
    pub failed: Option<String>,
}

/// The derivatives of a run at the times `rows`, which are instants of the run. `start` says what the scene's start follows from; `None` if it is given. Returns the components of
/// [`QUANTITIES`](crate::driver::direction::QUANTITIES) row by row, each with one number for every direction; `None` if `interrupted` says so.
///
/// At a breakpoint the row has the state before its shifts and impulses.
pub fn sensitivities(
    scene: &Scene,
    options: &Options,
    start: Option<Start>,
    directions: &[Direction],
    rows: &[f64],
    interrupted: &dyn Fn() -> bool,
) -> Result<Option<Derivatives>, Error> {
    let ends = ends(scene, options, interrupted)?;
    let width = directions.len();
    let count = rows.len().saturating_mul(COMPONENTS * width);
    let mut numbers = reserved("the derivatives, in numbers,", count)?;
    numbers.resize(count, 0.0);
    let wanted = Wanted::Rows { times: rows, numbers: &mut numbers };
    let all = All { scene, options, start, directions, ends: &ends, interrupted, wanted };
    let failed = dispatch_four_lanes(options.simd, all).flatten()?;
    Ok(failed.map(|failed| Derivatives { numbers, failed }))
}

/// The derivatives of a run's last state, 18 numbers, and of its `summaries`, each in every direction: one row for each
/// direction. `until` is the time of the last instant. A summary that has no derivative, or has seen no instant,
/// gives NaN. `None` if `interrupted` says so.
pub fn gradients(
    scene: &Scene,
    options: &Options,
    start: Option<Start>,
    directions: &[Direction],
    (until, summaries): (f64, &[Summary]),
    interrupted: &dyn Fn() -> bool,
) -> Result<Option<Derivatives>, Error> {
    let ends = ends(scene, options, interrupted)?;
    let mut numbers = Vec::new();
    let wanted = Wanted::Ends { until, summaries, numbers: &mut numbers };
    let all = All { scene, options, start, directions, ends: &ends, interrupted, wanted };
    let failed = dispatch_four_lanes(options.simd, all).flatten()?;
    Ok(failed.map(|failed| Derivatives { numbers, failed }))
}

/// The ends of free steps, from the run itself. Refuses scenes whose derivatives are not computed.
fn ends(scene: &Scene, options: &Options, interrupted: &dyn Fn() -> bool) -> Result<Vec<f64>, Error> {
    if options.contact != ContactModel::Bilateral || scene.inputs.sampled().is_some() {
        return Err(Error::Unknown {
            field: "sensitivities",
            name: "of this scene".to_owned(),
            allowed: "those with contact = \"bilateral\" and without a SampledController".to_owned(),
        });
    }
    match &options.steps {
        Steps::Fixed(_) => Ok(Vec::new()),
        Steps::Free { .. } => {
            let ends = Options { record: Selection::default(), every: 1, times: None, ..options.clone() };
            Ok(simulate(scene, &ends, interrupted)?.0.recording.t)
        }
    }
}

/// What is wanted of a run, and where it goes.
enum Wanted<'a> {
    Rows { times: &'a [f64], numbers: &'a mut [f64] },
    Ends { until: f64, summaries: &'a [Summary], numbers: &'a mut Vec<f64> },
}

/// All directions, in chunks of eight.
struct All<'a> {
    scene: &'a Scene,
    options: &'a Options,
    start: Option<Start>,
    directions: &'a [Direction],
    ends: &'a [f64],
    interrupted: &'a dyn Fn() -> bool,
    wanted: Wanted<'a>,
}

impl LaneKernel for All<'_> {
    /// Where the derivatives end before the run, in words; `None` if the caller stopped.
    type Output = Result<Option<Option<String>>, Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { scene, options, start, directions: all, ends, interrupted, mut wanted } = self;
        let choice = options.choice(scene.inputs.fingers());
        let gains = &options.stabilization;
        let parameters = &[&scene.parameters; MOST];
        let runs = Runs { instructions, choice, parameters, gains };
        let mut failed = None;
        let summaries = if let Wanted::Ends { summaries, .. } = wanted { summaries } else { &[] };
        for (chunk, directions) in all.chunks(DIRECTIONS).enumerate() {
            let slopes = std::array::from_fn(|k| {
                let own = directions.get(k).map_or([0.0; PARAMETER_COUNT], |own| own.parameters);
                Parameters::unchecked(&own)
            });
            let source = VariedParameters { parameters: &scene.parameters, slopes };
            let twice = options.method == Method::Rosenbrock;
            let equations = RunDualEquations::<R>::new(instructions, choice, &source, gains, twice);
            let run = DifferentiatedRun {
                instructions,
                scene,
                options,
                start,
                directions,
                source,
                equations,
                ends,
                interrupted,
            };
            let mut sink = match &mut wanted {
                Wanted::Rows { times, numbers } => {
                    Sink::Rows(Rows { times, numbers, first: chunk * DIRECTIONS, width: all.len(), taken: 0 })
                }
                Wanted::Ends { until, .. } => Sink::Ends(Ends::new(&options.summaries, *until)),
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
            let mut found = Vec::new();
            if let Sink::Ends(ends) = &sink {
                for k in 0..directions.len() {
                    found.extend(ends.state(k));
                    found.extend(summaries.iter().map(|&summary| ends.slope(summary, k)));
                }
            }
            if let Wanted::Ends { numbers, .. } = &mut wanted {
                numbers.append(&mut found);
            }
        }
        Ok(Some(failed))
    }
}
