//! When samples are taken and act, and the controller with which other tests check this.

use super::*;
use crate::model::measures::Measure;

/// A damped spring towards the targets.
pub(crate) fn spring(period: f64, delay: f64) -> SampledController {
    SampledController {
        period,
        delay,
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
        key: [0; 2],
    }
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
