//! The largest load that a grasp bears: a force and a moment on the object, or an acceleration of the hand, grow slowly,
//! and the equilibrium moves along the no-slip constraint until a contact gives way.

use std::cell::Cell;

use crate::analysis::continuation::Point;
use crate::analysis::equilibrium::leaves;
use crate::analysis::linear::growth;
use crate::analysis::{End, Member, Rest, RestScene, follow, violations};
use crate::model::{Coordinates, Input, Motion};
use crate::stepping::{Status, Violation};

/// The violations at which a contact gives way, in the order in which they are named.
const GIVES_WAY: [Violation; 3] = [Violation::Pulling, Violation::Slipping, Violation::OffFace];
/// A rate of growth below this share of the largest eigenvalue is round-off.
const GROWTH: f64 = 1e-11;
/// A wrench that moves the grasp as much as a tip's stiffness times this length, in radii, counts as unlimited.
const UNLIMITED: f64 = 100.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limit {
    /// A contact gives way.
    Violation(Violation),
    /// Beyond this wrench the equilibrium ends (a fold), slow displacements are no longer driven back (a bifurcation),
    /// or oscillations grow (flutter).
    Unstable,
    /// Nothing gives way up to a wrench that is far beyond the range of the model.
    None,
    /// The search did not get any further.
    Lost,
}

impl Limit {
    pub fn name(self) -> &'static str {
        match self {
            Self::Violation(violation) => Status::of(violation).name(),
            Self::Unstable => "unstable",
            Self::None => "none",
            Self::Lost => "lost",
        }
    }
}

/// Whether small motions about an equilibrium grow, beyond round-off.
fn grows(scene: &RestScene, rest: &Rest) -> bool {
    let q = rest.rows.balance.q;
    // At rest no memory and no torque changes the derivatives.
    let motion = Motion { q, memory: scene.memory(&rest.rows.balance), ..Motion::zero() };
    growth(&scene.parameters, &scene.inputs(), &motion).is_none_or(|(rate, largest)| rate > GROWTH * largest)
}

/// What limits the wrench at an equilibrium, if anything does.
fn limit(scene: &RestScene, rest: &Rest) -> Option<Limit> {
    let found = leaves(scene, rest).or_else(|| {
        let found = violations(scene, rest);
        GIVES_WAY.into_iter().find(|&violation| found.contains(violation))
    });
    let unstable = || rest.free_stiffness(scene).determinant() <= 0.0 || grows(scene, rest);
    found.map(Limit::Violation).or_else(|| unstable().then_some(Limit::Unstable))
}

/// What grows until a contact gives way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Load {
    /// A force (F_x, F_y) and a moment on the object, N and N m, beside those of the scene.
    Wrench([f64; 3]),
    /// An acceleration of the hand along fixed axes, m/s^2, beside that of the scene.
    Acceleration([f64; 2]),
}

/// The largest multiple of a load that the equilibrium bears, its limit, and the coordinates there. Zero has no limit.
pub fn largest_multiple(scene: &RestScene, rest: &Rest, load: Load) -> (f64, Limit, Coordinates) {
    let q = rest.rows.balance.q;
    let (_, scale) = scene.scales();
    // An acceleration is as large as the forces that it exerts on the object.
    let wrench = match load {
        Load::Wrench(wrench) => wrench,
        Load::Acceleration([x, y]) => [x, y, 0.0].map(|rate| scene.parameters.grasped.mass * rate),
    };
    let size = (0..3).map(|k| (wrench[k] / scale[k]).abs()).fold(0.0, f64::max);
    if size == 0.0 {
        return (f64::INFINITY, Limit::None, q);
    }
    if let Some(limit) = limit(scene, rest) {
        return (0.0, limit, q);
    }
    let force = scene.input.force;
    // The physics of a hand that moves are made once for all accelerations.
    let base = if let Load::Acceleration(_) = load { &scene.accelerated([0.0; 2]) } else { scene };
    let before = scene.frame.map_or([0.0; 2], |frame| frame.in_fixed_axes(frame.acceleration));
    let member = Cell::new(Member::From(scene.origin(&rest.z)));
    // The load whose largest component is one, in the scales of the rows, times the share.
    let change = |share: f64| {
        let changed = match load {
            Load::Wrench(wrench) => {
                let force = std::array::from_fn(|k| force[k] + share * (wrench[k] / size));
                base.under(Input { force, ..scene.input })
            }
            Load::Acceleration(rate) => {
                base.accelerated(std::array::from_fn(|k| before[k] + share * (rate[k] / size)))
            }
        };
        (changed, member.get())
    };
    let after_step = |rest: &Rest| member.set(Member::From(scene.origin(&rest.z)));
    let ended = |at: &Point, limit: Limit| (at.share / size, limit, at.rest.rows.balance.q);
    match follow(change, rest, UNLIMITED, limit, after_step) {
        Some(End::Event(limit, at)) => ended(&at, limit),
        Some(End::Fold(at)) => ended(&at, Limit::Unstable),
        Some(End::Lost(at)) => ended(&at, Limit::Lost),
        Some(End::Reached(_)) => (f64::INFINITY, Limit::None, q),
        None => (0.0, Limit::Lost, q),
    }
}
