//! The equations of unilateral contact as the search for events uses them: for one run, after the choice of
//! its fingers.

use crate::formulation::equations::{Equations, States, Terms};
use crate::formulation::impact::{Impact, impact};
use crate::formulation::unilateral::Unilateral;
use crate::model::contact::Side;
use crate::model::contact_modes::Contacts;
use crate::model::control::{Actuated, Driven};
use crate::model::coordinates::Coordinates;
use crate::model::drive::Input;
use crate::model::geometry::Geometry;
use crate::model::motion::Motion;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::simd::level::Instructions;

/// The equations of one run with unilateral contact, and the instructions for which their long computations are
/// compiled.
#[derive(Debug, Clone, Copy)]
pub enum ContactEquations<'a> {
    /// Fingers that torques turn.
    Actuated(Instructions, &'a Unilateral<f64, Actuated<f64>>),
    /// Fingers that follow their schedule.
    Driven(Instructions, &'a Unilateral<f64, Driven>),
}

/// Evaluates one expression with the equations of either kind of fingers.
macro_rules! with {
    ($contact:expr, ($instructions:pat, $equations:ident) => $body:expr) => {
        match *$contact {
            ContactEquations::Actuated($instructions, $equations) => $body,
            ContactEquations::Driven($instructions, $equations) => $body,
        }
    };
}

/// Computes the terms at one state.
struct TermsAt<'a, E>(&'a E, &'a Input<f64>, &'a Contacts<f64>, &'a Motion<f64>);

impl<E: Equations<f64>> LaneTask<f64> for TermsAt<'_, E> {
    type Output = Terms<f64>;

    #[inline(always)]
    fn run(self) -> Terms<f64> {
        let Self(equations, input, contacts, motion) = self;
        let geometry = Geometry::new(&equations.plant().sides, &motion.q, &motion.p);
        equations.terms(input, contacts, motion, geometry)
    }
}

/// Computes an impact with these frictions.
struct Collision<'a, E> {
    equations: &'a E,
    friction: [f64; 2],
    geometry: &'a Geometry<f64>,
    p: &'a Coordinates,
    closed: [bool; 2],
    impulse: [f64; 3],
}

impl<E: Equations<f64>> LaneTask<f64> for Collision<'_, E> {
    type Output = Impact;

    #[inline(always)]
    fn run(self) -> Impact {
        let Self { equations, friction, geometry, p, closed, impulse } = self;
        impact(geometry, equations.plant(), p, (closed, friction), impulse)
    }
}

/// Computes the part of the constraints' accelerations that the coordinates' accelerations make.
struct Swept<'a>(&'a Terms<f64>);

impl LaneTask<f64> for Swept<'_> {
    type Output = [f64; 4];

    #[inline(always)]
    fn run(self) -> [f64; 4] {
        self.0.geometry.phi_times(&self.0.response.acceleration)
    }
}

impl ContactEquations<'_> {
    /// All terms at one state, in the modes of the contacts.
    pub fn terms(&self, input: &Input<f64>, contacts: &Contacts<f64>, motion: &Motion<f64>) -> Terms<f64> {
        with!(self, (instructions, equations) => {
            f64::call(instructions, TermsAt(equations, input, contacts, motion))
        })
    }

    /// The velocities `p` after an impact of the contacts that are `closed`, with an impulse on the object.
    pub fn impact(
        &self,
        geometry: &Geometry<f64>,
        p: &Coordinates,
        closed: [bool; 2],
        impulse: [f64; 3],
    ) -> Impact {
        let friction = self.friction();
        with!(self, (instructions, equations) => {
            f64::call(instructions, Collision { equations, friction, geometry, p, closed, impulse })
        })
    }

    /// The state of a motion, with works of zero.
    pub fn begin(&self, motion: &Motion<f64>) -> States<f64> {
        with!(self, (_, equations) => equations.begin(motion))
    }

    /// The motion of a state.
    pub fn motion(&self, input: &Input<f64>, y: &States<f64>) -> Motion<f64> {
        with!(self, (_, equations) => equations.unpack(input, y))
    }

    /// The rates of the constraints' velocities that the accelerations make: Phi times the accelerations.
    pub fn swept(&self, terms: &Terms<f64>) -> [f64; 4] {
        let (Self::Actuated(instructions, _) | Self::Driven(instructions, _)) = *self;
        f64::call(instructions, Swept(terms))
    }

    /// theta_p of both tips.
    pub fn tilts(&self, q: &Coordinates) -> [f64; 2] {
        std::array::from_fn(|i| self.sides()[i].tilt(i, q))
    }

    /// The lengths of both sides.
    pub fn sides(&self) -> &[Side<f64>; 2] {
        with!(self, (_, equations) => &equations.plant().sides)
    }

    /// The diagonal of the mass matrix (14).
    pub fn masses(&self) -> &Coordinates {
        with!(self, (_, equations) => &equations.plant().masses)
    }

    /// mu of both contacts.
    pub fn friction(&self) -> [f64; 2] {
        with!(self, (_, equations) => equations.friction())
    }
}
