//! The constraint stabilisation method as in the paper: (24) solved by LU, and stepped by RK4 or by the implicit
//! midpoint rule. M and Phi come from the crate; all else is the paper's, with its errata corrected. A test compares
//! `simulate` with it. `cargo run --release --example csm_by_nalgebra` prints their difference, and the time of a step
//! of both: why the kernels have small solves of their own.

use std::time::Instant;

use nalgebra::{Rotation2, SMatrix, SVector, Vector2};
use softpinch::driver::simulate;
use softpinch::method::Method;
use softpinch::model::start::{State, contact};
use softpinch::model::{Geometry, Inputs, Motion, Parameters, Scene, Stabilization};
use softpinch::stepping::{Column, Options, Recordable, Recording, Steps};

/// The rates of q, p and the integrals of (39), and lambda = (lambda^H, lambda^N), under the inputs at the
/// start.
fn rates(scene: &Scene, gains: &Stabilization, y: &SVector<f64, 20>) -> (SVector<f64, 20>, SVector<f64, 4>) {
    let (physics, input) = (&scene.parameters, scene.inputs.segment(scene.initial.time).at(0.0));
    let (object, gravity) = (&physics.grasped, physics.surroundings.gravity);
    let (q, p) = (y.fixed_rows::<9>(0).into_owned(), y.fixed_rows::<9>(9).into_owned());
    let (frame, omega) = (Rotation2::new(-q[2]), p[2]); // into the object's own frame, which rotates
    let phi = Geometry::of_scene(physics, &q.data.0[0].into(), &p.data.0[0].into()).constraint_matrix(); // (25)
    let velocity = phi * p; // the rates of C^H, then C^N (12, 21)
    let quarter = |v: Vector2<f64>| Vector2::new(v.y, -v.x); // rate of a vector turning clockwise
    let (mut errors, mut right) = ([0.0; 2], SVector::<f64, 13>::zeros()); // (24): forces along q, gamma
    right.fixed_rows_mut::<3>(0).copy_from_slice(&input.force);
    right[1] -= object.mass * gravity; // (32)
    for (i, sign) in [(0, -1.0), (1, 1.0)] {
        let (finger, tip, pid) = (&physics.fingers[i], &physics.tips[i], &physics.control[i]);
        let (angle, d_n, d_t) = (q[3 + i], q[5 + i], q[7 + i]);
        let (turn, d_n_rate, d_t_rate) = (p[3 + i], p[5 + i], p[7 + i]);
        // The forces: the gradients of (5) and (16), the PID torque, viscosity.
        let (tilt, kappa) = (angle + sign * q[2], tip.tilt_coupling); // (6)
        let (tan, cos2, pi_e) = (tilt.tan(), tilt.cos().powi(2), std::f64::consts::PI * tip.youngs_modulus);
        let moment = pi_e * d_n.powi(2) * (2.0 / 3.0 * d_n * tan + kappa * d_t) / cos2;
        let normal = pi_e * (d_n.powi(2) / cos2 + 2.0 * kappa * d_n * d_t * tan + d_t.powi(2));
        let tangential = pi_e * (kappa * d_n.powi(2) * tan + 2.0 * d_n * d_t);
        errors[i] = angle - input.target[i];
        let torque = -pid.kp * errors[i] - pid.kd * turn - pid.ki * y[18 + i]; // (39)
        right[2] -= sign * moment; // (33)
        right[3 + i] = torque + finger.mass * gravity * finger.length * angle.sin() - moment; // (43)
        right[5 + i] = -normal - tip.normal_viscosity * d_n_rate; // (44)
        right[7 + i] = -tangential - tip.tangential_viscosity * d_t_rate; // (45)
        // gamma: X_i and G_i (11), their rates, and the part of their second derivatives that does not depend
        // on p-dot.
        let arm = Rotation2::new(-sign * angle) * Vector2::new(sign * finger.half_thickness, finger.length);
        let place = frame * (q.fixed_rows::<2>(0) - arm + sign * finger.root_offset * Vector2::x()); // (7, 8)
        let pace = frame * (p.fixed_rows::<2>(0) - sign * turn * quarter(arm)) + omega * quarter(place);
        let bend = turn.powi(2) * (frame * arm) + omega.powi(2) * place + 2.0 * omega * quarter(pace);
        let gap = sign * place.x - (tip.radius - d_n) - object.width / 2.0 - sign * object.com_offset; // (9)
        right[9 + i] = sign * bend.x + 2.0 * gains.alpha * velocity[i] + gains.alpha.powi(2) * gap; // (22)
        right[11 + i] = bend.y - d_n_rate * (turn + sign * omega) + gains.beta * velocity[2 + i]; // (23)
    }
    let mut left = SMatrix::<f64, 13, 13>::zeros(); // (24) without its rows for q-dot = p
    left.fixed_view_mut::<9, 9>(0, 0).copy_from(&physics.mass_matrix()); // (14)
    left.fixed_view_mut::<9, 4>(0, 9).copy_from(&-phi.transpose());
    left.fixed_view_mut::<4, 9>(9, 0).copy_from(&-phi);
    let solution = left.lu().solve(&right).expect("the rows of Phi are independent");
    let rate = SVector::from_iterator(p.iter().chain(solution.iter().take(9)).chain(&errors).copied());
    (rate, solution.fixed_rows::<4>(9).into_owned())
}

/// A step of RK4 from the state `y` with the rate `k1`, over `h`.
pub fn rk4(rate: &Rate, y: &SVector<f64, 20>, k1: &SVector<f64, 20>, h: f64) -> SVector<f64, 20> {
    let k2 = rate(&(y + h / 2.0 * k1));
    let k3 = rate(&(y + h / 2.0 * k2));
    let k4 = rate(&(y + h * k3));
    y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
}

/// A step of the implicit midpoint rule: y + 2 z, where z = h/2 f(y + z) by Newton's iteration with the Jacobian at the
/// start, by differences.
pub fn midpoint(rate: &Rate, y: &SVector<f64, 20>, k1: &SVector<f64, 20>, h: f64) -> SVector<f64, 20> {
    let mut left = SMatrix::<f64, 20, 20>::identity();
    for n in 0..20 {
        let (mut moved, by) = (*y, 1e-7 * (1.0 + y[n].abs()));
        moved[n] += by;
        let change = h / 2.0 * (rate(&moved) - k1) / by;
        left.set_column(n, &(left.column(n) - change));
    }
    let (factors, mut z) = (left.lu(), h / 2.0 * k1);
    for _ in 0..20 {
        let correction = factors.solve(&(h / 2.0 * rate(&(y + z)) - z)).expect("the step is short enough");
        z += correction;
        if correction.norm() <= 1e-14 * z.norm() {
            break;
        }
    }
    y + 2.0 * z
}

/// The rate of a state.
pub type Rate<'a> = dyn Fn(&SVector<f64, 20>) -> SVector<f64, 20> + 'a;
/// A step from a state with its rate, over a time.
pub type StepOf = fn(&Rate, &SVector<f64, 20>, &SVector<f64, 20>, f64) -> SVector<f64, 20>;

/// q, p and lambda at the start and after each of `steps` steps of length `h`.
pub fn specified(
    (scene, gains): (&Scene, &Stabilization),
    step: StepOf,
    (h, steps): (f64, usize),
) -> Vec<SVector<f64, 22>> {
    let Motion { q, p, memory, .. } = &scene.initial.motion;
    let mut y = SVector::from_iterator(q.row().into_iter().chain(p.row()).chain(*memory));
    let row = |_| {
        let (k1, lambda) = rates(scene, gains, &y);
        let row = SVector::from_iterator(y.iter().take(18).chain(&lambda).copied());
        y = step(&|y| rates(scene, gains, y).0, &y, &k1, h);
        row
    };
    (0..=steps).map(row).collect()
}

/// The largest difference of each of q, p and lambda, as a share of its largest size along the run.
pub fn differences(specified: &[SVector<f64, 22>], kept: &Recording) -> SVector<f64, 22> {
    let (mut difference, mut size) = (SVector::zeros(), SVector::zeros());
    for (k, row) in specified.iter().enumerate() {
        let [q, p] = [Column::Q, Column::P].map(|column| &kept.rows::<9>(column)[k]);
        let simulated = q.iter().chain(p).chain(&kept.rows::<4>(Column::Multipliers)[k]);
        difference = (row - SVector::from_iterator(simulated.copied())).abs().sup(&difference);
        size = row.abs().sup(&size);
    }
    difference.component_div(&size)
}

fn main() -> Result<(), softpinch::error::Error> {
    let parameters = Parameters::default().checked()?;
    let (initial, inputs) = (State::at_rest(contact(&parameters)?), Inputs::constant_targets([0.12, 0.07]));
    let scene = Scene { parameters, inputs, initial, check: true, duration: 0.1 };
    let record = [Recordable::State, Recordable::Multipliers].into_iter().collect();
    for (method, step) in [(Method::Rk4, rk4 as StepOf), (Method::ImplicitMidpoint, midpoint)] {
        let options = Options { steps: Steps::Fixed(1e-4), method, record, ..Options::default() };
        let start = Instant::now();
        let (run, _) = simulate(&scene, &options, &|| false)?;
        let simulated = start.elapsed();
        let start = Instant::now();
        let rows = specified((&scene, &options.stabilization), step, (1e-4, 1000));
        let written_out = start.elapsed();
        let largest = differences(&rows, &run.recording).max();
        println!(
            "{}: `simulate` takes {:.2} us a step, the matrices {:.2} us; q, p and lambda differ by at most {largest:.1e} \
             of their sizes",
            method.name(),
            1e3 * simulated.as_secs_f64(),
            1e3 * written_out.as_secs_f64(),
        );
    }
    Ok(())
}
