//! One run: the checks before it, and its result.

use std::borrow::Cow;

use crate::driver::loops::{adaptive, whole_run};
use crate::error::{Error, Result, require};
use crate::formulation::{Contact, Formulation};
use crate::model::{
    BILATERAL_WORKS, CONTACT_WORKS, ContactModel, Fingers, Mode, Rule, Sampled, Scene, Stabilization, WORKS,
    require_consistent, require_held, require_scheduled,
};
use crate::stepping::{
    COLUMNS, Column, Due, Finished, Grid, LaneController, Options, Recordable, Recorder, Recording, Run,
    RunLoop, RunQueue, Span, Steps, Taken, reserved,
};

/// Advice for steps that are too long for the gains of the stabilisation; `None` if they are not.
pub fn stability_warning(options: &Options, longest: f64) -> Option<String> {
    if options.formulation != Formulation::Csm {
        return None;
    }
    let limit = options.method.entry().real_stability_limit?;
    let Stabilization { alpha, beta } = options.stabilization;
    let (name, gain) = if alpha >= beta { ("alpha", alpha) } else { ("beta", beta) };
    (gain * longest > limit).then(|| {
        format!(
            "{name} * dt = {:.4} is beyond {:.4}, where {} stops damping the constraint \
             stabilisation's own modes: take dt <= {:.3e} s, or {name} <= {:.4e} 1/s, or formulation \
             \"nullspace\", which has no gains",
            gain * longest,
            limit,
            options.method.name(),
            limit / gain,
            limit / longest,
        )
    })
}

/// Simulates a scene. `interrupted` is called every few milliseconds and says whether to stop. The run comes
/// with advice on stability. Bad input is the only error.
pub fn simulate(
    scene: &Scene,
    options: &Options,
    interrupted: &dyn Fn() -> bool,
) -> Result<(Run, Option<String>)> {
    let options = &Options { guard: options.guard || options.guards(scene), ..options.clone() };
    let (grid, times) = prepare(scene, options)?;
    // Free steps make the number of rows unknown beforehand.
    let rows = grid.as_ref().map_or(0, |grid| grid.steps / options.every + 2);
    let rows = times.as_ref().map_or(rows, |times| times.len() as u64 + 1);
    let recording = Recording::with_capacity(widths(scene, options), rows)?;
    let warning = stability_warning(options, grid.as_ref().map_or(0.0, |grid| grid.longest));
    let due = match &times {
        Some(times) => Due::Times(times),
        None => Due::Steps { every: options.every, left: 0 },
    };
    // Only equal steps ask for a grid.
    let grid = |_: usize, scene: &Scene| grid.clone().map_or_else(|| whole_run(options)(0, scene), Ok);
    let mut next = Some(Taken { number: 0, scene: Cow::Borrowed(scene), contact: None });
    let mut finished = None;
    let (mut take, mut finish) = (|| Ok(next.take()), |run| finished = Some(run));
    let recorder = Recorder::new(recording, due);
    let queue = RunQueue { take: &mut take, stops: interrupted, finish: &mut finish, recorder };
    RunLoop { queue, grid: &grid, options, scene }.alone()?;
    let Some(Finished { run, .. }) = finished else {
        unreachable!("a step loop ends each run that it takes")
    };
    Ok((run, warning))
}

/// Checks a scene and options without computing the run. Returns the longest step if steps are fixed, else zero.
pub fn check(scene: &Scene, options: &Options) -> Result<f64> {
    prepare(scene, options).map(|(grid, ..)| grid.map_or(0.0, |grid| grid.longest))
}

/// The size of a run before it is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outline {
    /// Segments between breakpoints.
    pub segments: u64,
    /// Number of steps; `None` if the error determines it.
    pub steps: Option<u64>,
    /// Bytes of the recording; `None` if the number of rows is not known beforehand.
    pub bytes: Option<u64>,
}

/// Outlines a run. Bad input is the only error.
pub fn outline(scene: &Scene, options: &Options) -> Result<Outline> {
    let (grid, times) = prepare(scene, options)?;
    let row = 8 * widths(scene, options).iter().sum::<usize>() as u64;
    let Scene { inputs, initial, duration, .. } = scene;
    let end = initial.time + duration;
    let (segments, steps) = match grid {
        Some(Grid { segments, steps, .. }) => (segments, Some(steps)),
        // One step to each segment, of which only the segments count.
        None => (Grid::new(inputs, initial, *duration, f64::MAX, 1)?.segments, None),
    };
    // The rows are those that were asked for, or the start and one for every `every` steps; and always the end.
    let rows = match times {
        Some(times) => Some(times.len() as u64 + u64::from(times.last() != Some(&end))),
        None => steps.map(|steps| 1 + steps.div_ceil(options.every)),
    };
    Ok(Outline { segments, steps, bytes: rows.map(|rows| rows * row) })
}

/// Refuses a scene or options with which no run can begin. The times of the run are checked elsewhere. Single
/// runs and runs of an ensemble are checked here.
pub(crate) fn require_valid(scene: &Scene, options: &Options) -> Result {
    options.simd.require()?;
    require(options.every != 0, "every", 0.0, "must be at least 1")?;
    for ((name, rule), value) in Stabilization::FIELDS.iter().zip(options.stabilization.fields()) {
        rule.check(format_args!("stabilization.{name}"), value)?;
    }
    let initial = &scene.initial;
    let branches = scene.parameters.branches() as f64;
    let rule = "must be fewer: beside so many a state has no place for the ledger or slip_distance";
    require(options.fits(scene), "Maxwell branches of a tip", branches, rule)?;
    if scene.inputs.fingers == Fingers::Driven {
        scene.inputs.require_smooth(initial.time, initial.time + scene.duration)?;
        require_scheduled(&scene.parameters, &scene.inputs, initial)?;
    }
    if options.contact == ContactModel::Unilateral {
        require_unilateral(scene, options)?;
    } else if scene.check || options.formulation != Formulation::Csm {
        // Only the stabilisation leads back to the constraints.
        require_consistent(&scene.parameters, &initial.motion.q, &initial.motion.p)?;
    }
    if let Some(Sampled { controller, .. }) = &scene.inputs.sampled {
        controller.check()?;
        LaneController::new(scene)?;
    }
    let Steps::Free { tolerance, .. } = options.steps else { return Ok(()) };
    Rule::Tolerance.check("tolerance", tolerance)?;
    adaptive(options.method).map(|_| ())
}

/// Refuses unilateral contact without friction, and with a formulation whose states are always on all constraints.
fn require_unilateral(scene: &Scene, options: &Options) -> Result {
    if options.formulation == Formulation::Nullspace {
        let allowed = "\"csm\" or \"projected\" where contact = \"unilateral\": the states of nullspace are on the constraints of both \
                       contacts always";
        return Err(Error::unknown("formulation", "nullspace", allowed));
    }
    for (name, value) in
        ["friction.right", "friction.left"].into_iter().zip(scene.parameters.friction.fields())
    {
        require(value.is_finite(), name, value, "must be finite where contact = \"unilateral\"")?;
    }
    let Some(row) = &scene.initial.contact else { return Ok(()) };
    let contacts = Contact::of_row(row)?;
    if scene.check || options.formulation != Formulation::Csm {
        // Only the stabilisation leads back to the constraints.
        let held = |kind: usize, i: usize| match kind {
            0 => contacts[i].closed,
            _ => contacts[i].mode == Mode::Stick,
        };
        require_held(&scene.parameters, &scene.initial.motion.q, &scene.initial.motion.p, held)?;
    }
    Ok(())
}

/// How many numbers a row of the recording has in each column; zero in those that are not recorded.
fn widths(scene: &Scene, options: &Options) -> [usize; COLUMNS.len()] {
    let has = |quantity| options.record.contains(quantity);
    let (state, unilateral) = (has(Recordable::State), options.contact == ContactModel::Unilateral);
    let keeps_jacobian = options.method.entry().keeps_jacobian && matches!(options.steps, Steps::Fixed(_));
    let relaxation = 4 * scene.parameters.branches();
    let works = match (scene.inputs.moves(), unilateral) {
        (true, _) => WORKS,
        (false, true) => CONTACT_WORKS,
        (false, false) => BILATERAL_WORKS,
    };
    COLUMNS.map(|(_, column)| {
        let (recorded, width) = match column {
            Column::T => (true, 1),
            Column::GridAnchor | Column::GridStep => (state, 1),
            Column::Q | Column::P => (state, 9),
            Column::Memory => (state, 2),
            Column::Linearized => (state && keeps_jacobian, 21 + relaxation),
            Column::Relaxation => (state, relaxation),
            Column::Controller => {
                (state, scene.inputs.sampled.as_ref().map_or(0, |own| own.controller.width()))
            }
            Column::Multipliers => (has(Recordable::Multipliers), 4),
            Column::Residuals => (has(Recordable::Residuals), 4),
            Column::Energy => (has(Recordable::Energy), 3 + works),
            Column::Torque => (has(Recordable::Torque), 2),
            Column::Contacts => (state && unilateral, 4),
            Column::Modes => (has(Recordable::Contact), 2),
        };
        if recorded { width } else { 0 }
    })
}

/// Checks a run. Returns the times of equal steps, and the instants to record if these were asked for.
fn prepare(scene: &Scene, options: &Options) -> Result<(Option<Grid>, Option<Vec<f64>>)> {
    require_valid(scene, options)?;
    let Scene { inputs, initial, duration, .. } = scene;
    let span = Span::new(inputs, initial, *duration)?;
    let grid = match options.steps {
        Steps::Fixed(dt) => Some(Grid::new(inputs, initial, *duration, dt, options.refine)?),
        Steps::Free { .. } => None,
    };
    let times = options.times.as_ref().map(|times| instants(times, span)).transpose()?;
    Ok((grid, times))
}

/// Checks the instants to record. One that is outside of the run by round-off becomes the run's start or end.
fn instants(times: &[f64], Span { start, end }: Span) -> Result<Vec<f64>> {
    let near = 4.0 * f64::EPSILON * start.abs().max(end.abs());
    let mut before = f64::NEG_INFINITY;
    let mut instants = reserved("times, in numbers,", times.len())?;
    for (k, &given) in times.iter().enumerate() {
        let time = match given {
            _ if given < start && start - given <= near => start,
            _ if given > end && given - end <= near => end,
            _ => given,
        };
        let require = |holds, rule| require(holds, format_args!("times[{k}]"), given, rule);
        require((start..=end).contains(&time), "must lie between the run's start and its end")?;
        require(time > before, "must be greater than the time before it")?;
        instants.push(time);
        before = time;
    }
    Ok(instants)
}
