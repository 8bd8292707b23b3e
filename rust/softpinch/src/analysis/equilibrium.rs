//! Where a scene comes to rest under constant inputs.
//!
//! The search begins with Newton's method from the middle between the tips. If that finds no grasp in which the energy
//! has a minimum, the object is found without its load, and the load is put on slowly (`continuation`); if that fails
//! too, many other starts are tried. From a state that is given, Newton's method is tried first; if it finds no
//! minimum, the object is held there and released slowly; and if that fails too, the search begins as without a state.

use std::fmt::{self, Display, Formatter};

use crate::analysis::balance::{FINGER, coordinates};
use crate::analysis::rest::{Matrix7, Vector7};
use crate::analysis::starts::{Gap, natural, others};
use crate::analysis::{End, Member, Rest, RestScene, Unknowns, follow};
use crate::error::brief;
use crate::formulation::Evaluation;
use crate::model::{Coordinates, Fingers, Geometry, Input, Motion, Parameters};
use crate::stepping::{Limits, Status, VIOLATIONS, Violation, ViolationSet};

/// Why there is no equilibrium; as text, what follows "no equilibrium: ".
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// The tips do not reach the object at these angles of the fingers; the gap in m.
    Apart(f64),
    /// The state near which an equilibrium is sought is outside the range of the model.
    Outside(Violation),
    /// At this share of a slow change of the scene the equilibrium ends in a fold, or leaves the range of the model.
    Ends(Way, f64, Option<Violation>),
    /// No start leads to an equilibrium, or not the one that is given.
    NotFound {
        /// Whether a start is given.
        near: bool,
    },
}

/// A slow change of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// The weight and the other forces on the object are put on.
    Load,
    /// The object, which is held in a state, is released.
    Release,
    /// One scene becomes another.
    Change,
}

impl Reason {
    /// The public name of the reason.
    pub fn name(&self) -> &'static str {
        match *self {
            Self::Apart(_) => "apart",
            Self::Outside(violation) | Self::Ends(_, _, Some(violation)) => Status::of(violation).name(),
            Self::Ends(Way::Load, _, None) => "overloaded",
            Self::Ends(..) | Self::NotFound { .. } => "not_found",
        }
    }
}

impl Display for Reason {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Apart(gap) => write!(
                out,
                "at these angles of the fingers the object would have to be {} mm wider, unless it is turned between the tips",
                brief(1e3 * gap)
            ),
            Self::Outside(violation) => {
                write!(out, "in the state near which it is sought a tip is {}", Status::of(violation).name())
            }
            Self::Ends(way, share, violation) => {
                // A share below zero is round-off.
                let percent = (1e6 * share.max(0.0)).round() / 1e4;
                match way {
                    Way::Load => write!(out, "at {percent} % of the load (weight and forces) ")?,
                    Way::Release => write!(
                        out,
                        "if the object is held in this state and released slowly, after {percent} % of the release "
                    )?,
                    Way::Change => write!(out, "after {percent} % of the change ")?,
                }
                match violation {
                    Some(violation) => write!(out, "a tip is {}", Status::of(violation).name()),
                    None => write!(out, "the balance ends"),
                }
            }
            Self::NotFound { near: true } => write!(out, "none was found from this state"),
            Self::NotFound { near: false } => write!(out, "none was found from any start"),
        }
    }
}

/// A scene and the member of its family.
type Posed<'a> = (&'a RestScene, &'a Member);

/// An extreme violation, in which the model ends: separated, crushed or folded.
pub(super) fn leaves(scene: &RestScene, rest: &Rest) -> Option<Violation> {
    if rest.is_grasp(scene) {
        return None;
    }
    let balance = &rest.rows.balance;
    let compression = balance.q.compression;
    let separated = (0..2).any(|i| compression[i] <= 0.0);
    let crushed = (0..2).any(|i| compression[i] >= scene.parameters.tips[i].radius);
    Some(match (separated, crushed) {
        (true, _) => Violation::Separated,
        (false, true) => Violation::Crushed,
        (false, false) => Violation::Folded,
    })
}

/// The violations of the model's assumptions in a state at rest.
pub fn violations(scene: &RestScene, rest: &Rest) -> ViolationSet {
    let balance = &rest.rows.balance;
    let motion = Motion { q: balance.q, ..Motion::zero() };
    let geometry = Geometry::<f64>::of(&scene.plant.sides, &motion.q, &motion.p);
    let now = Evaluation::of_contacts(&motion, &balance.multipliers, &geometry, [0.0; 2]);
    let found: [_; VIOLATIONS.len()] = Limits::<f64>::new(&scene.parameters).violated(&now, None);
    ViolationSet::of(&found, 0)
}

/// A scene between two others, and the member of its family, after a share of the way.
fn between((from, first): Posed<'_>, (to, last): Posed<'_>, share: f64) -> (RestScene, Member) {
    let between = |a: f64, b: f64| if a.is_finite() && b.is_finite() { a + share * (b - a) } else { b };
    let pair = |a: &[f64; 2], b: &[f64; 2]| std::array::from_fn(|i| between(a[i], b[i]));
    let (start, end) = (from.parameters.to_array(), to.parameters.to_array());
    let parameters = Parameters::unchecked(&std::array::from_fn(|k| between(start[k], end[k])))
        .of_the_kinds(&to.parameters);
    let input = Input {
        target: pair(&from.input.target, &to.input.target),
        force: std::array::from_fn(|i| between(from.input.force[i], to.input.force[i])),
        ..to.input
    };
    let member = match (first, last) {
        (Member::Grip(a), Member::Grip(b)) => Member::Grip(pair(a, b)),
        (Member::Shear(a), Member::Shear(b)) => Member::Shear(pair(a, b)),
        _ => *last,
    };
    (to.with(parameters).under(input), member)
}

/// Follows the equilibrium of one scene, near the unknowns `start`, to that of another scene whose fingers move in the
/// same way. The members must be of the same kind.
pub fn continued(from: Posed<'_>, start: &Unknowns, to: Posed<'_>) -> Result<Rest, Reason> {
    let begin = Rest::solve(from.0, from.1, start).ok_or(Reason::NotFound { near: true })?;
    changed(from, &begin, to, Way::Change)
}

/// Follows the equilibrium of one scene to that of another.
fn changed(from: Posed<'_>, start: &Rest, to: Posed<'_>, way: Way) -> Result<Rest, Reason> {
    match follow(|share| between(from, to, share), start, 1.0, leaves, |_| ()) {
        Some(End::Reached(rest)) => Ok(rest),
        Some(End::Event(violation, at)) => Err(Reason::Ends(way, at.share, Some(violation))),
        Some(End::Fold(at)) => Err(Reason::Ends(way, at.share, None)),
        Some(End::Lost(_)) | None => Err(Reason::NotFound { near: way != Way::Load }),
    }
}

/// The equilibrium that follows from that without load.
fn loaded_slowly(scene: &RestScene, member: &Member) -> Result<Rest, Reason> {
    let weight = scene.parameters.grasped.mass * scene.parameters.surroundings.gravity;
    // This force carries the object.
    let input = Input { force: [0.0, weight, 0.0], ..scene.input };
    let light = scene.under(input);
    let start =
        Rest::solve(&light, member, &natural(scene, member)).ok_or(Reason::NotFound { near: false })?;
    match leaves(&light, &start) {
        Some(violation) => Err(Reason::Ends(Way::Load, 0.0, Some(violation))),
        None => changed((&light, member), &start, (scene, member), Way::Load),
    }
}

/// The equilibrium that follows if the object is held at a state and released slowly.
fn released_slowly(scene: &RestScene, member: &Member, z: &Unknowns) -> Result<Rest, Reason> {
    let rest = Rest { z: *z, rows: scene.rows(member, z) };
    if let Some(violation) = leaves(scene, &rest) {
        return Err(Reason::Outside(violation));
    }
    let balance = &rest.rows.balance;
    let mut input = scene.input;
    for k in 0..3 {
        input.force[k] -= balance.forces[k];
    }
    for (i, held) in scene.held().into_iter().enumerate() {
        let (angle, torque) = (z[FINGER + i], -balance.forces[FINGER + i]);
        let slope = scene.torque_slope(i);
        input.target[i] = match (held, scene.fingers) {
            (true, _) => angle,
            (false, Fingers::Torque) => torque,
            (false, _) if slope > 0.0 => angle + torque / slope,
            (false, _) => return Err(Reason::NotFound { near: true }),
        };
    }
    changed((&scene.under(input), member), &rest, (scene, member), Way::Release)
}

/// Finds the equilibrium of a member of the family, from unknowns near it if they are given.
pub fn find(scene: &RestScene, member: &Member, near: Option<&Unknowns>) -> Result<Rest, Reason> {
    let Some(near) = near else { return search(scene, member) };
    let first = Rest::solve(scene, member, near).filter(|rest| rest.is_grasp(scene));
    // A grip or shears say which member is meant, and the state only where the search begins.
    if !matches!(member, Member::From(_)) {
        return first.map_or_else(|| search(scene, member), Ok);
    }
    if let Some(rest) = first.filter(|rest| rest.is_minimum(scene)) {
        return Ok(rest);
    }
    // Newton's method may have passed the equilibrium to which a slow motion leads.
    let released = released_slowly(scene, member, near);
    released.ok().or(first).map_or_else(|| search(scene, member).map_err(|_| reason(released)), Ok)
}

fn reason(found: Result<Rest, Reason>) -> Reason {
    found.err().unwrap_or(Reason::NotFound { near: false })
}

/// Finds the equilibrium of a member of the family from our own starts.
fn search(scene: &RestScene, member: &Member) -> Result<Rest, Reason> {
    let grasp = |rest: &Rest| rest.is_grasp(scene);
    let settles = |rest: &Rest| rest.is_grasp(scene) && rest.is_minimum(scene);
    let first = Rest::solve(scene, member, &natural(scene, member)).filter(grasp);
    if let Some(rest) = first.filter(settles) {
        return Ok(rest);
    }
    let slowly = loaded_slowly(scene, member);
    if let Some(rest) = slowly.ok().filter(settles) {
        return Ok(rest);
    }
    // Shears are no good coordinates of the family; a member in its middle is near most of the others.
    let beside = match member {
        Member::Shear(_) => search(scene, &Member::Grip([0.0; 2])).ok().map(|rest| rest.z),
        Member::Grip(_) | Member::From(_) => None,
    };
    let mut starts = beside
        .into_iter()
        .chain(others(scene, member))
        .filter_map(|start| Rest::solve(scene, member, &start))
        .filter(grasp);
    let mut saddle = first.or(slowly.ok());
    if let Some(rest) = starts.find(|rest| {
        saddle = saddle.or(Some(*rest));
        settles(rest)
    }) {
        return Ok(rest);
    }
    let gap = Gap::new(&scene.parameters, scene.input.target);
    saddle.ok_or(if scene.held() == [true; 2] && gap.overlap <= 0.0 {
        Reason::Apart(-gap.overlap)
    } else {
        reason(slowly)
    })
}

/// The derivatives of the coordinates by the grip of the right and the left tip along the family.
pub fn neutral(scene: &RestScene, rest: &Rest) -> [Coordinates; 2] {
    let rows = &rest.rows;
    let (unit, scale) = scene.scales();
    let matrix = Matrix7::from_fn(|r, c| {
        let slope = if r < 5 { rows.jacobian[r][c] } else { rows.sigma[r - 5][c] };
        slope * unit[c] / scale[r]
    });
    let lu = matrix.lu();
    std::array::from_fn(|k| {
        // sigma is minus the grip.
        let load = Vector7::from_fn(|r, _| if r == 5 + k { -1.0 / scale[r] } else { 0.0 });
        let Some(step) = lu.solve(&load) else { return [f64::NAN; 9].into() };
        let change: Unknowns = std::array::from_fn(|n| step[n] * unit[n]);
        let compression = rows
            .compressions
            .map(|slopes| slopes.iter().zip(change).map(|(slope, change)| slope * change).sum());
        Coordinates { compression, ..coordinates(&change) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::inputs::Inputs;
    use crate::model::motion::Motion;

    const ANGLE: f64 = 0.105;

    fn scene(parameters: &Parameters, target: [f64; 2], force: [f64; 3]) -> RestScene {
        let inputs = Inputs::constant(target, force, Fingers::Pid);
        RestScene::new(parameters, Fingers::Pid, &inputs.segment(0.0))
    }

    #[test]
    fn an_upright_symmetric_grasp_rests_where_its_shears_carry_the_weight() {
        let parameters = Parameters::default();
        let scene = scene(&parameters, [ANGLE; 2], [0.0; 3]);
        let rest = find(&scene, &Member::Grip([0.0; 2]), None).unwrap();
        let (q, held) = (rest.rows.balance.q, rest.stiffness());
        assert!(q.object[0].abs() < 1e-15 && q.object[2].abs() < 1e-15);
        let (stiffness, weight) = (std::f64::consts::PI * parameters.tips[0].youngs_modulus, 0.1 * 9.81);
        for i in 0..2 {
            let (d_n, d_t) = (q.compression[i], q.shear[i]);
            // lambda^N = pi E (d_n^2 tan(theta_p) + 2 d_n d_t) of (5) carries half of the weight.
            let carried = stiffness * (d_n * d_n * ANGLE.tan() + 2.0 * d_n * d_t);
            assert!((carried - 0.5 * weight).abs() < 1e-12 * stiffness * d_n * d_n);
        }
        // K - K^T has the sum of lambda^N at (x, theta).
        let turned = held[(0, 2)] - held[(2, 0)];
        assert!((turned - weight).abs() < 1e-9);
        assert!(rest.is_minimum(&scene) && violations(&scene, &rest) == ViolationSet::default());
    }

    #[test]
    fn an_object_that_is_held_and_released_comes_to_the_same_rest() {
        let scene = scene(&Parameters::default(), [0.15, 0.05], [1.0, -2.0, 0.02]);
        let grip = Member::Grip([0.0; 2]);
        let rest = find(&scene, &grip, None).unwrap();
        let mut z = rest.z;
        z[0] += 1e-3;
        z[2] -= 0.05;
        scene.shear_into(&grip, &mut z);
        let from = Member::From(scene.origin(&z));
        let (newton, slowly) =
            (Rest::solve(&scene, &from, &z).unwrap(), released_slowly(&scene, &from, &z).unwrap());
        let [newton, slowly] = [newton, slowly].map(|rest| rest.rows.balance.q.row());
        for k in 0..9 {
            assert!((newton[k] - slowly[k]).abs() < 1e-12);
        }
        // A search cannot begin away from the curve.
        assert!(continued((&scene, &grip), &z, (&scene, &grip)).is_ok());
        let change = |share| between((&scene, &grip), (&scene, &grip), share);
        let away = Rest { z, rows: scene.rows(&grip, &z) };
        assert!(follow(change, &away, 1.0, leaves, |_| ()).is_none());
    }

    #[test]
    fn a_load_that_grows_ends_in_a_fold_and_not_on_another_branch() {
        let parameters = Parameters::default();
        let heavy = scene(&parameters, [ANGLE; 2], [400.0, 0.0, 0.0]);
        let member = Member::Grip([0.0; 2]);
        let Err(Reason::Ends(Way::Load, share, None)) = find(&heavy, &member, None) else {
            panic!("the force is too large for the grasp")
        };
        let at = |share: f64| find(&scene(&parameters, [ANGLE; 2], [400.0 * share, 0.0, 0.0]), &member, None);
        // The weight grows with the force; it hardly matters.
        assert!(at(0.98 * share).is_ok_and(|rest| rest.is_minimum(&heavy)));
        assert!(at(1.02 * share).is_ok_and(|rest| !rest.is_minimum(&heavy)));
    }

    #[test]
    fn the_growth_of_small_motions_is_that_of_their_own_eigenvalues() {
        let scene = scene(&Parameters::default(), [ANGLE; 2], [0.0; 3]);
        let rest = find(&scene, &Member::Grip([0.0; 2]), None).unwrap();
        let balance = &rest.rows.balance;
        let motion = Motion { q: balance.q, memory: scene.memory(balance), ..Motion::zero() };
        let inputs = Inputs::constant(scene.input.target, scene.input.force, Fingers::Pid);
        let setting = crate::analysis::linear::Setting {
            formulation: crate::formulation::table::Formulation::Nullspace,
            gains: crate::model::parameters::Stabilization { alpha: 0.0, beta: 0.0 },
            open_loop: false,
            frozen: false,
        };
        let whole = crate::analysis::Problem::new(&scene.parameters, &inputs, &setting, 0.0, &motion, None)
            .unwrap()
            .jacobian();
        let mut rates: Vec<f64> = whole.complex_eigenvalues().iter().map(|rate| rate.re).collect();
        rates.sort_by(|a, b| b.total_cmp(a));
        let (growth, _) = crate::analysis::linear::growth(&scene.parameters, &inputs, &motion).unwrap();
        // The two zeros of the family come before the slowest decay.
        assert!(rates[0].abs() < 1e-6 && rates[1].abs() < 1e-6);
        assert!((growth - rates[2]).abs() < 1e-8 * growth.abs());
    }
}
