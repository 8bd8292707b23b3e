//! The derivatives of a run, in directions of the caller's choice: parameters, inputs, the start, and the times of
//! breakpoints and impulses. They are the derivatives of the numbers that the run computes, with the lengths of
//! its steps held. `differentiated_run.rs` follows the run; what is asked for is in `request.rs`.

use crate::driver::contact_derivatives::{LimitsOf, Stepper};
use crate::driver::differentiated_run::{DifferentiatedRun, FollowRun, Kept};
use crate::driver::request::{COMPONENTS, Derivatives, Request};
use crate::driver::simulate;
use crate::error::{Error, Result};
use crate::formulation::{RunDual, RunDualEquations};
use crate::method::Method;
use crate::model::{ContactModel, DIRECTIONS, PARAMETER_COUNT, Parameters, VariedParameters};
use crate::number::{LaneKernel, Lanes, Real, call_four_lanes};
use crate::stepping::{Options, Recordable, Selection, Steps, Summaries, reserved};

/// A step below this share of the run leads to an event at its start. It is too short to choose modes by: the next one has it.
const SLIVER: f64 = 1e-13;

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
