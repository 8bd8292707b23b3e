//! A step allocates nothing: twice as many steps make no more allocations. Neither does a segment between
//! breakpoints.

use allocation_counter::measure;

use crate::driver::ensemble::Shared;
use crate::driver::simulate::simulate;
use crate::driver::simulator::Simulator;
use crate::driver::tests::portable;
use crate::error::Error;
use crate::formulation::equations::Evaluation;
use crate::formulation::table::FORMULATIONS;
use crate::method::table::{METHODS, Method};
use crate::model::contact_modes::ContactModel;
use crate::model::control::{FINGERS, Fingers};
use crate::model::inputs::{Impulse, Inputs, Sinusoid};
use crate::model::motion::Motion;
use crate::model::noise::Noise;
use crate::model::parameters::{Friction, Parameters};
use crate::model::piecewise::PiecewisePolynomial;
use crate::model::sampled::tests::spring;
use crate::model::scene::Scene;
use crate::model::start::{State, contact, driven};
use crate::number::lanes::Lanes;
use crate::number::real::Real;
use crate::number::row::Row4;
use crate::stepping::instant::all_finite;
use crate::stepping::monitor::ViolationSet;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::{Column, RECORDABLE, Recording, Selection};

const DURATION: f64 = 0.02;

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
        Fingers::Pid | Fingers::Torque => State::at_rest(contact(&parameters)?),
        Fingers::Driven => driven(&parameters, &inputs, 0.0, ContactModel::Bilateral)?,
    };
    Ok(Scene { inputs, initial, check: true, duration: DURATION, parameters })
}

/// The number of allocations of a run, and the number of its steps.
fn allocations(scene: &Scene, options: &Options) -> (u64, u64) {
    let mut steps = 0;
    let counted = measure(|| {
        let (run, _) = simulate(scene, options, &|| false).expect("the scene is valid");
        steps = run.stats.steps;
    });
    (counted.count_total, steps)
}

#[test]
fn a_step_allocates_nothing() {
    for (_, fingers) in FINGERS {
        let scene = scene(fingers).expect("the scene is valid");
        for (name, formulation) in FORMULATIONS {
            for (_, method) in METHODS {
                let record: Selection = RECORDABLE[..5].iter().map(|&(_, quantity)| quantity).collect();
                let of = |steps: Steps| {
                    let times = matches!(steps, Steps::Free { .. }).then(|| vec![DURATION]);
                    let options = Options { formulation, method, record, steps, times, ..Options::default() };
                    allocations(&scene, &options)
                };
                let (few, some) = of(Steps::Fixed(1e-4));
                let (many, more) = of(Steps::Fixed(5e-5));
                assert!(2 * some == more && few == many, "{name} {method:?} {fingers:?}: {few} {many}");
                if method.entry().adaptive.is_some() {
                    let free = |tolerance| of(Steps::Free { tolerance });
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
            rows = portable(&shared).expect("the scenes are valid").len();
        });
        assert_eq!(rows, 9);
        counted.count_total
    };
    assert_eq!(of(1e-4), of(5e-5));
}

/// A period of a simulator, alone and in lanes, in both kinds of contact.
#[test]
fn a_period_from_outside_allocates_its_method_at_most() {
    for contact in [ContactModel::Bilateral, ContactModel::Unilateral] {
        for method in [Method::Rk4, Method::Rosenbrock, Method::Radau5] {
            for runs in [1, 11_u64] {
                let steps = Steps::Fixed(1e-4);
                let options = Options { steps, method, contact, ..Options::default() };
                let scene = |_| {
                    let mut scene = noisy(20.0)?;
                    scene.parameters.friction = Friction { right: 5.0, left: 5.0 };
                    Ok::<_, Error>(scene)
                };
                let scenes = (0..runs).map(scene).collect::<Result<Vec<_>, _>>().expect("valid");
                let mut simulator = Simulator::new(scenes, &options, 1e-3, 1).expect("the scenes are valid");
                let targets = vec![[0.1, 0.08]; runs as usize];
                let mut step = || simulator.step(&targets, &[], &|| false);
                for _ in 0..3 {
                    assert_eq!(step(), Ok(true));
                }
                let counted = measure(|| assert_eq!(step(), Ok(true)));
                // The box of the method, one for a loop, and that of the equations of its Jacobian, one for all lanes, or for each
                // run. Rosenbrock has its linearisation in a box, because that of lanes is large. RK4 is inlined into its
                // loops, except with unilateral contact in the loop of a single run.
                let boxes = match method {
                    Method::Rk4 => u64::from(runs == 1 && contact == ContactModel::Unilateral),
                    Method::Rosenbrock => 3,
                    _ => 1 + runs,
                };
                assert_eq!(counted.count_total, boxes, "{contact:?} {method:?} {runs}");
            }
        }
    }
}

/// A grasp under noise that divides the run into this many segments.
fn noisy(segments: f64) -> Result<Scene, Error> {
    let scene = scene(Fingers::Pid)?;
    let noise = Noise {
        acceleration: [0.0; 2],
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

/// A run that kept a list of its segments would take more memory if noise makes more segments.
#[test]
fn a_segment_allocates_nothing() {
    let free = Steps::Free { tolerance: 1e-3 };
    for (steps, record) in [(Steps::Fixed(DURATION), Selection::default()), (free, Selection::default())] {
        // The number of rows does not depend on the number of segments.
        let options = Options {
            steps,
            method: Method::Dop853,
            record,
            every: 1 << 40,
            times: Some(vec![DURATION]),
            stop_on: ViolationSet::default(),
            ..Options::default()
        };
        let alone = |segments: f64| {
            let scene = noisy(segments).expect("the scene is valid");
            let mut found = 0;
            let counted = measure(|| {
                let (run, _) = simulate(&scene, &options, &|| false).expect("the scene is valid");
                found = run.stats.segments;
            });
            assert!((found as f64 - segments).abs() <= 1.0, "{found} {segments}");
            (counted.count_total, counted.bytes_max)
        };
        assert_eq!(alone(8.0), alone(1000.0), "{:?}", options.steps);
        let sampled = |segments: f64| {
            let controller = spring(DURATION / segments, 0.7 * DURATION / segments);
            let scene = scene(Fingers::Pid).expect("the scene is valid");
            let inputs = Inputs::constant_targets([0.1; 2]).with_controller(controller.into(), 0.0);
            let scene = Scene { inputs, ..scene };
            measure(|| assert!(simulate(&scene, &options, &|| false).is_ok())).count_total
        };
        assert_eq!(sampled(8.0), sampled(1000.0), "{:?}", options.steps);

        let in_lanes = |segments: f64| {
            let scenes = |_| noisy(segments);
            let shared = Shared::new(&scenes, 9, &options);
            let mut rows = 0;
            let counted = measure(|| {
                rows = portable(&shared).expect("the scenes are valid").len();
            });
            assert_eq!(rows, 9);
            (counted.count_total, counted.bytes_max)
        };
        assert_eq!(in_lanes(8.0), in_lanes(1000.0), "{:?}", options.steps);
    }
}

/// A change to one number of an evaluation.
type Change<'a> = &'a dyn Fn(&mut Evaluation<Row4>);

/// Finite numbers whose product overflows count as finite. A number that is not finite is found, whatever it
/// is multiplied with.
#[test]
fn every_number_of_an_instant_that_is_not_finite_is_found() {
    let at = |change: Change<'_>| {
        let mut now = Evaluation::<Row4>::nothing();
        change(&mut now);
        all_finite(&now, Row4::constant(0.0))
    };
    assert_eq!(at(&|now| now.multipliers[2] = Row4::constant(3.0)), 0b1111);
    let huge = Row4::constant(1e200);
    assert_eq!(at(&|now| (now.motion.q.finger[0], now.motion.p.finger[0]) = (huge, huge)), 0b1111);
    assert_eq!(at(&|now| (now.torque[0], now.torque[1]) = (huge, -huge)), 0b1111);
    for bad in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
        let number = Row4::from_fn(|lane| if lane == 2 { bad } else { 1.0 });
        let changes: [Change<'_>; 7] = [
            &|now| now.motion.q.shear[1] = number,
            &|now| now.motion.p.object[0] = number,
            &|now| now.motion.memory[1] = number,
            &|now| now.multipliers[3] = number,
            &|now| now.residuals[1] = number,
            &|now| now.torque[0] = number,
            &|now| now.torque[1] = number,
        ];
        for (k, change) in changes.into_iter().enumerate() {
            assert_eq!(at(change), 0b1011, "{bad} {k}");
        }
        assert_eq!(all_finite(&Evaluation::<Row4>::nothing(), number), 0b1011, "{bad}");
    }
}

impl Recording {
    /// The state at a row, from which a run without a discrete controller goes on.
    pub(crate) fn state_at(&self, k: usize) -> State {
        State {
            time: self.t()[k],
            motion: Motion {
                q: self.rows(Column::Q)[k].into(),
                p: self.rows(Column::P)[k].into(),
                memory: self.rows(Column::Memory)[k],
                ..Motion::zero()
            },
            grid: Some((
                self.rows::<1>(Column::GridAnchor)[k][0],
                self.rows::<1>(Column::GridStep)[k][0] as u64,
            )),
            linearized: self
                .rows::<21>(Column::Linearized)
                .get(k)
                .filter(|point| !point[0].is_nan())
                .map(|point| std::array::from_fn(|n| point.get(n).copied().unwrap_or_default())),
            contact: self.rows(Column::Contacts).get(k).copied(),
            controller: None,
        }
    }
}
