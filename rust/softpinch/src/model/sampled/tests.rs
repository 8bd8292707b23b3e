//! When samples are taken and act, and the controller with which other tests check this.

use super::*;
use crate::model::Inputs;
use crate::model::measures::Measure;

/// A damped spring towards the targets.
pub(crate) fn spring(period: f64, delay: f64) -> SampledController {
    let block = SampledController {
        period,
        first_sample: 0.0,
        measure_delay: 0.0,
        delay,
        loss: 0.0,
        jitter: 0.0,
        normal_jitter: false,
        rate_limit: f64::INFINITY,
        no_load_rate: f64::INFINITY,
        a: Vec::new(),
        b: Vec::new(),
        c: Vec::new(),
        d: vec![-4.0, 0.0, -0.05, 0.0, 0.0, -4.0, 0.0, -0.05],
        measures: vec![Measure::AngleError, Measure::AngleRate],
        limits: [[f64::NEG_INFINITY, f64::INFINITY]; 2],
        anti_windup: false,
        initial_torque: [0.4; 2],
        initial_state: Vec::new(),
        noise: vec![0.0; 4],
        resolution: vec![0.0; 4],
        dead_zone: vec![0.0; 4],
        switch: None,
        key: [0; 2],
        outer: None,
        place: Place::default(),
    };
    placed(block)
}

/// A block alone.
fn placed(block: SampledController) -> SampledController {
    let whole = SampledController::cascade(vec![Arc::new(block)], 0);
    whole.map(Arc::unwrap_or_clone).unwrap()
}

#[test]
fn breaks_are_the_samples_and_the_instants_from_which_they_act() {
    for (origin, period, delay) in
        [(0.0, 1e-3, 0.0), (0.1, 1e-3, 1.4e-3), (0.0, 1e-3, 3e-3), (-3.7, 0.3, 0.6), (1e6, 0.1, 0.05)]
    {
        let controller = spring(period, delay);
        let mut expected: Vec<f64> =
            (0..200).flat_map(|k| [controller.sampled(origin, k), controller.applied(origin, k)]).collect();
        expected.sort_by(f64::total_cmp);
        expected.dedup();
        let shortest = expected.windows(2).map(|pair| pair[1] - pair[0]).fold(period, f64::min);
        assert!(shortest > 0.1 * period, "{origin} {period} {delay}: {shortest}");
        let mut t = origin.next_down();
        for &instant in &expected[..150] {
            assert_eq!(controller.next_break(origin, t), instant, "{origin} {period} {delay}");
            assert_eq!(controller.next_break(origin, instant.next_down()), instant);
            t = instant;
        }
    }
}

/// Of all blocks, whose samples are late by chance, are lost or wait for their use.
#[test]
fn breaks_of_a_cascade_are_those_of_its_blocks_in_order() {
    let camera = SampledController { measure_delay: 0.03, first_sample: 0.002, ..spring(1.0 / 30.0, 0.0073) };
    for (late, normal_jitter) in [(0.0, false), (0.03, false), (0.03, true)] {
        let camera = SampledController { jitter: late, normal_jitter, ..camera.clone() };
        let blocks = vec![Arc::new(camera), Arc::new(spring(1e-3, 1.4e-3))];
        let whole = SampledController::cascade(blocks, 3).unwrap();
        assert_eq!(whole.blocks().map(|block| block.key[1]).collect::<Vec<_>>(), [3, 3]);
        let mut expected = Vec::new();
        for block in whole.blocks() {
            let instants = |of: &dyn Fn(u64) -> f64| (0..900).map(of).collect::<Vec<_>>();
            for own in [
                instants(&|k| block.sampled(0.5, k)),
                instants(&|k| block.used(0.5, k)),
                instants(&|k| block.applied(0.5, k)),
            ] {
                assert!(own.windows(2).all(|pair| pair[0] < pair[1]), "late samples never overtake");
                expected.extend(own);
            }
        }
        expected.sort_by(f64::total_cmp);
        expected.dedup();
        let inputs = Inputs::constant_targets([0.0; 2]).with_controller(whole, 0.5);
        let (mut t, mut ahead) = (0.0, Vec::new());
        for &instant in expected.iter().take(900) {
            assert_eq!(inputs.next_after(t, &mut ahead), instant, "{late} {normal_jitter}");
            t = instant;
        }
    }
}

/// A camera at 30 Hz and a servo at 1 kHz meet each 0.1 s, in floating-point numbers too.
#[test]
fn instants_of_blocks_that_differ_by_round_off_are_one() {
    let camera = SampledController { measure_delay: 0.03, ..spring(1.0 / 30.0, 1.0 / 30.0) };
    let whole = SampledController::cascade(vec![Arc::new(camera), Arc::new(spring(1e-3, 0.0))], 0).unwrap();
    let inputs = Inputs::constant_targets([0.0; 2]).with_controller(whole.clone(), 0.0);
    let next = |t: &f64| Some(inputs.next_breakpoint(*t));
    let breaks: Vec<f64> = std::iter::successors(Some(0.0), next).take(9000).collect();
    assert!(breaks.windows(2).all(|pair| pair[1] - pair[0] > 1e-5));
    let camera = whole.outer.as_ref().unwrap();
    assert!((1..90).all(|k| camera.sampled(0.0, 3 * k) == whole.sampled(0.0, 100 * k)));
}
