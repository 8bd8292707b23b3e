//! A bound on the rates at which the scene's fast motions decay or oscillate. It tells before a run, from its
//! parameters alone, whether the steps of an explicit method can be beyond the method's stability limit.

use crate::model::{Fingers, MechanismKind, Parameters, ShapeKind};

/// A bound on |eigenvalue| of the motion without the stabilisation's own modes, 1/s.
///
/// M q'' + C q' + K q = 0 without any constraint has |s| <= (c + sqrt(c^2 + 4 k)) / 2, where c and k are the largest
/// eigenvalues of M^-1 C and M^-1 K. A contact that sticks constrains this motion, which makes neither c nor k larger;
/// a free tip moves by itself. Slips under friction near the critical one, and grazes, may have larger rates. M and C
/// are diagonal. K has K_P of (39) and the second derivatives of (5), which are largest at d_n = a and theta_p = 0 as
/// long as the contact has not reached the rim of the hemisphere. Its largest eigenvalue is at most the sum of the
/// diagonal of M^-1 K over the coordinates that one tip moves. The integral of (39) adds at most the cube root of K_I /
/// I_i, a Maxwell branch its own rate and the stiffness that it has at once. Dry friction of a joint damps by f / v at
/// most.
pub fn fastest_rate(parameters: &Parameters, fingers: Fingers) -> f64 {
    let Parameters { tips, grasped, control, .. } = parameters;
    let inertias = parameters.masses().finger;
    let (mut damping, mut stiffness, mut tilting, mut integral) = (0.0f64, 0.0f64, 0.0, 0.0f64);
    let mut fading = 0.0f64;
    for (i, (tip, gains)) in tips.iter().zip(control).enumerate() {
        let inertia = inertias[i];
        let press = 2.0 * std::f64::consts::PI * parameters.modulus(i) * tip.radius;
        let tilt = press * tip.radius * tip.radius / 3.0;
        let arc = parameters.shape(i) == ShapeKind::Arc;
        let curvature = if arc { 1.0 / parameters.shapes[i].radius } else { 0.0 };
        let branches = &parameters.relaxation[i];
        let at_once = 1.0 + branches.iter().map(|branch| branch.share).sum::<f64>();
        fading = branches
            .iter()
            .filter(|branch| branch.share > 0.0)
            .fold(fading, |most, branch| most.max(1.0 / branch.time));
        let mut alone = at_once * (press / tip.normal_mass + press / tip.tangential_mass);
        damping = damping.max(tip.normal_viscosity / tip.normal_mass);
        damping = damping.max(tip.tangential_viscosity / tip.tangential_mass);
        if fingers != Fingers::Driven {
            let joint = &parameters.mechanisms[i];
            damping = damping.max(joint.rubs * joint.joint_friction / (joint.creep_rate * inertia));
            let turn = if parameters.mechanism(i) == MechanismKind::OneLink { 1.0 } else { 0.0 };
            let by_finger = turn + curvature * parameters.lever(i);
            alone += tilt * by_finger * by_finger / inertia;
        }
        if fingers == Fingers::Pid {
            alone += gains.kp / inertia;
            damping = damping.max(gains.kd / inertia);
            integral = integral.max(gains.ki / inertia);
        }
        stiffness = stiffness.max(alone);
        // On an arc theta_p follows the way along it, too.
        let by_turn = 1.0 + curvature * parameters.reach(i);
        tilting += tilt * (by_turn * by_turn / grasped.inertia + curvature * curvature / grasped.mass);
    }
    let decay = 0.5 * damping;
    decay + libm::hypot(decay, (stiffness + tilting).sqrt()) + libm::cbrt(integral) + fading
}
