//! The example ends where two simulations that share nothing with this crate do.
//!
//! It is compiled in here: a test or an example of its own is another minute of optimising the whole crate.

#[allow(dead_code)] // its main
#[path = "../examples/paper.rs"]
mod example;

use crate::geometry::index::{D_N, THETA, X, Y};
use crate::simulate::Status;

/// x, y in mm, theta in degrees, both d_n in mm at the end of each operation, from programs of their own: RK4 at 2e-4 s.
const ENDS: [[f64; 5]; 8] = [
    [0.000, 74.020, 0.000, 7.936, 7.936],
    [-19.770, 71.893, -9.427, 6.242, 6.340],
    [9.960, 73.896, 5.879, 7.245, 7.194],
    [19.737, 72.182, 10.547, 6.414, 6.316],
    [15.855, 73.089, 8.586, 6.499, 6.427],
    [-15.806, 73.367, -7.766, 6.381, 6.455],
    [25.892, 71.029, 13.657, 6.222, 6.068],
    [-0.001, 75.692, 0.271, 6.624, 6.625],
];

#[test]
fn each_operation_ends_where_it_should() {
    let run = example::run().expect("sound");
    assert_eq!(run.status, Status::Completed, "{}", run.message);
    assert_eq!(run.recording.t.len(), 9);
    for (k, (q, end)) in run.recording.q[1..].iter().zip(ENDS).enumerate() {
        assert_eq!(run.recording.t[k + 1], 1.0 + k as f64);
        let found = [1e3 * q[X], 1e3 * q[Y], q[THETA].to_degrees(), 1e3 * q[D_N], 1e3 * q[D_N + 1]];
        for (number, expected) in found.into_iter().zip(end) {
            assert!((number - expected).abs() <= 0.000_51, "operation {}: {found:?}, not {end:?}", k + 1);
        }
    }
}
