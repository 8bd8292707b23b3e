//! The choice of the contacts' modes: at the start of a run, at breakpoints, after impacts and at events.
//!
//! For each combination of candidates the equations are solved. A combination is consistent if every contact
//! fulfils the conditions of its mode, and admissible if the determinant of the solve is positive as well:
//! solutions of the wrong orientation are unstable, and no compliant contact tends to them. Combinations are
//! tried in the order of the fingers that they change, then stick, slip, graze, free. On a border, where
//! several are consistent up to round-off, the first one is taken that is still consistent a moment later.

use crate::error::{Error, Result};
use crate::formulation::{ContactEquations, Equations, Terms};
use crate::model::{ContactRow, Contacts, Input, Mode, Motion, Rule, Slip};

/// A contact before its mode is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    pub mode: Mode,
    /// Whether it is closed now: a free tip that has just met the face is, and a contact that an impact opens is not.
    pub closed: bool,
    /// The direction in which a closed contact slips; `None` if its slip velocity counts as zero.
    pub slip: Option<Slip>,
    /// The tilt that is frozen while the tip is free, rad.
    pub frozen_tilt: f64,
    /// The mode that an event has just ended, which is no candidate.
    pub left: Option<Mode>,
}

impl Contact {
    /// A contact that touches the object without slipping.
    pub fn touching() -> Self {
        Self { mode: Mode::Stick, closed: true, slip: None, frozen_tilt: 0.0, left: None }
    }

    /// The contacts of a row. The error names the entry that is none of the codes.
    pub fn of_row([right, left, right_tilt, left_tilt]: &ContactRow) -> Result<[Self; 2]> {
        let one = |k: usize, code: f64, frozen_tilt: f64| {
            let slip = match code {
                2.0 | 4.0 => Some(Slip::Up),
                -2.0 | -4.0 => Some(Slip::Down),
                _ => None,
            };
            let mode = match (code.abs(), slip) {
                (0.0, _) => Mode::Free,
                (1.0, _) if code > 0.0 => Mode::Stick,
                (2.0, Some(direction)) => Mode::Slip(direction),
                (3.0, _) if code > 0.0 => Mode::Graze,
                (4.0, _) => Mode::Graze,
                _ => {
                    let field = format_args!("initial.contact[{k}]");
                    return Err(Error::field(field, code, "must be 0, 1, 2, -2, 3, 4 or -4"));
                }
            };
            let frozen_tilt = Rule::Finite.check(format_args!("initial.contact[{}]", 2 + k), frozen_tilt)?;
            Ok(Self { mode, closed: mode.is_closed(), slip, frozen_tilt, left: None })
        };
        Ok([one(0, *right, *right_tilt)?, one(1, *left, *left_tilt)?])
    }

    pub fn row([right, left]: &[Self; 2]) -> ContactRow {
        [right.signed_code(), left.signed_code(), right.frozen_tilt, left.frozen_tilt]
    }

    fn signed_code(&self) -> f64 {
        let sign = self.slip.map_or(1.0, Slip::sign);
        match self.mode {
            Mode::Graze if self.slip.is_some() => 4.0 * sign,
            mode => f64::from(mode.code()) * sign,
        }
    }

    /// The modes that may be chosen, in the order of preference.
    fn candidates(&self) -> Vec<Mode> {
        if !self.closed {
            return vec![Mode::Free];
        }
        let mut modes = match self.slip {
            None => vec![Mode::Stick, Mode::Slip(Slip::Up), Mode::Slip(Slip::Down)],
            Some(direction) => vec![Mode::Slip(direction)],
        };
        modes.extend([Mode::Graze, Mode::Free]);
        modes.retain(|&mode| Some(mode) != self.left);
        modes
    }
}

/// Conditions that fail by less than this share of their terms count as a border.
const BORDER: f64 = 1e-9;

/// A tip does not graze if the whole couple changes the gap's acceleration by less than this share of the accelerations
/// at the contact: their round-off would then decide how much of the couple acts. So it is just before the tip has lost its
/// compression, where the couple is zero and the equations of graze have a pole.
const NARROW: f64 = 1e-12;

/// The contacts of one run in given modes at the present tilts. A contact that opens freezes its present tilt.
pub fn contacts_in(modes: [Mode; 2], now: &[Contact; 2], tilts: [f64; 2]) -> Contacts<f64> {
    let tilt = |i: usize| {
        if now[i].mode == Mode::Free && !now[i].closed { now[i].frozen_tilt } else { tilts[i] }
    };
    let mut contacts = Contacts::sticking();
    contacts.set(0, modes, [tilt(0), tilt(1)]);
    contacts
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chosen {
    pub modes: [Mode; 2],
    /// Whether the mode that an event has just ended goes on after all.
    pub returned: bool,
}

/// Chooses the modes of both contacts at a state. `trial` computes the terms a moment later, in the modes that
/// it gets; `None` if it cannot. Returns `None` if no combination is admissible.
///
/// A mode that its own event has just ended is a candidate only if there is no other: residuals that were put
/// into the surface may have delayed its end. On a border all combinations may fail by round-off; then the one
/// that fails least is taken.
pub fn choose(
    equations: ContactEquations<'_>,
    input: &Input<f64>,
    motion: &Motion<f64>,
    now: &[Contact; 2],
    mut trial: impl FnMut(&Contacts<f64>) -> Option<Terms<f64>>,
) -> Option<Chosen> {
    let all = now.map(|contact| Contact { left: None, ..contact });
    let passes = [(now, false), (&all, true)];
    let count = if now == &all { 1 } else { 2 };
    let mut nearest = None;
    for (now, returned) in passes.into_iter().take(count) {
        match first_admissible(equations, input, motion, now, &mut trial) {
            Ok(modes) => return Some(Chosen { modes, returned }),
            Err(border) => nearest = nearest.or(border.map(|modes| Chosen { modes, returned })),
        }
    }
    nearest
}

/// The first combination that is admissible, or admissible a moment later if it is on a border. The error has
/// the one that comes nearest of those on a border.
fn first_admissible(
    equations: ContactEquations<'_>,
    input: &Input<f64>,
    motion: &Motion<f64>,
    now: &[Contact; 2],
    trial: &mut impl FnMut(&Contacts<f64>) -> Option<Terms<f64>>,
) -> Result<[Mode; 2], Option<[Mode; 2]>> {
    let mut combinations = Vec::new();
    for (first, right) in now[0].candidates().into_iter().enumerate() {
        for (second, left) in now[1].candidates().into_iter().enumerate() {
            let changed = usize::from(right != now[0].mode) + usize::from(left != now[1].mode);
            combinations.push(((changed, first + second, first), [right, left]));
        }
    }
    combinations.sort_unstable_by_key(|&(order, _)| order);
    let mut nearest: Option<(f64, [Mode; 2])> = None;
    let tilts = equations.tilts(&motion.q);
    for (_, modes) in combinations {
        let contacts = contacts_in(modes, now, tilts);
        let terms = equations.terms(input, &contacts, motion);
        let margin = margin(equations, &terms, modes, now);
        if margin > BORDER {
            return Ok(modes);
        }
        if margin < -BORDER || margin.is_nan() {
            continue;
        }
        if trial(&contacts).is_some_and(|later| self::margin(equations, &later, modes, now) >= 0.0) {
            return Ok(modes);
        }
        // Of those that hold the first one counts, of those that fail the one that fails least.
        let margin = margin.min(0.0);
        if nearest.is_none_or(|(most, _)| margin > most) {
            nearest = Some((margin, modes));
        }
    }
    Err(nearest.map(|(_, modes)| modes))
}

/// The least margin by which the conditions of all modes hold, as a share of the accelerations at the contact;
/// negative if one fails, or if the solution has the wrong orientation.
fn margin(equations: ContactEquations<'_>, terms: &Terms<f64>, modes: [Mode; 2], now: &[Contact; 2]) -> f64 {
    let oriented = terms.response.pivots.iter().filter(|&&pivot| pivot < 0.0).count() % 2 == 0;
    let finite = terms.response.acceleration.row().iter().all(|a| a.is_finite());
    if !(oriented && finite) {
        return f64::NEG_INFINITY;
    }
    let masses = equations.plant().masses.compression;
    let friction = equations.friction().unwrap_or([f64::INFINITY; 2]);
    let (acceleration, multipliers) = (&terms.response.acceleration, &terms.response.multipliers);
    let (swept, bias) = (&terms.swept, terms.geometry.bias());
    let graze = modes.map(|mode| mode == Mode::Graze);
    let own = |i: usize| {
        // The terms of the accelerations of the gap and of the slip, and those that the multipliers make.
        let mut size = f64::MIN_POSITIVE;
        for (row, own) in [(i, acceleration.compression[i]), (2 + i, acceleration.shear[i])] {
            size += own.abs() + (swept[row] - own).abs() + bias[row].abs();
        }
        let (along, across) = (multipliers[i] / masses[i], multipliers[2 + i].abs() / masses[i]);
        size += along.abs() + across;
        let rate = |row: usize| (swept[row] + bias[row]) / size;
        match modes[i] {
            Mode::Stick => (friction[i] * along - across) / size,
            Mode::Slip(_) if now[i].slip.is_some() => along / size,
            Mode::Slip(direction) => (along / size).min(direction.sign() * rate(2 + i)),
            // The margin of 0 <= psi <= 1.
            Mode::Graze if terms.response.couple_effect(i, graze) < NARROW * size => f64::NEG_INFINITY,
            Mode::Graze => terms.response.share[i].min(1.0 - terms.response.share[i]),
            Mode::Free if !now[i].closed => 1.0,
            Mode::Free => rate(i),
        }
    };
    own(0).min(own(1))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::formulation::csm::Csm;
    use crate::formulation::equations::Equations;
    use crate::formulation::unilateral::Unilateral;
    use crate::model::control::Fingers;
    use crate::model::drive::SegmentDrive;
    use crate::model::forces::Plant;
    use crate::model::parameters::{Fingertip, Friction, Parameters, Stabilization};
    use crate::model::start::{consistent, contact};
    use crate::number::real::signed;

    fn equations(friction: f64, tip_mass: f64) -> Unilateral<f64> {
        let tip = Fingertip { normal_mass: tip_mass, tangential_mass: tip_mass, ..Fingertip::default() };
        let friction = Friction { right: friction, left: friction };
        let parameters = Parameters { friction, tips: [tip; 2], ..Parameters::default() };
        let gains = Stabilization { alpha: 0.0, beta: 0.0 };
        Unilateral::new(
            &parameters,
            Csm::new(Plant::new(&parameters, Fingers::Pid, false), &gains),
            true,
            true,
        )
    }

    fn called(equations: &Unilateral<f64>) -> ContactEquations<'_> {
        ContactEquations::new(&equations.csm, equations.friction, None)
    }

    /// A pressed grasp: fingers closed by `grip`, the object turned and sheared.
    fn grasp(grip: f64, tilt: f64, shear: [f64; 2], velocity: [f64; 5]) -> Motion<f64> {
        let parameters = Parameters::default();
        let start = contact(&parameters).unwrap();
        let [x, y, _] = start.object;
        let pose = [x, y, tilt, grip, grip];
        let (q, p) = consistent(&parameters, &pose, &shear, &velocity);
        Motion { q, p, ..Motion::zero() }
    }

    fn still(target: f64) -> Input<f64> {
        Input { target: [target; 2], ..SegmentDrive::<f64>::still().at(0.0) }
    }

    /// A firm grasp sticks as soon as friction is enough, and slips if there is none. Gravity pulls the object down
    /// over both tips.
    #[test]
    fn a_firm_grasp_sticks_and_one_without_friction_slips_down() {
        let motion = grasp(0.1, 0.0, [0.0; 2], [0.0; 5]);
        let input = still(0.15);
        let choose = |friction| {
            choose(called(&equations(friction, 0.01)), &input, &motion, &[Contact::touching(); 2], |_| None)
                .unwrap()
                .modes
        };
        assert_eq!(choose(0.8), [Mode::Stick; 2]);
        assert_eq!(choose(0.0), [Mode::Slip(Slip::Down); 2]);
    }

    /// Newton's second law for the object, once both of its contacts slip down: M y'' = 2 mu lambda^H - M g.
    #[test]
    fn a_block_that_slides_between_two_tips_accelerates_as_newton_says() {
        let mut motion = grasp(0.1, 0.0, [0.0; 2], [0.0; 5]);
        motion.p.object[1] = -0.2;
        let slips = Contact { slip: Some(Slip::Down), mode: Mode::Slip(Slip::Down), ..Contact::touching() };
        for friction in [0.0, 0.05, 0.3] {
            let equations = equations(friction, 0.01);
            let input = still(0.15);
            let modes = choose(called(&equations), &input, &motion, &[slips; 2], |_| None).unwrap().modes;
            assert_eq!(modes, [Mode::Slip(Slip::Down); 2]);
            let contacts = contacts_in(modes, &[slips; 2], called(&equations).tilts(&motion.q));
            let terms = called(&equations).terms(&input, &contacts, &motion);
            let [right, left, ..] = terms.response.multipliers;
            let object = Parameters::default().grasped;
            let expected = friction * (right + left) / object.mass - 9.81;
            assert!(right > 1.0 && (right - left).abs() < 1e-12);
            assert!((terms.response.acceleration.object[1] - expected).abs() < 1e-12);
            assert_eq!(terms.response.multipliers[2], friction * right);
        }
    }

    /// Without any contact the object falls with g, and so do the tips' surfaces feel nothing of it.
    #[test]
    fn an_object_without_contact_falls() {
        let motion = grasp(0.1, 0.2, [1e-3, -1e-3], [0.1, 0.2, 3.0, 0.4, 0.5]);
        let free = Contact { mode: Mode::Free, closed: false, ..Contact::touching() };
        let equations = equations(0.5, 0.01);
        let input = still(0.15);
        let modes = choose(called(&equations), &input, &motion, &[free; 2], |_| None).unwrap().modes;
        assert_eq!(modes, [Mode::Free; 2]);
        let contacts = contacts_in(modes, &[free; 2], called(&equations).tilts(&motion.q));
        let terms = called(&equations).terms(&input, &contacts, &motion);
        assert_eq!(terms.response.acceleration.object, [0.0, -9.81, 0.0]);
        assert_eq!(terms.response.multipliers, [0.0; 4]);
        assert_eq!(terms.response.share, [0.0; 2]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4096))]

        /// At rest there is always an admissible combination, and it does what its modes say. The solve of the
        /// sticking contacts gives what the general solve gives.
        #[test]
        fn there_is_always_a_combination_and_it_keeps_its_conditions(
            grip in 0.0..0.15_f64,
            tilt in -0.5..0.5_f64,
            shear in prop::array::uniform2(-2e-3..2e-3_f64),
            target in -0.2..0.4_f64,
            friction in 0.0..1.0_f64,
            force in prop::array::uniform3(-100.0..100.0_f64),
        ) {
            let motion = grasp(grip, tilt, shear, [0.0; 5]);
            prop_assume!(motion.q.compression.iter().all(|&d_n| d_n > 1e-4 && d_n < 0.02));
            let equations = equations(friction, 0.01);
            let input = Input { force: [5.0 * force[0], force[1], 0.01 * force[2]], ..still(target) };
            let now = [Contact::touching(); 2];
            let modes = choose(called(&equations), &input, &motion, &now, |_| None);
            prop_assert!(modes.is_some());
            let modes = modes.unwrap().modes;
            let contacts = contacts_in(modes, &now, called(&equations).tilts(&motion.q));
            let terms = called(&equations).terms(&input, &contacts, &motion);
            let response = &terms.response;
            let swept = terms.geometry.phi_times(&response.acceleration);
            let bias = terms.geometry.bias();
            let elastic = equations.plant().elastic(terms.geometry.tips(&motion.q));
            // M a = f + Phi^T lambda + the couples that act.
            let mut force = terms.forces.total(&terms.geometry);
            let push = terms.geometry.phi_transposed_times(&response.multipliers);
            for i in 0..2 {
                let acts = if modes[i] == Mode::Graze { response.share[i] } else { 0.0 };
                force.object[2] -= signed(i, acts * elastic[i].tilt);
                force.finger[i] -= acts * elastic[i].tilt;
            }
            let (masses, acceleration) = (equations.plant().masses.row(), response.acceleration.row());
            let (force, push) = (force.row(), push.row());
            for k in 0..9 {
                let size = force[k].abs() + push[k].abs() + 1.0;
                prop_assert!((masses[k] * acceleration[k] - force[k] - push[k]).abs() < 1e-10 * size);
            }
            for i in 0..2 {
                let (along, across) = (response.multipliers[i], response.multipliers[2 + i]);
                let (gap, slip) = (swept[i] + bias[i], swept[2 + i] + bias[2 + i]);
                let size = 1e-9 * (1.0 + swept[i].abs() + swept[2 + i].abs());
                match modes[i] {
                    Mode::Stick => {
                        prop_assert!(across.abs() <= friction * along * (1.0 + 1e-9));
                        prop_assert!(gap.abs() < size && slip.abs() < size);
                    }
                    Mode::Slip(direction) => {
                        prop_assert!(along >= 0.0 && gap.abs() < size);
                        prop_assert!((across + direction.sign() * friction * along).abs() < 1e-9 * (1.0 + along));
                        prop_assert!(direction.sign() * slip >= -size);
                    }
                    Mode::Graze => {
                        prop_assert_eq!((along, across), (0.0, 0.0));
                        prop_assert!((0.0..=1.0).contains(&response.share[i]) && gap.abs() < size);
                    }
                    Mode::Free => {
                        prop_assert_eq!((along, across), (0.0, 0.0));
                        prop_assert!(gap >= -size);
                    }
                }
            }
        }
    }
}
