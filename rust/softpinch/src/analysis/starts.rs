//! Starts of the search for an equilibrium.

use crate::analysis::{Member, RestScene, Unknowns};
use crate::model::contact::mechanism::Mechanism;
use crate::model::{Fingers, Parameters, coordinate_at};
use crate::number::signed;

/// Turns of the object away from the line between the tips, rad, and shifts along it and across it as shares of the
/// tip's radius, from which the search starts again.
const TURNS: [f64; 7] = [0.0, 0.15, -0.15, 0.35, -0.35, 0.6, -0.6];
const SHIFTS: [f64; 3] = [0.0, 0.5, -0.5];
/// Shares of the way from touching tips to the targets of fingers that give way.
const SHARES: [f64; 4] = [1.0, 0.5, 0.2, 0.05];

/// Where the tips are without an object between them.
pub struct Gap {
    /// The middle between the tips' centres, m.
    middle: [f64; 2],
    /// The direction from the left tip's centre to the right one's, rad.
    direction: f64,
    /// The sum of both compressions that the object's width demands, m; negative if the tips do not reach it.
    pub overlap: f64,
}

impl Gap {
    pub fn new(parameters: &Parameters, angles: [f64; 2]) -> Self {
        let centre = |i: usize| {
            let [inwards, up] = Mechanism::<f64>::new(parameters, i).placed(angles[i]).centre;
            [signed(i, inwards), up]
        };
        let ([x1, y1], [x2, y2]) = (centre(0), centre(1));
        let widths = parameters.half_width(0) + parameters.half_width(1);
        let reach = parameters.tips[0].radius + parameters.tips[1].radius + widths;
        Self {
            middle: [0.5 * (x1 + x2), 0.5 * (y1 + y2)],
            direction: libm::atan2(y1 - y2, x1 - x2),
            overlap: reach - libm::hypot(x1 - x2, y1 - y2),
        }
    }
}

/// The angles at which fingers that are not held are expected to rest; `share` is that of the way from touching tips to
/// the target.
fn angles(scene: &RestScene, share: f64) -> [f64; 2] {
    let (held, target) = (scene.held(), scene.input.target);
    std::array::from_fn(|i| {
        if held[i] {
            return target[i];
        }
        let stiffness = std::f64::consts::PI * scene.parameters.modulus(i);
        if scene.fingers == Fingers::Torque {
            // pi E d_n^2 L is the torque of an upright tip.
            let compression = (target[i].abs() / (stiffness * scene.parameters.lever(i))).sqrt();
            return coordinate_at(&scene.parameters, i, share * compression).unwrap_or(0.0);
        }
        let touching = coordinate_at(&scene.parameters, i, 0.0).unwrap_or(target[i]);
        touching + share * (target[i] - touching)
    })
}

/// A start with the object between the tips, turned and shifted from the middle.
fn between(scene: &RestScene, member: &Member, share: f64, turn: f64, [along, across]: [f64; 2]) -> Unknowns {
    let Parameters { tips: [right, left], .. } = &scene.parameters;
    let angles = angles(scene, share);
    let gap = Gap::new(&scene.parameters, angles);
    // d_n^2 E is the force of an upright tip, which is equal on both sides.
    let ratio = (scene.parameters.modulus(0) / scene.parameters.modulus(1)).sqrt();
    let [inner, outer] = [gap.overlap / (1.0 + ratio), gap.overlap * ratio / (1.0 + ratio)];
    // The right tip is compressed by `inner`, so the middle of the object is nearer to the tip that gives way less.
    let length = right.radius.max(left.radius);
    let [one, other] = [0, 1].map(|i| scene.parameters.half_width(i));
    let shift = 0.5 * ((left.radius - outer) - (right.radius - inner)) + 0.5 * (other - one) + along * length;
    let (sin, cos) = (libm::sin(gap.direction), libm::cos(gap.direction));
    let theta = gap.direction + turn;
    let grip = match member {
        Member::Grip(grip) => -0.5 * (grip[0] + grip[1]),
        Member::Shear(_) | Member::From(_) => 0.0,
    } + across * length;
    let [x, y] = [gap.middle[0] + shift * cos - grip * sin, gap.middle[1] + shift * sin + grip * cos];
    let mut z = [x, y, theta, angles[0], angles[1], 0.0, 0.0];
    scene.shear_into(member, &mut z);
    z
}

/// The start that comes first, with the object in the middle between the tips.
pub fn natural(scene: &RestScene, member: &Member) -> Unknowns {
    between(scene, member, SHARES[0], 0.0, [0.0; 2])
}

/// All other starts, those that are near the first one before the others.
pub fn others<'a>(scene: &'a RestScene, member: &'a Member) -> impl Iterator<Item = Unknowns> + 'a {
    let shares = if scene.held() == [true; 2] { &SHARES[..1] } else { &SHARES[..] };
    let (shifts, turns) = (SHIFTS.len(), TURNS.len());
    // The first of them is the natural start.
    (1..shares.len() * shifts * shifts * turns).map(move |n| {
        let (turn, across) = (TURNS[n % turns], SHIFTS[n / turns % shifts]);
        let (along, share) = (SHIFTS[n / turns / shifts % shifts], shares[n / turns / shifts / shifts]);
        between(scene, member, share, turn, [along, across])
    })
}
