//! Pushes against a grasp with unilateral contact.

use crate::driver::simulate::simulate;
use crate::formulation::table::Formulation;
use crate::method::table::Method;
use crate::model::contact_modes::ContactModel;
use crate::model::energy::work;
use crate::model::inputs::{Impulse, Inputs};
use crate::model::parameters::{Friction, Parameters};
use crate::model::piecewise::PiecewisePolynomial;
use crate::model::scene::Scene;
use crate::model::start::{State, contact};
use crate::stepping::contact_events::Cause;
use crate::stepping::ending::Status;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::Run;
use crate::stepping::record::{Column, Recordable};

const TARGETS: [f64; 2] = [0.104_719_755_119_659_77; 2];

/// A grasp that has come to rest with the fingers at 6 degrees.
fn at_rest() -> State {
    let parameters = Parameters::default();
    let scene = Scene {
        initial: State::at_rest(contact(&parameters).unwrap()),
        parameters,
        inputs: Inputs::constant_targets(TARGETS),
        check: true,
        duration: 2.0,
    };
    let options = Options { steps: Steps::Fixed(1e-4), every: 100_000, ..Options::default() };
    let last = simulate(&scene, &options, &|| false).unwrap().0.last;
    State { motion: last.motion, ..State::at_rest(last.motion.q) }
}

/// Options for unilateral contact with all that is recorded.
fn options(steps: Steps) -> Options {
    Options {
        steps,
        every: 1,
        contact: ContactModel::Unilateral,
        record: [Recordable::State, Recordable::Multipliers, Recordable::Residuals, Recordable::Energy]
            .into_iter()
            .collect(),
        ..Options::default()
    }
}

/// A scene that goes on from `rest` with a push on the object for the first 10 ms.
fn pushed(rest: &State, friction: f64, force: [f64; 3], duration: f64) -> Scene {
    let friction = Friction { right: friction, left: friction };
    let mut parameters = Parameters { friction, ..Parameters::default() };
    parameters.grasped.height = 0.049;
    let schedule = PiecewisePolynomial::constant(TARGETS);
    let push = PiecewisePolynomial::steps("push", [0.0; 3], &[0.0, 0.01], &[force, [0.0; 3]]).unwrap();
    let inputs = Inputs::new(schedule.into(), vec![push.into()], vec![], vec![], vec![]).unwrap();
    Scene { parameters, inputs, initial: rest.clone(), check: true, duration }
}

fn run(scene: &Scene, options: &Options) -> Run {
    simulate(scene, options, &|| false).unwrap().0
}

/// The largest pushes that a grasp survives, from an event-driven simulation that shares no code with this one
/// (faces 49 mm high, mu 0.3, 0.5 and 0.8). It gives whole newtons, and tenths of a newton metre.
#[test]
fn pushes_are_survived_up_to_where_another_simulation_has_it() {
    let rest = at_rest();
    let survived = [
        ([0.0, 1.0, 0.0], [64.0, 90.0, 125.0], 1.0),
        ([0.0, -1.0, 0.0], [63.0, 94.0, 143.0], 1.0),
        ([0.0, 0.0, 1.0], [11.4, 16.5, 27.6], 0.1),
    ];
    let options = Options { every: 100_000, ..options(Steps::Fixed(1e-4)) };
    for (direction, largest, digit) in survived {
        for (friction, largest) in [0.3, 0.5, 0.8].into_iter().zip(largest) {
            let holds =
                |size: f64| run(&pushed(&rest, friction, direction.map(|d| d * size), 0.51), &options).holds;
            assert!(holds(largest - 0.5 * digit), "{direction:?} {friction} {largest}");
            assert!(!holds(largest + 1.5 * digit), "{direction:?} {friction} {largest}");
        }
    }
}

fn causes(run: &Run) -> Vec<Cause> {
    run.contact_changes.iter().map(|change| change.cause).collect()
}

fn error(found: &Run, exact: &Run) -> f64 {
    let (found, exact) = (found.last.motion.q.row(), exact.last.motion.q.row());
    (0..9).map(|k| (found[k] - exact[k]).abs()).fold(0.0, f64::max)
}

/// Through a slip, a graze, an opening and an impact the error falls with the power of the step that is the
/// method's order, for each method and formulation.
#[test]
fn each_method_keeps_its_order_across_all_kinds_of_events() {
    let scene = pushed(&at_rest(), 0.5, [150.0, 0.0, 0.0], 0.06);
    let exact = run(&scene, &Options { method: Method::Dop853, ..options(Steps::Fixed(1e-5)) });
    for cause in [Cause::Cone, Cause::Release, Cause::Share, Cause::Impact, Cause::Stop] {
        assert!(causes(&exact).contains(&cause), "{:?}", causes(&exact));
    }
    for (method, formulation, steps) in [
        (Method::Rk4, Formulation::Csm, [1e-4, 5e-5]),
        (Method::Rk4, Formulation::Projected, [1e-4, 5e-5]),
        (Method::Rosenbrock, Formulation::Csm, [1e-4, 5e-5]),
        (Method::ImplicitMidpoint, Formulation::Csm, [2e-5, 1e-5]),
        (Method::Radau5, Formulation::Csm, [2e-4, 1e-4]),
        (Method::Radau5, Formulation::Projected, [2e-4, 1e-4]),
        (Method::Dop853, Formulation::Csm, [1e-3, 5e-4]),
    ] {
        let error = |dt| {
            let found = run(&scene, &Options { method, formulation, ..options(Steps::Fixed(dt)) });
            assert_eq!(found.status, Status::Completed, "{}", found.message);
            assert_eq!(causes(&found), causes(&exact));
            error(&found, &exact)
        };
        let errors = steps.map(error);
        let order = (errors[0] / errors[1]).log2();
        assert!(
            (order - f64::from(method.entry().order)).abs() < 0.7,
            "{method:?} {formulation:?} {errors:?}"
        );
    }
}

/// Adaptive steps, and methods whose own order is lost in round-off, end where the others end.
#[test]
fn all_methods_end_at_the_same_state() {
    let scene = pushed(&at_rest(), 0.5, [150.0, 0.0, 0.0], 0.06);
    let exact = run(&scene, &Options { method: Method::Dop853, ..options(Steps::Fixed(1e-5)) });
    let free = |tolerance| Steps::Free { tolerance };
    for (method, formulation, steps, allowed) in [
        (Method::Dop853, Formulation::Csm, free(1e-10), 1e-10),
        (Method::Dop853, Formulation::Projected, free(1e-10), 1e-10),
        (Method::Radau5, Formulation::Csm, free(1e-9), 1e-9),
        (Method::Rosenbrock, Formulation::Csm, free(1e-9), 1e-8),
        (Method::Radau5, Formulation::Csm, Steps::Fixed(5e-5), 1e-9),
        (Method::Dop853, Formulation::Projected, Steps::Fixed(5e-5), 1e-10),
    ] {
        let found = run(&scene, &Options { method, formulation, ..options(steps) });
        assert_eq!(found.status, Status::Completed, "{}", found.message);
        assert_eq!(causes(&found), causes(&exact), "{method:?} {formulation:?}");
        let error = error(&found, &exact);
        assert!(error < allowed, "{method:?} {formulation:?} {error:e}");
        for (a, b) in found.contact_changes.iter().zip(&exact.contact_changes) {
            assert!((a.time - b.time).abs() < 1e-6, "{method:?} {a:?} {b:?}");
        }
    }
}

/// The ledger closes, with losses to friction and impacts that are not negative.
#[test]
fn the_ledger_closes_over_all_kinds_of_events() {
    let scene = pushed(&at_rest(), 0.5, [150.0, 0.0, 0.0], 0.06);
    for formulation in [Formulation::Csm, Formulation::Projected] {
        let found =
            run(&scene, &Options { method: Method::Dop853, formulation, ..options(Steps::Fixed(2e-5)) });
        let rows: Vec<&[f64]> = found.recording.columns[Column::Energy as usize].chunks(10).collect();
        let first: f64 = rows[0][..3].iter().sum();
        for row in &rows {
            let [control, external, viscous, constraint, friction, impact, relaxation] =
                std::array::from_fn(|k| row[3 + k]);
            let energy: f64 = row[..3].iter().sum();
            let open = (energy - first)
                - (control + external + constraint + relaxation - viscous - friction - impact);
            assert!(open.abs() < 1e-11, "{formulation:?} {open:e}");
        }
        let last = rows[rows.len() - 1];
        assert!(last[3 + work::FRICTION] > 1e-4 && last[3 + work::IMPACT] > 1e-6, "{last:?}");
        assert!(rows.windows(2).all(|pair| pair[0][7] <= pair[1][7] && pair[0][8] <= pair[1][8]));
    }
}

/// Where friction is enough and nothing pulls, the run is the bilateral one to the bit.
#[test]
fn a_grasp_that_neither_slips_nor_opens_is_the_bilateral_one() {
    let scene = pushed(&at_rest(), 1.0, [3.0, 2.0, 0.1], 0.05);
    for formulation in [Formulation::Csm, Formulation::Projected] {
        let options = Options { formulation, ..options(Steps::Fixed(1e-4)) };
        let found = run(&scene, &options);
        let bilateral = run(&scene, &Options { contact: ContactModel::Bilateral, ..options });
        assert!(found.contact_changes.is_empty() && found.holds);
        assert_eq!(
            (found.last.motion.q, found.last.motion.p),
            (bilateral.last.motion.q, bilateral.last.motion.p)
        );
        let multipliers = |run: &Run| run.recording.columns[Column::Multipliers as usize].clone();
        assert_eq!(multipliers(&found), multipliers(&bilateral));
    }
}

/// A run that goes on from any recorded state gives the same bits as the run that recorded it.
#[test]
fn a_resumed_run_gives_the_same_bits() {
    let mut scene = pushed(&at_rest(), 0.5, [150.0, 0.0, 0.0], 0.04);
    scene.inputs = Inputs::new(
        PiecewisePolynomial::constant(TARGETS).into(),
        vec![
            PiecewisePolynomial::steps("push", [0.0; 3], &[0.0, 0.01], &[[150.0, 0.0, 0.0], [0.0; 3]])
                .unwrap()
                .into(),
        ],
        vec![],
        vec![Impulse { time: 0.02, impulse: [0.0, 0.3, 0.01] }],
        vec![],
    )
    .unwrap();
    for method in [Method::Rk4, Method::ImplicitMidpoint] {
        let options = Options { method, ..options(Steps::Fixed(1e-4)) };
        let whole = run(&scene, &options);
        let rows = &whole.recording;
        assert!(rows.rows::<4>(Column::Contacts).iter().any(|row| row[0] == 0.0 || row[1] == 0.0));
        for k in (0..rows.t().len() - 1).step_by(23) {
            // The stabilisation leaves residuals, which a start that is checked may not have.
            let initial = rows.state_at(k);
            let rest = Scene { initial, check: false, duration: 0.04 - rows.t()[k], ..scene.clone() };
            let found = run(&rest, &options);
            assert_eq!(
                (found.last.motion.q, found.last.motion.p),
                (whole.last.motion.q, whole.last.motion.p),
                "{method:?} {k} {}",
                rows.t()[k]
            );
            assert_eq!(found.last.contact, whole.last.contact);
        }
    }
}
