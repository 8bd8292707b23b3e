//! The ways in which the model stops holding. Each is watched at the ends of steps, and at the instants
//! inside a step that an adaptive run looks at; its first time is noted.

use crate::error::seconds;
use crate::formulation::Evaluation;
use crate::model::contact::Side;
use crate::model::contact::law::modulus;
use crate::model::{Any, Contact, Contacts, Geometry, Motion, Parameters, SIDES, ShapeKind, Source};
use crate::names::{named, set};
use crate::number::{Bits, LaneTask, Lanes, Real, task};
use crate::stepping::summary::{Memory, take_margins};
use crate::stepping::{Cause, Event, Instant};

named! {
    /// A way in which the model stops holding.
    Violation;
    /// The violations by their public names.
    VIOLATIONS = {
        /// d_n < -1e-9 a: the tip has left the object.
        Separated = "separated",
        /// d_n >= a: the tip is pressed flat.
        Crushed = "crushed",
        /// |theta_p| >= 90 degrees: the tip's energy (5) has a pole there.
        Folded = "folded",
        /// lambda^H < 0: the bilateral constraint pulls.
        Pulling = "pulling",
        /// |lambda^N| > mu lambda^H, where a scene gives mu. In unilateral contact: the tip slips.
        Slipping = "slipping",
        /// d_n > a (1 - sin |theta_p|): the contact reaches the hemisphere's rim, and (4) no longer equals (3).
        Rim = "rim",
        /// |G_i| > height / 2, where the object has a height: the contact lies beyond the end of the face.
        OffFace = "off_face",
        /// The tip is free, in unilateral contact.
        Opened = "opened",
    }
}

/// The violations that end a run unless it is told otherwise: after them the equations mean nothing. A run can
/// be told to end on any violation.
pub const STOP_ON: [(&str, Violation); 3] = [VIOLATIONS[0], VIOLATIONS[1], VIOLATIONS[2]];

/// A negative compression up to this share of the radius is round-off, not separation.
const SEPARATION: f64 = 1e-9;

/// The mode of a sticking contact is certain if friction could be less by this share. The choice of modes distrusts much smaller
/// margins only.
const MARGIN: f64 = 1e-6;

set! {
    ViolationSet of Violation
}

impl ViolationSet {
    /// The violations in `found` that hold in one lane.
    pub fn of(found: &[Bits; VIOLATIONS.len()], lane: usize) -> Self {
        Self(found.iter().enumerate().fold(0, |set, (k, bits)| set | u32::from(bits >> lane & 1) << k))
    }
}

/// Ends the message of an extreme violation at the start of a run.
const START: &str = ": this is the state in which the run starts";
/// Ends the message of an extreme violation later in a run: no motion gets so far in one step.
const RUNAWAY: &str = "; no motion leaps so far in a step: the steps are too long for this scene. max_stable_dt says how long dt may be, and a smaller \
     tolerance takes shorter steps";

/// The turning point of the cubic through values and rates at both ends, if the rates have opposite signs: its place as a
/// share of the time between the ends, and the value there.
#[inline(always)]
fn turning_point((f0, rate0): (f64, f64), (f1, rate1): (f64, f64), h: f64) -> Option<(f64, f64)> {
    if rate0 * rate1 >= 0.0 {
        return None;
    }
    let (m0, m1, rise) = (h * rate0, h * rate1, f1 - f0);
    // The cubic's derivative, m0 + 2 b x + 3 c x^2, has one root between ends of opposite signs. The root is computed in
    // its numerically stable form.
    let (b, c) = (3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise);
    let root = b.mul_add(b, -3.0 * c * m0).max(0.0).sqrt();
    let x = if m0 < 0.0 { -m0 / (b + root) } else { -m0 / (b - root) };
    (x > 0.0 && x < 1.0).then(|| (x, x.mul_add(x.mul_add(x.mul_add(c, b), m0), f0)))
}

#[derive(Clone, Copy)]
pub(super) enum Failure {
    /// The mode of the contact ends.
    Event(Cause),
    /// The model stops holding.
    Violation(Violation),
}

pub(super) struct Condition<R> {
    pub(super) failure: Failure,
    pub(super) lanes: Bits,
    /// The condition fails where its value is less than `least`, which is zero for events.
    pub(super) value: R,
    least: R,
    /// Whether it fails where both are equal, too.
    strict: bool,
}

impl<R: Lanes> Condition<R> {
    #[inline(always)]
    fn fails(&self) -> Bits {
        let Self { value, least, .. } = *self;
        self.lanes & if self.strict { value.at_most(least) } else { value.less(least) }
    }
}

/// A gap, a slip velocity or a share that is zero when its mode begins may fail by this share of its terms, by
/// round-off.
pub(super) const ROUND_OFF: f64 = 16.0 * f64::EPSILON;

/// The limits with which the model's quantities are compared.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits<R> {
    sides: [Side<R>; 2],
    /// The compression below which a tip has left the object.
    least: [R; 2],
    /// mu, and the lanes whose scene gives one.
    friction: [R; 2],
    limited: Bits,
    /// Half the length of each side; infinite if the object gives none.
    pub(super) half_height: [R; 2],
    /// 1/R of arcs.
    curvature: [R; 2],
    /// The modulus E of each tip.
    modulus: [R; 2],
    /// The violations that are events, because they end a run with unilateral contact.
    pub(super) ends: ViolationSet,
}

impl<R: Lanes> Limits<R> {
    /// The limits of a scene, or of one scene for each lane.
    #[inline(always)]
    pub fn new(source: &impl Source<R>) -> Self {
        let friction = [source.number(|p| p.friction.right), source.number(|p| p.friction.left)];
        let infinity = R::constant(f64::INFINITY);
        Self {
            sides: Side::both(source),
            least: [0, 1].map(|i| source.number(|p| -SEPARATION * p.tips[i].radius)),
            friction,
            limited: friction[0].less(infinity) | friction[1].less(infinity),
            half_height: [half_length(source, 0), half_length(source, 1)],
            curvature: [curvature(source, 0), curvature(source, 1)],
            modulus: [0, 1].map(|i| modulus(source, i)),
            ends: ViolationSet::default(),
        }
    }

    /// Lanes in which a compression or a tilt turns back between two instants.
    #[inline(always)]
    pub fn turning_points(&self, before: &Motion<R>, after: &Motion<R>) -> Bits {
        let mut found = 0;
        for i in 0..2 {
            found |= (before.p.compression[i] * after.p.compression[i]).less(R::zero());
            let first = self.sides[i].tilt_rate(i, &before.q, &before.p);
            let last = self.sides[i].tilt_rate(i, &after.q, &after.p);
            found |= (first * last).less(R::zero());
        }
        found
    }

    /// d_n plus the radius times the distance of |sin theta_p| from its value at the rim of tip `i`; on a face, the compression
    /// at the rim.
    #[inline(always)]
    fn rim(&self, at: &Evaluation<R>, i: usize) -> R {
        let (d_n, radius) = (at.motion.q.compression[i], self.sides[i].radius);
        if !self.sides[i].is_curved() {
            return radius * (R::constant(1.0) - at.sin_tilt[i].abs());
        }
        // The depth of the rim below a curved side: sin |theta_p| > (2 D + k (a^2 + D^2)) / (2 a (1 + k D)).
        let (depth, k) = (radius - d_n, self.curvature[i]);
        let rest = k * radius.dot2(radius, depth, depth);
        let most = (depth + depth + rest) / (k.mul_add(depth, R::constant(1.0)) * (radius + radius));
        radius.mul_add(most - at.sin_tilt[i].abs(), d_n)
    }

    /// The table of all conditions of contact `i`: gives each of them to `take`, those that events end in the order of
    /// their causes. With `tolerant`, those that are zero when a mode begins hold in spite of round-off. In unilateral
    /// contact there are `contacts`: tips neither pull nor press an object that they do not touch.
    #[inline(always)]
    pub(super) fn conditions(
        &self,
        at: &Evaluation<R>,
        contacts: Option<&Contacts<R>>,
        i: usize,
        tolerant: bool,
        mut take: impl FnMut(Condition<R>),
    ) {
        let Motion { q, p, .. } = &at.motion;
        let (d_n, radius) = (q.compression[i], self.sides[i].radius);
        let (along, across, v) = (at.multipliers[i], at.multipliers[2 + i], at.residuals[2 + i]);
        let heights = at.contact_heights.map(R::abs);
        let (half, quarter) = (self.half_height[i], R::constant(std::f64::consts::FRAC_PI_2));
        let mut inside = half - heights[i];
        let (mut touching, mut bilateral) = (Bits::MAX, Bits::MAX);
        if let Some(contacts) = contacts {
            let (free, graze, slip) = (contacts.free[i], contacts.graze[i], contacts.slip(i));
            (touching, bilateral) = (!free, 0);
            let both_free = contacts.free[0] & contacts.free[1];
            let other = self.half_height[1 - i] - heights[1 - i];
            inside = R::select(both_free, inside.max_in(other, R::ALL), inside);
            let mut forward = R::select(contacts.down[i], -v, v);
            let part = at.share[i].min_in(R::constant(1.0) - at.share[i], R::ALL);
            let mut gap = at.residuals[i];
            if tolerant {
                let round_off = |sizes: [R; 3]| {
                    let [a, b, c] = sizes.map(R::abs);
                    R::constant(ROUND_OFF) * (a + b + c)
                };
                forward = forward + round_off([p.object[0], p.object[1], p.shear[i]]);
                gap = gap + round_off([q.object[0], q.object[1], d_n]);
            }
            let mut event = |cause, lanes, value| {
                let (failure, least) = (Failure::Event(cause), R::zero());
                take(Condition { failure, lanes, value, least, strict: false });
            };
            event(Cause::Cone, !(slip | graze | free), self.friction[i] * along - across.abs());
            event(Cause::Stop, slip, forward);
            event(Cause::Release, slip, along);
            event(Cause::Share, graze, part);
            event(Cause::Impact, free, gap.max_in(heights[i] - half, R::ALL));
            // A surface of a free tip that has come to rest stays at rest.
            event(Cause::Relaxed, !(free & d_n.is_zero()), d_n);
            event(Cause::Lost, !free | both_free, inside);
            if self.ends.contains(Violation::Crushed) {
                event(Cause::Crushed, !free, radius - d_n);
            }
            if self.ends.contains(Violation::Folded) {
                event(Cause::Folded, !free, quarter - at.tilt[i].abs());
            }
        }
        let mut violation = |violation, lanes, value, least, strict| {
            take(Condition { failure: Failure::Violation(violation), lanes, value, least, strict });
        };
        let limited = bilateral & self.limited;
        if limited != 0 {
            violation(Violation::Slipping, limited, self.friction[i] * along, across.abs(), false);
        }
        violation(Violation::Pulling, bilateral, along, R::zero(), false);
        violation(Violation::Separated, bilateral, d_n, self.least[i], false);
        violation(Violation::OffFace, touching, half, heights[i], false);
        violation(Violation::Crushed, touching, radius, d_n, true);
        violation(Violation::Folded, touching, quarter, at.tilt[i].abs(), true);
        violation(Violation::Rim, touching, self.rim(at, i), d_n, false);
    }

    /// The value of an event, which is due where it is negative; zero in modes that do not have it.
    #[inline(always)]
    pub fn event_value(&self, now: &Evaluation<R>, contacts: &Contacts<R>, event: Event) -> R {
        let mut found = R::zero();
        self.conditions(now, Some(contacts), event.finger, false, |condition| {
            if matches!(condition.failure, Failure::Event(cause) if cause == event.cause) {
                found = condition.value;
            }
        });
        found
    }

    /// For each of [`VIOLATIONS`] the lanes in which it holds at an instant. In unilateral contact there are `contacts`,
    /// whose modes show two of them.
    #[inline(always)]
    pub fn violated(&self, now: &Evaluation<R>, contacts: Option<&Contacts<R>>) -> [Bits; VIOLATIONS.len()] {
        let mut found = [0; VIOLATIONS.len()];
        for i in 0..2 {
            self.conditions(now, contacts, i, false, |condition| {
                if let Failure::Violation(violation) = condition.failure {
                    found[violation as usize] |= condition.fails();
                }
            });
            if let Some(contacts) = contacts {
                found[Violation::Slipping as usize] |= contacts.slip(i);
                found[Violation::Opened as usize] |= contacts.free[i];
            }
        }
        found
    }

    /// The lanes in which each tip is free, or sticks well within its friction cone. There the choice of modes
    /// finds those that are there already.
    #[inline(always)]
    pub fn modes_certain(&self, now: &Evaluation<R>, contacts: &Contacts<R>) -> Bits {
        let within = R::constant(1.0 - MARGIN);
        let mut certain = Bits::MAX;
        for i in 0..2 {
            let (along, across) = (now.multipliers[i], now.multipliers[2 + i]);
            let sticks = across.abs().less((within * self.friction[i]) * along);
            certain &= contacts.free[i] | sticks & !(contacts.slip(i) | contacts.graze[i]);
        }
        certain
    }

    /// The lanes in which a tip is free and beyond the end of its side.
    #[inline(always)]
    pub fn beyond(&self, now: &Evaluation<R>, contacts: &Contacts<R>, i: usize) -> Bits {
        if contacts.free[i] == 0 {
            0
        } else {
            contacts.free[i] & self.half_height[i].less(now.contact_heights[i].abs())
        }
    }

    /// The lanes in which an event of unilateral contact may be due.
    #[inline(always)]
    pub fn due(&self, now: &Evaluation<R>, contacts: &Contacts<R>) -> Bits {
        let mut found = 0;
        for i in 0..2 {
            self.conditions(now, Some(contacts), i, false, |condition| {
                if let Failure::Event(_) = condition.failure {
                    found |= condition.fails();
                }
            });
        }
        found
    }
}

task! {
    /// How far an instant is from the loss of the grasp: the least distance to all that makes the grasp not hold, with the
    /// violations in `stop_on`; and by how much it would hold if a unilateral run ended there. Forces count in E a^2 of the
    /// tip, lengths in its radius a, and tilts in 90 degrees. Separation has no distance: a tip pulls before it.
    pub(crate) ['a, R: Lanes]
    Margins<'a, R>(limits: &'a Limits<R>, now: &'a Evaluation<R>, contacts: Option<&'a Contacts<R>>,
        stop_on: ViolationSet, memory: &'a mut Memory<R>, seen: Bits)
    for R => () = {
        let (one, infinity, per_tilt) = (R::constant(1.0), R::constant(f64::INFINITY), R::constant(std::f64::consts::FRAC_2_PI));
        let (mut least, mut at_end) = (infinity, infinity);
        let stops = |violation| if stop_on.contains(violation) { Bits::MAX } else { 0 };
        let inside = [limits.half_height[0] - now.contact_heights[0].abs(), limits.half_height[1] - now.contact_heights[1].abs()];
        for i in 0..2 {
            let (d_n, radius) = (now.motion.q.compression[i], limits.sides[i].radius);
            let (per_length, per_force) = (one / radius, one / (limits.modulus[i] * (radius * radius)));
            let (force, across) = (now.multipliers[i] * per_force, now.multipliers[2 + i].abs());
            let cone = limits.friction[i].mul_add(force, -across * per_force);
            let (mut touching, mut sticks, mut slips) = (Bits::MAX, 0, 0);
            if let Some(contacts) = contacts {
                let both_free = contacts.free[0] & contacts.free[1];
                (touching, slips) = (!contacts.free[i], contacts.slip(i));
                sticks = touching & !(slips | contacts.graze[i]);
                let beside = R::select(both_free, inside[0].max_in(inside[1], R::ALL), inside[i]);
                least = least.min_in(beside * per_length, touching | both_free);
                let gap = now.residuals[i].max_in(-inside[i], R::ALL) * per_length;
                at_end = at_end.min_in(R::select(contacts.free[i], -gap, force), R::ALL);
            } else {
                least = least.min_in(force, R::ALL).min_in(cone, limits.friction[i].less(infinity));
            }
            least = least.min_in(one - d_n * per_length, touching & stops(Violation::Crushed));
            least = least.min_in(one - now.tilt[i].abs() * per_tilt, touching & stops(Violation::Folded));
            least = least.min_in((limits.rim(now, i) - d_n) * per_length, touching & stops(Violation::Rim));
            least = least.min_in(inside[i] * per_length, touching & stops(Violation::OffFace));
            least = least.min_in(cone, sticks & stops(Violation::Slipping));
            least = least.min_in(force, slips & stops(Violation::Opened));
        }
        take_margins(memory, [least, at_end], seen)
    }
}

/// Half the length of a side: of its height, or of the arc between its ends.
#[inline(always)]
pub(super) fn half_length<R: Real>(source: &impl Source<R>, i: usize) -> R {
    let half = R::constant(0.5);
    match source.kinds().shape(i) {
        _ if !R::ANY_PARTS => source.number(|p| 0.5 * p.grasped.height),
        ShapeKind::ParallelFace => source.number(|p| 0.5 * p.grasped.height),
        ShapeKind::Face => source.number(|p| 0.5 * p.shapes[i].height),
        ShapeKind::Arc => half * source.number(|p| p.shapes[i].span) * source.number(|p| p.shapes[i].radius),
    }
}

#[inline(always)]
fn curvature<R: Real>(source: &impl Source<R>, i: usize) -> R {
    if R::ANY_PARTS && source.kinds().shape(i) == ShapeKind::Arc {
        R::constant(1.0) / source.number(|p| p.shapes[i].radius)
    } else {
        R::zero()
    }
}

task! {
    /// The point at which a tip seems to leave the object, to be pressed flat or to fold, and then to come back
    /// between two states. It is a share of the step of length `h` between them. It is found on the cubic through
    /// values and rates at both ends, because a step may be long. This is rare, so the code is called.
    pub(crate) ['a]
    ViolatingTurningPoint<'a>(parameters: &'a Parameters, ends: [&'a Motion<f64>; 2], h: f64) for f64 => Option<f64> = {
        let ([before, after], sides) = (ends, Side::both(parameters));
        for i in 0..2 {
            let a = parameters.tips[i].radius;
            let tilt = |motion: &Motion<f64>| {
                (sides[i].tilt::<Any>(i, &motion.q).0, sides[i].tilt_rate(i, &motion.q, &motion.p))
            };
            let compression = |motion: &Motion<f64>| (motion.q.compression[i], motion.p.compression[i]);
            let compression = turning_point(compression(before), compression(after), h);
            let tilt = turning_point(tilt(before), tilt(after), h);
            let found = compression
                .filter(|&(_, value)| value < -SEPARATION * a || value >= a)
                .or(tilt.filter(|&(_, value)| value.abs() >= std::f64::consts::FRAC_PI_2));
            if let Some((x, _)) = found {
                return Some(x);
            }
        }
        None
    }
}

/// Explains, with numbers, why a run ends on `violation` at an instant. `begins` is true at the first instant
/// of the run.
pub(crate) fn explain(
    parameters: &Parameters,
    violation: Violation,
    begins: bool,
    instant: &Instant,
) -> String {
    let Instant { motion, multipliers, contact, .. } = instant;
    let Motion { q, p, .. } = motion;
    let t = seconds(instant.t);
    let geometry = Geometry::of_scene(parameters, q, p);
    let limits = Limits::<f64>::new(parameters);
    let state = Evaluation::of_contacts(motion, multipliers, &geometry, [0.0; 2]);
    let mut i = 1;
    limits.conditions(&state, None, 0, false, |condition| {
        if matches!(condition.failure, Failure::Violation(own) if own == violation) && condition.fails() != 0
        {
            i = 0;
        }
    });
    let (side, radius, friction) = (SIDES[i], parameters.tips[i].radius, limits.friction[i]);
    let Contact { tilt, sin_tilt, place, .. } = &geometry.contacts[i];
    let (d_n, normal, tangential) = (q.compression[i], multipliers[i], multipliers[2 + i]);
    let extreme = if begins { START } else { RUNAWAY };
    match violation {
        Violation::Separated => {
            let advice = if d_n < -2.0 * radius {
                extreme
            } else {
                "; targets that close the fingers further, a firmer grasp or gentler disturbances and moves would keep it, or shorter steps where \
                 these are longer than max_stable_dt"
            };
            format!("the {side} fingertip left the object at t = {t} (d_n = {d_n:.3e} m){advice}")
        }
        Violation::Crushed => {
            let advice = if d_n > 2.0 * radius {
                extreme
            } else {
                "; a stiffer or larger tip, targets that close the fingers less, or gentler disturbances and moves would keep it whole, or shorter \
                 steps where these are longer than max_stable_dt"
            };
            format!(
                "the {side} fingertip was crushed at t = {t} (d_n = {d_n:.3e} m, its radius is {radius:.3e} m){advice}"
            )
        }
        Violation::Folded => {
            let degrees = tilt.to_degrees();
            let advice = if degrees.abs() > 180.0 { extreme } else { "" };
            format!(
                "the {side} fingertip folded at t = {t} (theta_p = {degrees:.2} degrees, the limit is 90){advice}"
            )
        }
        Violation::Pulling => format!(
            "the {side} fingertip would have to pull at t = {t} (lambda^H = {normal:.3e} N); a real tip would lift off the object"
        ),
        Violation::Slipping if contact.is_some() => format!("a fingertip slipped at t = {t}"),
        Violation::Slipping => format!(
            "the {side} fingertip would slip at t = {t} (|lambda^N| = {:.3e} N, and friction {friction} holds up to mu lambda^H = \
             {:.3e} N)",
            tangential.abs(),
            friction * normal
        ),
        Violation::Opened => format!("a fingertip left the object at t = {t}"),
        Violation::Rim => format!(
            "the contact of the {side} fingertip reached the rim of its hemisphere at t = {t} (sin |theta_p| = {:.4}, with d_n = {d_n:.3e} m \
             the rim is at {:.4})",
            sin_tilt.abs(),
            sin_tilt.abs() + (limits.rim(&state, i) - d_n) / radius
        ),
        Violation::OffFace => format!(
            "the contact of the {side} fingertip left the face at t = {t} (|G| = {:.3e} m, half the height is {:.3e} m)",
            place.abs(),
            limits.half_height[i]
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f = 1 - 4 x + 7 x^2 - 2 x^3 over h = 0.5: its derivative is zero at (7 - sqrt(25)) / 6 = 1/3.
    #[test]
    fn a_turning_point_between_two_instants_is_found() {
        let (x, value) = turning_point((1.0, -4.0 / 0.5), (2.0, 4.0 / 0.5), 0.5).unwrap();
        assert!((x - 1.0 / 3.0).abs() < 1e-15, "{x}");
        assert!((value - (1.0 - 4.0 / 3.0 + 7.0 / 9.0 - 2.0 / 27.0)).abs() < 1e-15, "{value}");
        let other = turning_point((-1.0, 4.0 / 0.5), (-2.0, -4.0 / 0.5), 0.5).unwrap();
        assert_eq!(other, (x, -value));
        assert!(turning_point((1.0, 1.0), (2.0, 3.0), 0.5).is_none());
        assert!(turning_point((1.0, 0.0), (2.0, 0.0), 0.5).is_none());
    }
}
