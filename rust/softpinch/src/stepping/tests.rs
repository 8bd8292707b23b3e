//! A step allocates nothing: twice as many of them make no more allocations. Nor does a segment between breakpoints.

use allocation_counter::measure;

use crate::control::{FINGERS, Fingers};
use crate::ensemble::{AdaptiveLanes, EqualLanes, Shared};
use crate::error::Error;
use crate::formulation::FORMULATIONS;
use crate::inputs::{Impulse, Inputs, PiecewisePolynomial, Sinusoid};
use crate::integrator::dop853::InDop853;
use crate::integrator::rk4::InRk4;
use crate::integrator::{METHODS, Method};
use crate::lanes::Row4;
use crate::monitor::Set;
use crate::noise::Noise;
use crate::parameters::Parameters;
use crate::record::{Quantity, Selection};
use crate::simd::{Instructions, LaneKernel, Level};
use crate::simulate::{Options, Scene, Steps, simulate};
use crate::start::{State, contact, driven};

const DURATION: f64 = 0.02;

fn instructions() -> Instructions {
    Level::detect().require().expect("a processor that runs the tests")
}

/// A grasp with a sine, a pulse and an impulse.
fn scene(fingers: Fingers) -> Result<Scene, Error> {
    let parameters = Parameters::default();
    let sine = Sinusoid { start: 0.0, end: 1.0, omega: 300.0, phase: 0.1, amplitude: [1.0, 0.0, 0.0] };
    let impulse = Impulse { time: 0.01, impulse: [0.01, -0.02, 1e-5] };
    let pulse = PiecewisePolynomial::steps("pulse", [0.0; 3], &[0.005, 0.015], &[[1.0, 0.0, 0.0], [0.0; 3]])?;
    let schedule = PiecewisePolynomial::constant([0.1; 2]).into();
    let inputs = Inputs::new(schedule, vec![pulse.into()], vec![sine], vec![impulse], Vec::new())?;
    let inputs = inputs.with_fingers(fingers);
    let initial = match fingers {
        Fingers::Pid => State::at_rest(contact(&parameters)?),
        Fingers::Driven => driven(&parameters, &inputs, 0.0)?,
    };
    Ok(Scene { inputs, initial, check: true, duration: DURATION, parameters })
}

/// How many allocations a run makes, and how many steps.
fn allocations(scene: &Scene, options: &Options) -> (u64, u64) {
    let mut steps = 0;
    let counted = measure(|| {
        let (run, _) = simulate(scene, options, &|| false).expect("a sound scene");
        steps = run.stats.steps;
    });
    (counted.count_total, steps)
}

#[test]
fn a_step_allocates_nothing() {
    let everything =
        [Quantity::State, Quantity::Multipliers, Quantity::Residuals, Quantity::Energy, Quantity::Torque];
    for (_, fingers) in FINGERS {
        let scene = scene(fingers).expect("a sound scene");
        for (name, formulation) in FORMULATIONS {
            for (_, method) in METHODS {
                let record: Selection = everything.into_iter().collect();
                let of = |steps: Steps| {
                    let options = Options { formulation, method, record, steps, ..Options::default() };
                    allocations(&scene, &options)
                };
                let (few, some) = of(Steps::Fixed(1e-4));
                let (many, more) = of(Steps::Fixed(5e-5));
                assert!(2 * some == more && few == many, "{name} {method:?} {fingers:?}: {few} {many}");
                if method.is_adaptive() {
                    let free = |tolerance| of(Steps::Free { tolerance, times: Some(vec![DURATION]) });
                    let ((few, some), (many, more)) = (free(1e-4), free(1e-8));
                    assert!(some < more && few == many, "{name} {method:?} {fingers:?}: {few} {many}");
                }
            }
        }
    }
}

#[test]
fn a_step_in_lanes_allocates_nothing() {
    let of = |dt: f64| {
        let options = Options { steps: Steps::Fixed(dt), method: Method::Rk4, ..Options::default() };
        let scenes = |_| scene(Fingers::Pid);
        let shared = Shared::new(&scenes, 9, &options);
        let mut rows = 0;
        let counted = measure(|| {
            let lanes = EqualLanes::<InRk4>::new(&shared, options.choice(Fingers::Pid), dt);
            rows = lanes.run::<Row4>(instructions()).expect("sound scenes").len();
        });
        assert_eq!(rows, 9);
        counted.count_total
    };
    assert_eq!(of(1e-4), of(5e-5));
}

/// A grasp under noise that cuts the run into so many segments.
fn noisy(segments: f64) -> Result<Scene, Error> {
    let scene = scene(Fingers::Pid)?;
    let noise = Noise {
        std: [0.1; 3],
        rate: segments / DURATION,
        start: 0.0,
        end: f64::INFINITY,
        key: [1, 2],
        stream: 0,
    };
    let schedule = PiecewisePolynomial::constant([0.1; 2]).into();
    let inputs = Inputs::new(schedule, Vec::new(), Vec::new(), Vec::new(), vec![noise])?;
    Ok(Scene { inputs, ..scene })
}

/// A run that held a list of its segments would take more memory where noise makes more of them.
#[test]
fn a_segment_allocates_nothing() {
    let free = Steps::Free { tolerance: 1e-3, times: Some(vec![DURATION]) };
    for (steps, record) in [(Steps::Fixed(DURATION), Selection::default()), (free, Selection::default())] {
        // The number of rows does not depend on the segments, either.
        let options = Options {
            steps,
            method: Method::Dop853,
            record,
            every: 1 << 40,
            stop_on: Set::default(),
            ..Options::default()
        };
        let alone = |segments: f64| {
            let scene = noisy(segments).expect("a sound scene");
            let mut found = 0;
            let counted = measure(|| {
                let (run, _) = simulate(&scene, &options, &|| false).expect("a sound scene");
                found = run.stats.segments;
            });
            assert!((found as f64 - segments).abs() <= 1.0, "{found} {segments}");
            (counted.count_total, counted.bytes_max)
        };
        assert_eq!(alone(8.0), alone(1000.0), "{:?}", options.steps);

        let in_lanes = |segments: f64| {
            let scenes = |_| noisy(segments);
            let shared = Shared::new(&scenes, 9, &options);
            let mut rows = 0;
            let counted = measure(|| {
                let result = match options.steps {
                    Steps::Fixed(dt) => EqualLanes::<InRk4>::new(&shared, options.choice(Fingers::Pid), dt)
                        .run::<Row4>(instructions()),
                    Steps::Free { tolerance, .. } => {
                        AdaptiveLanes::<InDop853>::new(&shared, options.choice(Fingers::Pid), tolerance)
                            .run::<Row4>(instructions())
                    }
                };
                rows = result.expect("sound scenes").len();
            });
            assert_eq!(rows, 9);
            (counted.count_total, counted.bytes_max)
        };
        assert_eq!(in_lanes(8.0), in_lanes(1000.0), "{:?}", options.steps);
    }
}
