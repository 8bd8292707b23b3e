//! The equations of a scene in dual numbers, for their derivatives.

use crate::formulation::equations::{Equations, Evaluation, MAX_COMPONENTS, States};
use crate::formulation::scene_equations::{Choice, EquationKind, build, size_of, with};
use crate::formulation::system::{Jacobian, Linear};
use crate::model::contact_modes::Contacts;
use crate::model::drive::{Drive, Input, SegmentDrive};
use crate::model::parameters::Stabilization;
use crate::model::source::Source;
use crate::number::dual::Dual;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::real::Real;
use crate::number::simd::level::Instructions;

/// The equations of a scene in dual numbers with `W` directions.
#[derive(Debug, Clone, Copy)]
pub struct Tangent<R, const W: usize> {
    instructions: Instructions,
    ledger: bool,
    kind: EquationKind<Dual<R, W>>,
}

impl<R: Lanes, const W: usize> Tangent<R, W> {
    /// Builds the equations of a scene, or of one scene for each lane.
    pub fn new(
        instructions: Instructions,
        choice: Choice,
        source: &impl Source<Dual<R, W>>,
        gains: &Stabilization,
    ) -> Self {
        let kind = build::<R, _>(instructions, choice, source, gains);
        Self { instructions, ledger: choice.ledger, kind }
    }

    /// Evaluates the state `y` under the inputs of an instant, without the works of the ledger. The directions
    /// of state and inputs are the caller's, so this differentiates every result by whatever is wanted. `None`
    /// for formulations other than `nullspace`: only its minimal coordinates are linearised with inputs and
    /// outputs, and this code is not compiled for the other formulations.
    #[must_use]
    pub fn evaluate(
        &self,
        input: &Input<Dual<R, W>>,
        y: &States<Dual<R, W>>,
    ) -> Option<Evaluation<Dual<R, W>>> {
        let mut now = Evaluation::nothing();
        match &self.kind {
            EquationKind::Nullspace(equations) => {
                R::call(self.instructions, Seeded { equations, input, y, now: &mut now });
            }
            EquationKind::NullspaceDriven(equations) => {
                R::call(self.instructions, Seeded { equations, input, y, now: &mut now });
            }
            _ => return None,
        }
        Some(now)
    }
}

/// Evaluates equations of bilateral contact in directions that the caller has chosen.
struct Seeded<'a, R, E, const W: usize> {
    equations: &'a E,
    input: &'a Input<Dual<R, W>>,
    y: &'a States<Dual<R, W>>,
    now: &'a mut Evaluation<Dual<R, W>>,
}

impl<R: Lanes, E: Equations<Dual<R, W>>, const W: usize> LaneTask<R> for Seeded<'_, R, E, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let contacts = Contacts::<R>::sticking().lifted();
        *self.now = self.equations.evaluate(self.input, &contacts, self.y, false);
    }
}

/// Computes a Jacobian in sweeps, each with `W` directions.
struct Sweeps<'a, R, E, const W: usize> {
    equations: &'a E,
    drive: &'a SegmentDrive<R>,
    tau: R,
    y: &'a States<R>,
    ledger: bool,
    jacobian: &'a mut Jacobian<R>,
}

impl<R: Lanes, E: Equations<Dual<R, W>>, const W: usize> LaneTask<R> for Sweeps<'_, R, E, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let rows = &mut self.jacobian.rows;
        let all = size_of::<Dual<R, W>, E>(self.ledger).all();
        let contacts = self.drive.contacts.lifted();
        let mut first = 0;
        while first <= E::STATES {
            let mut y = [Dual::constant(0.0); MAX_COMPONENTS];
            for (n, (dual, &number)) in y.iter_mut().zip(self.y).take(all).enumerate() {
                let direction = if n < E::STATES { n.wrapping_sub(first) } else { W };
                *dual = Dual::variable(number, direction);
            }
            let tau = Dual::variable(self.tau, E::STATES.wrapping_sub(first));
            let rate = self.equations.evaluate(&self.drive.at(tau), &contacts, &y, self.ledger).rate;
            for n in 0..all {
                rows[n][first..first + W].copy_from_slice(&rate[n].slope);
            }
            first += W;
        }
    }
}

impl<R: Lanes, const W: usize> Linear<R> for Tangent<R, W> {
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>) {
        let Self { instructions, ledger, .. } = *self;
        with!(&self.kind, equations => {
            R::call(instructions, Sweeps::<R, _, W> { equations, drive, tau, y, ledger, jacobian });
        });
    }
}
