//! The equations of a scene in dual numbers, for their derivatives.

use crate::formulation::equations::{Equations, MAX_COMPONENTS, States};
use crate::formulation::scene_equations::{Choice, EquationKind, build, size_of, with};
use crate::formulation::system::{Jacobian, Linear};
use crate::model::drive::{Drive, SegmentDrive};
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
