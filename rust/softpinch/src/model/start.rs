//! Initial states: straight fingers at or in the object, tips that just touch it, driven fingers, and any
//! pose on the constraints.

use crate::error::Error;
use crate::model::contact::Side;
use crate::model::contact::law;
use crate::model::contact::mechanism::Mechanism;
use crate::model::{
    ContactModel, ContactRow, Coordinates, Finger, Fingertip, Geometry, Input, Inputs, Linearized,
    MechanismKind, Motion, Papers, Parameters, RELAXATIONS, SIDES, Source, Surface,
};
use crate::names::named;
use crate::number::{LaneTask, Real, task};

/// A gap below this share of the tip's radius counts as round-off.
const GAP: f64 = 1e-9;
/// Residuals up to this share of the tip's radius, or of the terms of a rate, count as consistent.
const CONSISTENCY: f64 = 1e-6;
/// Most steps of a tip towards the object, in the search for the coordinate at which it touches.
const ADVANCES: usize = 10_000;
/// Round-off of the lengths that a residual is made of counts as consistent too; it matters if they dwarf the
/// tip.
const ROUND_OFF: f64 = 1e-13;

/// The state that a run begins with.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Time on the clock of schedule and disturbances, s.
    pub time: f64,
    /// The motion. The memories of PID controllers are the integrals of the angles' errors, rad s.
    pub motion: Motion<f64>,
    /// Start of the segment that the state lies in, and number of steps since then, so that a resumed run
    /// takes the same steps.
    pub grid: Option<(f64, u64)>,
    /// The point at which the Jacobian in use was taken, for implicit methods.
    pub linearized: Option<Linearized>,
    /// The contacts of unilateral contact; `None` if they follow from q and p.
    pub contact: Option<ContactRow>,
    /// The state of a discrete controller as a row (`ControllerState`);
    /// `None` for one that starts here.
    pub controller: Option<Vec<f64>>,
}

impl State {
    /// A state at rest at time zero.
    pub fn at_rest(q: Coordinates) -> Self {
        Self {
            time: 0.0,
            motion: Motion { q, ..Motion::zero() },
            grid: None,
            linearized: None,
            contact: None,
            controller: None,
        }
    }

    /// The instant at which its discrete controller started, or starts, s.
    pub fn origin(&self) -> f64 {
        self.controller.as_ref().and_then(|row| row.first().copied()).unwrap_or(self.time)
    }
}

/// The states of branches that have relaxed at these coordinates: r = F(d_n) and zeta = d_t.
pub fn relaxed<R: Real>(source: &impl Source<R>, q: &Coordinates<R>) -> [R; RELAXATIONS] {
    let mut states = [R::zero(); RELAXATIONS];
    for k in 0..source.kinds().branches() {
        for i in 0..2 {
            states[4 * k + i] = law::force(source, i, q.compression[i]);
            states[4 * k + 2 + i] = q.shear[i];
        }
    }
    states
}

/// Coordinates with the fingers at `angles`, the object upright in the middle at the mean height of the tips,
/// and the compressions that follow from C^H = 0.
fn upright(parameters: &Parameters, angles: [f64; 2]) -> Coordinates {
    if !parameters.has_the_papers_geometry() {
        return upright_between(parameters, angles, angles);
    }
    let heights = [0, 1].map(|i| {
        let Finger { length, half_thickness, .. } = parameters.fingers[i];
        length * libm::cos(angles[i]) - half_thickness * libm::sin(angles[i])
    });
    let object = [parameters.grasped.com_offset, 0.5 * (heights[0] + heights[1]), 0.0];
    let mut q = Coordinates { object, finger: angles, ..Coordinates::zero() };
    let [right, left, ..] =
        Geometry::<f64, Papers>::of(&Side::both(parameters), &q, &Coordinates::zero()).residuals();
    q.compression = [-right, -left];
    q
}

/// The same for any mechanisms and sides, at the mean height of the tips above the apexes of the sides where the fingers
/// have the coordinates `level`.
#[inline(always)]
fn upright_between<R: Real>(source: &impl Source<R>, finger: [R; 2], level: [R; 2]) -> Coordinates<R> {
    R::outlined(UprightBetween { source, finger, level })
}

task! {
    ['a, R: Real, S: Source<R>] UprightBetween<'a, R, S>(source: &'a S, finger: [R; 2], level: [R; 2])
    for R => Coordinates<R> = {
        let (zero, half) = (R::zero(), R::constant(0.5));
        let (mut heights, mut apexes) = ([zero; 2], [[zero; 2]; 2]);
        for i in 0..2 {
            apexes[i] = Surface::new(source, i).apex;
            heights[i] = Mechanism::new(source, i).placed(level[i]).centre[1] - apexes[i][1];
        }
        let (x, y) = (half * (-apexes[0][0] - apexes[1][0]), half * (heights[0] + heights[1]));
        let mut q = Coordinates { object: [x, y, zero], finger, ..Coordinates::zero() };
        let [right, left, ..] = Geometry::<R>::of(&Side::both(source), &q, &Coordinates::zero()).residuals();
        q.compression = [-right, -left];
        q
    }
}

named! {
    /// The starts that follow from a scene's parameters and inputs, in bilateral contact.
    Start;
    /// These starts by their public names.
    STARTS = {
        /// [`contact`].
        Contact = "contact",
        /// [`touching`].
        Touching = "touching",
        /// [`driven`].
        Driven = "driven",
        /// A given motion, in which branches have [`relaxed`].
        Relaxed = "relaxed",
    }
}

impl Start {
    /// The derivatives of a start, but for branches, in the directions of the parameters and of the inputs at its instant.
    /// `q` has its coordinates.
    #[inline(always)]
    pub fn varied<R: Real>(self, source: &impl Source<R>, input: &Input<R>, q: &Coordinates) -> Motion<R> {
        let zero = R::zero();
        let (mut finger, given) = ([zero; 2], q.compression);
        match self {
            Self::Contact => {}
            Self::Driven => finger = input.target,
            Self::Relaxed => return Motion::constant(&Motion { q: *q, ..Motion::zero() }),
            Self::Touching => {
                // One step of Newton's method from the solution, for what `coordinate_at` solves.
                let at = q.finger.map(R::constant);
                let middle = Coordinates { compression: [zero; 2], ..upright_between(source, at, [zero; 2]) };
                let rates = Coordinates { finger: [R::constant(1.0); 2], ..Coordinates::zero() };
                let geometry = Geometry::<R>::of(&Side::both(source), &middle, &rates);
                let (gaps, slopes) = (geometry.residuals(), geometry.constraint_velocity());
                for i in 0..2 {
                    finger[i] = at[i] - gaps[i] / slopes[i];
                }
            }
        }
        let middle = self == Self::Touching && !source.kinds().has_the_papers_geometry();
        let mut q = upright_between(source, finger, if middle { [zero; 2] } else { finger });
        for i in 0..2 {
            // A tip that does not reach the object is not compressed.
            let gap = source.number(|p| -GAP * p.tips[i].radius);
            if given[i] == 0.0 && q.compression[i].less(gap) != 0 {
                q.compression[i] = zero;
            }
        }
        let mut p = Coordinates::zero();
        if self == Self::Driven {
            p.finger = input.target_rate;
            let mut pressed = q;
            Geometry::<R>::constrained(&Side::both(source), &mut pressed, &mut p);
        }
        Motion { q, p, ..Motion::zero() }
    }
}

/// Straight fingers at rest, in point contact, or pressed if the object is wider than the space between the
/// tips.
pub fn contact(parameters: &Parameters) -> Result<Coordinates, Error> {
    let q = upright(parameters, [0.0; 2]);
    require_reach(parameters, &q, false)?;
    Ok(q)
}

/// Straight fingers at rest, pressed if the object is wider than the space between the tips. Tips that do not
/// reach the object are not compressed.
pub fn apart(parameters: &Parameters) -> Result<Coordinates, Error> {
    let mut q = upright(parameters, [0.0; 2]);
    q.compression = q.compression.map(|d_n| d_n.max(0.0));
    Ok(q)
}

/// Refuses tips that do not reach the object.
fn require_reach(parameters: &Parameters, q: &Coordinates, driven: bool) -> Result<(), Error> {
    for (i, finger) in SIDES.into_iter().enumerate() {
        if q.compression[i] < -GAP * parameters.tips[i].radius {
            let touches = touching(parameters)?.finger[i];
            let (touches, unit) = match parameters.mechanism(i) {
                MechanismKind::Jaw => (1e3 * touches, "mm"),
                _ => (touches.to_degrees(), "degrees"),
            };
            return Err(Error::Gap { finger, gap_mm: -1e3 * q.compression[i], touches, unit, driven });
        }
    }
    Ok(())
}

/// The coordinate at which the tip of finger `i` is compressed by `compression` on an upright object in the middle, as far
/// as the finger reaches.
pub fn coordinate_at(parameters: &Parameters, i: usize, compression: f64) -> Option<f64> {
    if parameters.has_the_papers_geometry() {
        return angle_at(&parameters.fingers[i], &parameters.tips[i], parameters.grasped.width, compression);
    }
    let mut q = upright_between(parameters, [0.0; 2], [0.0; 2]);
    q.compression = [compression; 2];
    let rates = Coordinates { finger: [1.0; 2], ..Coordinates::zero() };
    // The tip comes from outside. No way of the centre is longer than that of its coordinate times the lever, so that no
    // step passes the first contact (conservative advancement); Newton's method ends.
    let lever = parameters.lever(i);
    let far = match parameters.mechanism(i) {
        MechanismKind::Jaw => q.object[0].abs() + q.object[1].abs() + parameters.reach(i),
        _ => std::f64::consts::FRAC_PI_2,
    };
    q.finger[i] = -far;
    for _ in 0..ADVANCES {
        let geometry = Geometry::of_scene(parameters, &q, &rates);
        let (gap, slope) = (geometry.residuals()[i], geometry.constraint_velocity()[i]);
        let newton = -gap / slope;
        let near = gap.abs() < 1e-2 * parameters.tips[i].radius && slope < 0.0;
        let step = if near { newton } else { gap / lever };
        if near && step.abs() * lever <= f64::EPSILON * parameters.reach(i) {
            return Some(q.finger[i] + step);
        }
        q.finger[i] += step;
        if !q.finger[i].is_finite() || q.finger[i] > far {
            break;
        }
    }
    // Where links are almost level, round-off of the gap is a long step.
    let gap = Geometry::of_scene(parameters, &q, &rates).residuals()[i];
    (gap.abs() <= 4.0 * f64::EPSILON * parameters.reach(i)).then_some(q.finger[i])
}

/// The angle of the paper's finger, from its triangle.
fn angle_at(finger: &Finger, tip: &Fingertip, width: f64, compression: f64) -> Option<f64> {
    let (distance, reach) = span(finger, tip, width);
    let distance = distance + compression;
    (distance.abs() <= reach)
        .then(|| libm::asin(distance / reach) - libm::atan2(finger.half_thickness, finger.length))
}

/// The distance between root and face that the tip leaves, and the longest that the finger can bridge:
/// L sin theta + d_f cos theta = reach sin(theta + lead).
fn span(finger: &Finger, tip: &Fingertip, width: f64) -> (f64, f64) {
    ((finger.root_offset - tip.radius) - 0.5 * width, libm::hypot(finger.length, finger.half_thickness))
}

/// Fingers turned until both tips just touch the upright object.
pub fn touching(parameters: &Parameters) -> Result<Coordinates, Error> {
    let (mut angles, papers) = ([0.0; 2], parameters.has_the_papers_geometry());
    for i in 0..2 {
        angles[i] = coordinate_at(parameters, i, 0.0).ok_or_else(|| {
            if !papers {
                return Error::Untouched { finger: SIDES[i] };
            }
            let (distance, reach) =
                span(&parameters.fingers[i], &parameters.tips[i], parameters.grasped.width);
            Error::OutOfReach { finger: SIDES[i], distance_mm: 1e3 * distance, reach_mm: 1e3 * reach }
        })?;
    }
    Ok(if papers { upright(parameters, angles) } else { upright_between(parameters, angles, [0.0; 2]) })
}

/// Driven fingers at the angles that the schedule has at time `t`, and the object upright, at rest and
/// pressed by them. In unilateral contact tips that do not reach the object are not compressed.
pub fn driven(
    parameters: &Parameters,
    inputs: &Inputs,
    t: f64,
    contact: ContactModel,
) -> Result<State, Error> {
    let Input { target, target_rate, .. } = inputs.segment(t).at(0.0);
    let mut q = upright(parameters, target);
    if contact == ContactModel::Bilateral {
        require_reach(parameters, &q, true)?;
    }
    let (mut pressed, mut p) = (q, Coordinates { finger: target_rate, ..Coordinates::zero() });
    Geometry::constrain_scene(parameters, &mut pressed, &mut p);
    for i in 0..2 {
        if q.compression[i] < -GAP * parameters.tips[i].radius {
            (q.compression[i], p.compression[i], p.shear[i]) = (0.0, 0.0, 0.0);
        }
    }
    Ok(State { time: t, motion: Motion { q, p, ..Motion::zero() }, ..State::at_rest(q) })
}

/// Refuses an initial state in which driven fingers are not where the schedule has them. Round-off is
/// allowed.
pub fn require_scheduled(parameters: &Parameters, inputs: &Inputs, initial: &State) -> Result<(), Error> {
    let Input { target, target_rate, .. } = inputs.segment(initial.time).at(0.0);
    let Motion { q: sizes, p: paces, .. } = Motion::typical_magnitudes(parameters);
    let pace = paces.finger[0].max(target_rate[0].abs()).max(target_rate[1].abs());
    let Motion { q, p, .. } = &initial.motion;
    for (name, found, asked, size) in [("q", q, target, sizes.finger[0]), ("p", p, target_rate, pace)] {
        for i in 0..2 {
            let (value, asked) = (found.finger[i], asked[i]);
            let off = (value - asked).abs();
            if off.is_nan() || off > CONSISTENCY * size {
                return Err(Error::Unscheduled { place: format!("initial.{name}[{}]", 3 + i), value, asked });
            }
        }
    }
    Ok(())
}

/// The state on the constraints with this pose (x, y, theta, theta_1, theta_2), shear and velocity of the
/// pose: d_n follows from C^H = 0 (9), and the rates of d_n and d_t follow from Phi p = 0 (25).
pub fn consistent(
    parameters: &Parameters,
    pose: &[f64; 5],
    shear: &[f64; 2],
    velocity: &[f64; 5],
) -> (Coordinates, Coordinates) {
    let [mut q, mut p] = [pose, velocity].map(|&[x, y, theta, right, left]| Coordinates {
        object: [x, y, theta],
        finger: [right, left],
        ..Coordinates::zero()
    });
    q.shear = *shear;
    Geometry::constrain_scene(parameters, &mut q, &mut p);
    (q, p)
}

/// Refuses a state whose constraint residuals are larger than round-off.
pub fn require_consistent(parameters: &Parameters, q: &Coordinates, p: &Coordinates) -> Result<(), Error> {
    require_held(parameters, q, p, |_, _| true)
}

/// The same for the constraints C_i^H (kind 0) and C_i^N (kind 1) that `held` names by kind and finger.
pub fn require_held(
    parameters: &Parameters,
    q: &Coordinates,
    p: &Coordinates,
    held: impl Fn(usize, usize) -> bool,
) -> Result<(), Error> {
    let geometry = Geometry::of_scene(parameters, q, p);
    let residuals = geometry.residuals();
    let drift = geometry.constraint_velocity();
    let allowed = allowed_residuals(parameters, &geometry, q, p);
    for i in 0..2 {
        let [place, normal, tangential] = allowed[i];
        if held(0, i) {
            within(["C_1^H", "C_2^H"][i], residuals[i], "m", place)?;
            within(["the rate of C_1^H", "the rate of C_2^H"][i], drift[i], "m/s", normal)?;
        }
        if held(1, i) {
            within(["C_1^N", "C_2^N"][i], drift[2 + i], "m/s", tangential)?;
        }
    }
    Ok(())
}

/// For each finger the largest C^H, rate of C^H and C^N that count as round-off.
pub fn allowed_residuals(
    parameters: &Parameters,
    geometry: &Geometry<f64>,
    q: &Coordinates,
    p: &Coordinates,
) -> [[f64; 3]; 2] {
    let ([x, y, _], [u, v, omega]) = (q.object.map(f64::abs), p.object.map(f64::abs));
    std::array::from_fn(|i| {
        let tip = &parameters.tips[i];
        let arm = parameters.lever(i);
        let mut reach = x + y + parameters.reach(i);
        if parameters.mechanism(i) == MechanismKind::Jaw {
            reach += q.finger[i].abs();
        }
        let place = CONSISTENCY * tip.radius + ROUND_OFF * reach;
        let contact = &geometry.contacts[i];
        let turn = p.finger[i].abs();
        let moving = u + v + arm * turn;
        let round_off = ROUND_OFF * reach * (omega + turn);
        let normal = moving + (contact.a * omega).abs() + p.compression[i].abs();
        let tangential = moving + (contact.e * omega).abs() + (contact.f * turn).abs() + p.shear[i].abs();
        [place, CONSISTENCY * normal + round_off, CONSISTENCY * tangential + round_off]
    })
}

fn within(constraint: &'static str, value: f64, unit: &'static str, allowed: f64) -> Result<(), Error> {
    // This comparison refuses NaN as well.
    if value.abs() <= allowed {
        Ok(())
    } else {
        Err(Error::Inconsistent { constraint, value, unit, allowed })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::control::Fingers;
    use crate::model::parameters::{PAPERS, PARAMETER_COUNT};
    use crate::model::source::{DIRECTIONS, VariedParameters};
    use crate::number::dual::Dual;

    /// A hand without any symmetry, and an object that is wider than the space between the tips. Each number is changed by
    /// its own share.
    fn uneven(shares: &[f64]) -> Parameters {
        let mut values = Parameters::default();
        values.grasped.width = 0.062;
        values.grasped.com_offset = 0.003;
        values.fingers[1].length = 0.07;
        let mut values = values.to_array();
        for (value, share) in values.iter_mut().zip(shares).take(PAPERS) {
            *value *= 1.0 + 0.05 * share;
        }
        Parameters::from_array(&values).unwrap()
    }

    fn shares() -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec(-1.0..1.0_f64, PARAMETER_COUNT)
    }

    proptest! {
        /// A consistent state has its pose, its shears and its velocity, and no residual; a state that is moved off the
        /// constraints is refused.
        #[test]
        fn a_consistent_state_is_on_the_constraints_and_one_beside_it_is_refused(
            shares in shares(),
            pose in prop::array::uniform5(-1.0..1.0_f64),
            shear in prop::array::uniform2(-1e-3..1e-3_f64),
            velocity in prop::array::uniform5(-1.0..1.0_f64),
            moved in 0..4_usize,
        ) {
            let parameters = uneven(&shares);
            let pose = [0.01 * pose[0], 0.07 + 0.01 * pose[1], 0.3 * pose[2], 0.3 * pose[3], 0.3 * pose[4]];
            let (mut q, mut p) = consistent(&parameters, &pose, &shear, &velocity);
            prop_assert_eq!((&q.row()[..5], q.shear, &p.row()[..5]), (&pose[..], shear, &velocity[..]));
            let geometry = Geometry::<f64>::of(&Side::both(&parameters), &q, &p);
            for number in geometry.residuals().into_iter().chain(geometry.constraint_velocity()) {
                prop_assert!(number.abs() < 1e-15, "{number}");
            }
            prop_assert!(require_consistent(&parameters, &q, &p).is_ok());
            // Both compressions, then both rates of the shears.
            if moved < 2 { q.compression[moved] += 1e-6 } else { p.shear[moved - 2] += 1e-3 }
            prop_assert!(require_consistent(&parameters, &q, &p).is_err());
        }

        /// Fingers that just touch have no compression, and by `angle_at` they have any other one. Pressed fingers are
        /// straight, and where the object is too narrow for them the error says at which angle they touch.
        #[test]
        fn fingers_touch_where_their_geometry_says(shares in shares(), compression in 0.0..0.01_f64) {
            let mut parameters = uneven(&shares);
            let touched = touching(&parameters).unwrap();
            let pressed = contact(&parameters).unwrap();
            prop_assert_eq!(pressed.finger, [0.0; 2]);
            let mut turned = touched;
            for i in 0..2 {
                prop_assert!(touched.compression[i].abs() < 1e-15 && pressed.compression[i] > 0.0);
                let (finger, tip) = (&parameters.fingers[i], &parameters.tips[i]);
                turned.finger[i] = angle_at(finger, tip, parameters.grasped.width, compression).unwrap();
            }
            let geometry = Geometry::<f64>::of(&Side::both(&parameters), &turned, &Coordinates::zero());
            for gap in geometry.residuals().into_iter().take(2) {
                prop_assert!((gap + compression).abs() < 1e-15);
            }
            parameters.grasped.width = 0.04;
            let touches = touching(&parameters).unwrap().finger[0].to_degrees();
            let Err(Error::Gap { touches: found, .. }) = contact(&parameters) else { panic!("they reach it") };
            prop_assert!((found - touches).abs() < 1e-12 && apart(&parameters).unwrap().compression == [0.0; 2]);
        }

        /// The derivatives of every start are those of central differences.
        #[test]
        fn derivatives_of_a_start_agree_with_differences(
            shares in shares(),
            direction in shares(),
            target in prop::array::uniform2(0.0..0.2_f64),
            target_direction in prop::array::uniform2(-1.0..1.0_f64),
        ) {
            const STEP: f64 = 1e-5;
            let parameters = uneven(&shares);
            let values = parameters.to_array();
            let slope: [f64; PARAMETER_COUNT] =
                std::array::from_fn(|k| if values[k].is_finite() { values[k] * direction[k] } else { 0.0 });
            let slopes = [(); DIRECTIONS].map(|()| Parameters::unchecked(&slope));
            let source = VariedParameters { parameters: &parameters, slopes };
            let beside = |by: f64| {
                let parameters = Parameters::unchecked(&std::array::from_fn(|k| values[k] + by * slope[k]));
                (parameters, [0, 1].map(|i| target[i] + by * target_direction[i]))
            };
            let starts = |by: f64| {
                let (parameters, target) = beside(by);
                let inputs = Inputs::constant(target, [0.0; 3], Fingers::Driven);
                let driven = driven(&parameters, &inputs, 0.0, ContactModel::Bilateral).unwrap();
                [contact(&parameters).unwrap(), touching(&parameters).unwrap(), driven.motion.q]
            };
            let (before, now, after) = (starts(-STEP), starts(0.0), starts(STEP));
            let zero = Dual::<f64, 1>::zero();
            let input = Input {
                target: [0, 1].map(|i| Dual { value: target[i], slope: [target_direction[i]] }),
                target_rate: [zero; 2],
                target_acceleration: [zero; 2],
                force: [zero; 3],
                tau: zero,
            };
            for (n, (name, start)) in STARTS.into_iter().take(now.len()).enumerate() {
                let found = start.varied(&source, &input, &now[n]).q.row();
                let [before, now, after] = [before, now, after].map(|starts| starts[n].row());
                for k in 0..9 {
                    let expected = (after[k] - before[k]) / (2.0 * STEP);
                    let Dual { value, slope: [slope] } = found[k];
                    prop_assert!((value - now[k]).abs() < 1e-15, "{name} {k}: {value}");
                    prop_assert!((slope - expected).abs() < 1e-9, "{name} {k}: {slope} {expected}");
                }
            }
        }
    }
}
