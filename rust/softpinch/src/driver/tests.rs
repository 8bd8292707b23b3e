//! Runs of an ensemble have the bits that they have alone, and resumed runs those of the whole run.

use proptest::prelude::*;

use crate::driver::ensemble::{Row, Shared, ensemble, in_lanes, work};
use crate::driver::simulate::simulate;
use crate::error::Error;
use crate::formulation::table::{FORMULATIONS, Formulation};
use crate::method::table::{METHODS, Method};
use crate::model::contact_modes::ContactModel;
use crate::model::control::{FINGERS, Fingers};
use crate::model::inputs::{Impulse, Inputs, Sinusoid};
use crate::model::parameters::{Friction, Parameters};
use crate::model::piecewise::PiecewisePolynomial;
use crate::model::sampled::tests::spring;
use crate::model::scene::Scene;
use crate::model::start::{State, contact, driven};
use crate::number::row::Row4;
use crate::number::simd::dispatch::LaneKernel;
use crate::number::simd::level::LEVELS;
use crate::number::trigonometry::LIBM_LANES;
use crate::stepping::ending::Status;
use crate::stepping::monitor::Violation;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::{Column, Recordable};
use crate::stepping::summary::{SUMMARIES, Wanted};

/// The default parameters, with a mass, an impulse and an end that depend on the run, so that lanes are at
/// different places.
fn scene(run: usize) -> Result<Scene, Error> {
    let k = run as f64;
    let (finger, pid) = ([0.0762, 0.049, 0.0045, 0.1, 5.8e-4], [100.0, 1.0, 1000.0]);
    let tip = [0.02, 3e5, 100.0, 100.0, 1.0, 0.1, 0.1];
    let endless = f64::INFINITY;
    let (object, surroundings) = ([0.049, 0.08 + 0.01 * k, 4e-5, 0.0, endless], [9.81, endless, endless]);
    let values = [&finger[..], &finger, &tip, &tip, &object, &pid, &pid, &surroundings].concat();
    let mut all = Parameters::default().to_array();
    all[..values.len()].copy_from_slice(&values);
    let parameters = Parameters::from_array(&all)?;
    let sine =
        Sinusoid { start: 0.002, end: 0.006, omega: 300.0 + k, phase: 0.1, amplitude: [1.0, 2.0, 0.0] };
    let impulse = Impulse { time: 0.003 + 1e-4 * k, impulse: [0.01, -0.02, 1e-5] };
    let schedule = PiecewisePolynomial::constant([0.1, 0.08]).into();
    Ok(Scene {
        inputs: Inputs::new(schedule, Vec::new(), vec![sine], vec![impulse], Vec::new())?,
        initial: State::at_rest(contact(&parameters)?),
        check: true,
        duration: 0.004 + 5e-4 * k,
        parameters,
    })
}

/// A scene whose fingers move in the given way.
fn scene_with(fingers: Fingers, run: usize) -> Result<Scene, Error> {
    let mut scene = scene(run)?;
    if fingers == Fingers::Torque {
        scene.inputs = Inputs::constant_targets([1.2, 1.1]).with_fingers(fingers);
    }
    if fingers == Fingers::Driven {
        let schedule = PiecewisePolynomial::constant([0.1, 0.08]).into();
        scene.inputs = Inputs::new(schedule, Vec::new(), Vec::new(), Vec::new(), Vec::new())?;
        scene.inputs = scene.inputs.with_fingers(fingers);
        scene.initial = driven(&scene.parameters, &scene.inputs, 0.0, ContactModel::Bilateral)?;
    }
    Ok(scene)
}

/// If a lane without a run computed with numbers that overflow, the sines of all lanes would take the slow
/// path.
#[test]
fn lanes_without_a_run_never_need_the_slow_sine() {
    let fixed = |method| (method, Steps::Fixed(2e-4));
    let free = |method| (method, Steps::Free { tolerance: 1e-4 });
    for (method, steps) in [
        fixed(Method::Rk4),
        fixed(Method::Dop853),
        fixed(Method::Rosenbrock),
        free(Method::Dop853),
        free(Method::Rosenbrock),
    ] {
        for ((_, fingers), (name, formulation)) in
            FINGERS.into_iter().flat_map(|fingers| FORMULATIONS.map(|formulation| (fingers, formulation)))
        {
            // There are fewer runs than lanes, or more runs, of which the last ones leave lanes empty.
            for runs in [1, 11] {
                let options = Options { steps, method, formulation, ..Options::default() };
                let scenes = |run| scene_with(fingers, run);
                let shared = Shared::new(&scenes, runs, &options);
                LIBM_LANES.set(0);
                let rows = work(&shared).expect("the scenes are valid");
                assert!(rows.len() == runs && rows.iter().all(|row| row.status == Status::Completed));
                let by_libm = LIBM_LANES.get();
                assert_eq!(by_libm, 0, "{method:?}, {steps:?}, {name}, {fingers:?}, {runs} runs");
            }
        }
    }
}

/// The rows of runs in four portable lanes.
pub(crate) fn portable(shared: &Shared<'_>) -> Result<Vec<Row>, Error> {
    in_lanes(shared, |runs| runs.run::<Row4>())
}

/// The rows of runs that are computed one by one.
fn alone(runs: usize, scenes: impl Fn(usize) -> Result<Scene, Error>, options: &Options) -> Vec<Row> {
    let one = |number| simulate(&scenes(number).expect("valid"), options, &|| false).expect("valid").0;
    (0..runs).map(|number| Row::of(number, one(number))).collect()
}

/// Compares the rows of runs in lanes, which runs leave and enter, or in one loop, with those of the same runs [`alone`]:
/// every number, as text with all of its digits.
fn require_rows(
    alone: &[Row],
    scenes: impl Fn(usize) -> Result<Scene, Error> + Sync,
    options: &Options,
    rows: impl Fn(&Shared<'_>) -> Result<Vec<Row>, Error>,
) {
    let shared = Shared::new(&scenes, alone.len(), options);
    let mut rows = rows(&shared).expect("the scenes are valid");
    rows.sort_unstable_by_key(|row| row.run);
    assert_eq!(rows.len(), alone.len());
    for (row, alone) in rows.iter().zip(alone) {
        assert_eq!(format!("{row:?}"), format!("{alone:?}"), "{options:?}");
    }
}

/// The same for this many runs. Returns the rows.
fn require_alone(
    runs: usize,
    scenes: impl Fn(usize) -> Result<Scene, Error> + Sync,
    options: &Options,
    rows: impl Fn(&Shared<'_>) -> Result<Vec<Row>, Error>,
) -> Vec<Row> {
    let alone = alone(runs, &scenes, options);
    require_rows(&alone, scenes, options, rows);
    alone
}

/// The scene of a run whose tips slip, open and meet the object again, at times that differ between runs.
fn slipping(run: usize) -> Result<Scene, Error> {
    let k = run as f64;
    let mut scene = scene(run)?;
    scene.parameters.friction = Friction { right: 0.3 + 0.02 * k, left: 0.4 };
    let impulse =
        |time: f64, size: f64| Impulse { time, impulse: [size * (0.2 + 0.02 * k), 0.3 * size, 2e-4 * size] };
    let impulses = vec![impulse(0.008 + 1.3e-4 * k, 1.0), impulse(0.0101, -1.2)];
    let schedule = PiecewisePolynomial::constant([0.1, 0.08]).into();
    scene.inputs = Inputs::new(schedule, Vec::new(), Vec::new(), impulses, Vec::new())?;
    scene.duration = 0.02 + 1e-3 * k;
    Ok(scene)
}

/// Lanes whose contacts have events leave the vector code, at the events and at breakpoints.
#[test]
fn portable_lanes_give_the_bits_of_lone_runs_with_events() {
    let (dt, tolerance) = (2e-4, 1e-7);
    let summaries = SUMMARIES.map(|(_, summary)| summary);
    for formulation in [Formulation::Csm, Formulation::Projected] {
        let base = Options {
            formulation,
            contact: ContactModel::Unilateral,
            summaries: Wanted { set: summaries.into_iter().collect(), after: 0.003, band: 1e-3 },
            ..Options::default()
        };
        let options = Options { steps: Steps::Fixed(dt), ..base.clone() };
        require_events(&require_alone(11, slipping, &options, portable));
        let steps = Steps::Free { tolerance };
        let options = Options { steps, method: Method::Dop853, ..base };
        require_events(&require_alone(11, slipping, &options, portable));
    }
}

/// Most runs must have slipped and opened, and all must have reached their ends.
fn require_events(rows: &[Row]) {
    let shown = |violation| rows.iter().filter(|row| !row.violations[violation as usize].is_nan()).count();
    assert!(shown(Violation::Slipping) > 5 && shown(Violation::Opened) > 5, "{rows:?}");
    assert!(rows.iter().all(|row| row.status == Status::Completed));
}

/// The vectors of the processor have code of their own for every operation, and the steps of each method are compiled for each
/// kind of vectors. So every method whose steps have lanes is compared in all of them, in both kinds of contact.
#[test]
fn lanes_of_every_level_give_the_bits_of_lone_runs() {
    // More accurate runs would take longer, but their loops would do nothing else.
    for (method, steps) in [
        (Method::Rk4, Steps::Fixed(2e-4)),
        (Method::Dop853, Steps::Fixed(1e-3)),
        (Method::Dop853, Steps::Free { tolerance: 1e-4 }),
        (Method::Rosenbrock, Steps::Fixed(1e-3)),
        (Method::Rosenbrock, Steps::Free { tolerance: 1e-2 }),
    ] {
        for (contact, formulation) in
            [(ContactModel::Bilateral, Formulation::Csm), (ContactModel::Unilateral, Formulation::Projected)]
        {
            let unilateral = contact == ContactModel::Unilateral;
            // Most events are early.
            let brief = |scene: Scene| Scene { duration: 0.6 * scene.duration, ..scene };
            let scenes = |run: usize| if unilateral { slipping(run).map(brief) } else { scene(run) };
            let options = Options { method, steps, formulation, contact, ..Options::default() };
            let alone = alone(9, scenes, &options);
            if unilateral {
                require_events(&alone);
            }
            for (_, simd) in LEVELS.into_iter().filter(|(_, level)| level.is_available()) {
                require_rows(&alone, scenes, &Options { simd, ..options.clone() }, work);
            }
        }
    }
}

#[test]
fn portable_lanes_give_the_bits_of_lone_runs() {
    let dt = 2e-4;
    let options = Options { steps: Steps::Fixed(dt), ..Options::default() };
    require_alone(11, scene, &options, portable);
    let tolerance = 1e-6;
    let options = Options {
        steps: Steps::Free { tolerance },
        method: Method::Dop853,
        formulation: Formulation::Nullspace,
        ..Options::default()
    };
    require_alone(11, scene, &options, portable);
}

/// The scene of a run whose controller samples at instants of its own, with a delay of several periods.
fn sampled(run: usize) -> Result<Scene, Error> {
    let mut scene = scene(run)?;
    let k = run as f64;
    let controller = spring(4e-4 + 5e-5 * k, 3e-4 * k);
    scene.inputs = scene.inputs.with_controller(controller.into(), 0.0);
    Ok(scene)
}

/// Methods whose steps have no lanes take one run after the other in one loop.
#[test]
fn runs_one_after_the_other_have_the_bits_of_lone_runs() {
    let (fixed, free) = (Steps::Fixed(2e-4), Steps::Free { tolerance: 1e-6 });
    for (method, steps) in
        [(Method::ImplicitMidpoint, fixed), (Method::Radau5, fixed), (Method::Radau5, free)]
    {
        for (_, formulation) in FORMULATIONS {
            let options = Options { method, steps, formulation, ..Options::default() };
            require_alone(3, scene, &options, work);
            require_alone(3, sampled, &options, work);
        }
        let contact = ContactModel::Unilateral;
        require_alone(3, slipping, &Options { method, steps, contact, ..Options::default() }, work);
    }
}

#[test]
fn portable_lanes_give_the_bits_of_lone_runs_with_controllers() {
    let options = Options { steps: Steps::Fixed(2e-4), ..Options::default() };
    require_alone(11, sampled, &options, portable);
    let steps = Steps::Free { tolerance: 1e-6 };
    let options = Options { steps, method: Method::Dop853, ..Options::default() };
    require_alone(11, sampled, &options, portable);
}

/// Only the stabilisation leads back to the constraints. With the other formulations a start off the
/// constraints is refused, in a single run and in a run of an ensemble, in any lane.
#[test]
fn an_ensemble_refuses_a_start_that_a_lone_run_refuses() {
    let off = |run: usize| {
        let mut scene = scene(run)?;
        scene.check = false;
        scene.initial.motion.q.object[0] += if run == 6 { 1e-3 } else { 0.0 };
        Ok(scene)
    };
    let fixed = || Steps::Fixed(2e-4);
    let free = || Steps::Free { tolerance: 1e-4 };
    let radau = Method::Radau5;
    for (method, steps) in
        [(Method::Rk4, fixed()), (radau, fixed()), (Method::Dop853, free()), (radau, free())]
    {
        let of = |formulation| Options { method, formulation, steps, ..Options::default() };
        let many = |options: &Options| ensemble(&off, 11, options, 1, &mut |_| false);
        for formulation in [Formulation::Nullspace, Formulation::Projected] {
            let options = of(formulation);
            let alone = simulate(&off(6).expect("valid"), &options, &|| false).expect_err("off constraints");
            let expected = Error::Run { run: 6, error: Box::new(alone) };
            assert_eq!(many(&options), Err(expected), "{method:?} {steps:?}");
        }
        assert_eq!(many(&of(Formulation::Csm)).map(|rows| rows.len()), Ok(11), "{method:?} {steps:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever the method, the formulation and the contacts do: across events, impulses and breakpoints too.
    #[test]
    fn a_run_resumed_at_any_row_gives_the_bits_of_the_whole_run(
        number in 0..11usize,
        method in proptest::sample::select(&METHODS[..]),
        formulation in proptest::sample::select(&FORMULATIONS[..]),
        unilateral in any::<bool>(),
        place in 0.0..1.0f64,
    ) {
        let unilateral = unilateral && formulation.1 != Formulation::Nullspace;
        let contact = if unilateral { ContactModel::Unilateral } else { ContactModel::Bilateral };
        let options = Options {
            method: method.1,
            formulation: formulation.1,
            contact,
            steps: Steps::Fixed(2e-4),
            record: [Recordable::State, Recordable::Multipliers].into_iter().collect(),
            ..Options::default()
        };
        let scene = if unilateral { slipping(number) } else { scene(number) }.expect("valid");
        let run = |scene: &Scene| simulate(scene, &options, &|| false).expect("valid").0;
        let whole = run(&scene);
        let rows = &whole.recording;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small number
        let k = (place * (rows.t().len() - 1) as f64) as usize;
        let duration = scene.duration - rows.t()[k];
        prop_assume!(rows.t()[k] + duration == scene.duration);
        // The stabilisation leaves residuals, which a start that is checked may not have.
        let rest = Scene { initial: rows.state_at(k), check: false, duration, ..scene };
        let resumed = run(&rest);
        prop_assert_eq!(&resumed.status, &whole.status);
        for column in [Column::Q, Column::P] {
            prop_assert_eq!(resumed.recording.rows::<9>(column), &rows.rows::<9>(column)[k..]);
        }
        let multipliers = Column::Multipliers;
        prop_assert_eq!(&resumed.recording.rows::<4>(multipliers)[1..], &rows.rows::<4>(multipliers)[k + 1..]);
    }
}
