//! The equations of unilateral contact as the search for events uses them: for one run, after the choice of
//! its fingers.

use crate::formulation::equations::{Equations, States};
use crate::formulation::impact::{Impact, impact};
use crate::formulation::unilateral::{ContactTerms, Unilateral};
use crate::model::contact_modes::Contacts;
use crate::model::control::Controller;
use crate::model::drive::Input;
use crate::model::geometry::{Geometry, Side};
use crate::model::motion::Motion;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::simd::level::Instructions;

/// The equations of one run with unilateral contact.
pub trait ContactEquations {
    /// All terms at one state, in the modes of the contacts.
    fn terms(&self, input: &Input<f64>, contacts: &Contacts<f64>, motion: &Motion<f64>) -> ContactTerms<f64>;

    /// The velocities `p` after an impact of the contacts that are `closed`, with an impulse on the object.
    fn impact(&self, geometry: &Geometry<f64>, p: &[f64; 9], closed: [bool; 2], impulse: [f64; 3]) -> Impact;

    /// The state of a motion, with works of zero.
    fn begin(&self, motion: &Motion<f64>) -> States<f64>;

    /// The motion of a state.
    fn motion(&self, input: &Input<f64>, y: &States<f64>) -> Motion<f64>;

    /// The sum of the energies of a motion, J.
    fn energy(&self, contacts: &Contacts<f64>, motion: &Motion<f64>) -> f64;

    /// The lengths of both sides.
    fn sides(&self) -> &[Side<f64>; 2];

    /// The diagonal of the mass matrix (14).
    fn masses(&self) -> &[f64; 9];

    /// mu of both contacts.
    fn friction(&self) -> [f64; 2];
}

/// The equations with the instructions for which their long computations are compiled.
pub(super) struct Called<'a, K>(pub(super) Instructions, pub(super) &'a Unilateral<f64, K>);

/// Computes the terms at one state.
struct Terms<'a, K>(&'a Unilateral<f64, K>, &'a Input<f64>, &'a Contacts<f64>, &'a Motion<f64>);

impl<K: Controller<f64>> LaneTask<f64> for Terms<'_, K> {
    type Output = ContactTerms<f64>;

    #[inline(always)]
    fn run(self) -> ContactTerms<f64> {
        self.0.terms(self.1, self.2, self.3)
    }
}

/// Computes an impact.
struct Collision<'a, K>(&'a Unilateral<f64, K>, (&'a Geometry<f64>, &'a [f64; 9]), ([bool; 2], [f64; 3]));

impl<K: Controller<f64>> LaneTask<f64> for Collision<'_, K> {
    type Output = Impact;

    #[inline(always)]
    fn run(self) -> Impact {
        let Self(equations, (geometry, p), (closed, impulse)) = self;
        impact(geometry, equations.plant(), p, (closed, equations.friction()), impulse)
    }
}

impl<K: Controller<f64>> ContactEquations for Called<'_, K> {
    fn terms(&self, input: &Input<f64>, contacts: &Contacts<f64>, motion: &Motion<f64>) -> ContactTerms<f64> {
        f64::call(self.0, Terms(self.1, input, contacts, motion))
    }

    fn impact(&self, geometry: &Geometry<f64>, p: &[f64; 9], closed: [bool; 2], impulse: [f64; 3]) -> Impact {
        f64::call(self.0, Collision(self.1, (geometry, p), (closed, impulse)))
    }

    fn begin(&self, motion: &Motion<f64>) -> States<f64> {
        self.1.begin(motion)
    }

    fn motion(&self, input: &Input<f64>, y: &States<f64>) -> Motion<f64> {
        self.1.motion(input, y)
    }

    fn energy(&self, contacts: &Contacts<f64>, motion: &Motion<f64>) -> f64 {
        self.1.energies(contacts, motion).total()
    }

    fn sides(&self) -> &[Side<f64>; 2] {
        &self.1.plant().sides
    }

    fn masses(&self) -> &[f64; 9] {
        &self.1.plant().masses
    }

    fn friction(&self) -> [f64; 2] {
        self.1.friction()
    }
}
