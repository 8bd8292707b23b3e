//! The energies (5) and (16), their gradients, and the energy ledger.

use crate::model::source::Source;
use crate::number::lanes::Lanes;
use crate::number::real::Real;

/// The elastic and viscous constants of one tip.
#[derive(Debug, Clone, Copy)]
pub struct Tip<R> {
    /// Stiffness pi E.
    stiffness: R,
    /// Coupling kappa of shear and tilt in (5).
    coupling: R,
    /// Normal viscosity c_n.
    pub normal_viscosity: R,
    /// Tangential viscosity c_t.
    pub tangential_viscosity: R,
}

/// The gradient of one tip's elastic energy.
#[derive(Debug, Clone, Copy)]
pub struct ElasticGradient<R> {
    /// dP/d theta_p, N m.
    pub tilt: R,
    /// dP/d d_n, N.
    pub normal: R,
    /// dP/d d_t, N.
    pub tangential: R,
}

impl<R: Real> Tip<R> {
    /// The constants of the tip of finger `i`.
    #[inline(always)]
    #[must_use]
    pub fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            stiffness: R::constant(std::f64::consts::PI) * source.number(|p| p.tips[i].youngs_modulus),
            coupling: source.number(|p| p.tips[i].tilt_coupling),
            normal_viscosity: source.number(|p| p.tips[i].normal_viscosity),
            tangential_viscosity: source.number(|p| p.tips[i].tangential_viscosity),
        }
    }

    /// The term of one tip in (5): pi E { d_n^3 / (3 cos^2) + kappa d_n^2 d_t tan + d_n d_t^2 }.
    #[inline(always)]
    pub fn energy(&self, sin_tilt: R, cos_tilt: R, d_n: R, d_t: R) -> R {
        let secant = R::constant(1.0) / cos_tilt;
        let tangent = sin_tilt * secant;
        let compression = d_n * secant;
        let cubic = compression * compression * d_n * R::constant(1.0 / 3.0);
        let mixed = self.coupling * d_n * d_n * d_t * tangent;
        self.stiffness * (cubic + (mixed + d_n * d_t * d_t))
    }

    /// The gradient of [`Tip::energy`] in theta_p, d_n and d_t.
    #[inline(always)]
    pub fn gradient(&self, sin_tilt: R, cos_tilt: R, d_n: R, d_t: R) -> ElasticGradient<R> {
        let secant = R::constant(1.0) / cos_tilt;
        let tangent = sin_tilt * secant;
        // pi d_n^2 / cos^2 is the area that (3) integrates over. `area` is this area times E.
        let compressed = d_n * secant;
        let area = (self.stiffness * compressed) * compressed;
        let slope = self.coupling * tangent;
        let two = R::constant(2.0);
        let (stiff_n, stiff_t) = (self.stiffness * d_n, self.stiffness * d_t);
        ElasticGradient {
            tilt: area * (R::constant(2.0 / 3.0) * d_n).dot2(tangent, self.coupling, d_t),
            normal: stiff_t.mul_add((two * d_n).mul_add(slope, d_t), area),
            tangential: stiff_n * d_n.dot2(slope, two, d_t),
        }
    }
}

/// The energies of a state, in joules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Energies<R = f64> {
    /// Kinetic energy p M p / 2.
    pub kinetic: R,
    /// Elastic energy P (5).
    pub elastic: R,
    /// Potential energy of gravity P_g (16).
    pub gravity: R,
}

impl<R: Real> Energies<R> {
    /// The sum of the three energies.
    #[inline(always)]
    pub fn total(&self) -> R {
        (self.kinetic + self.elastic) + self.gravity
    }
}

impl<R: Lanes> Energies<R> {
    /// The energies in one lane.
    #[must_use]
    pub fn lane(&self, lane: usize) -> Energies {
        let Self { kinetic, elastic, gravity } = *self;
        Energies { kinetic: kinetic.lane(lane), elastic: elastic.lane(lane), gravity: gravity.lane(lane) }
    }
}

/// The closure error of the energy ledger: (energy now - energy at the start) - (works - losses). Bilateral
/// contact has the first four works.
#[inline(always)]
pub fn closure<R: Real>(start: &Energies<R>, now: &Energies<R>, works: &[R]) -> R {
    let gain = now.total() - start.total();
    let &[control, external, viscous, constraint, ref of_contact @ ..] = works else { return gain };
    let work = ((control + external) + constraint) - viscous;
    match *of_contact {
        [friction, impact, relaxation] => gain - (work + (relaxation - (friction + impact))),
        _ => gain - work,
    }
}

/// Number of works of the energy ledger.
pub const WORKS: usize = 7;
/// Number of works in bilateral contact, which neither slides nor opens.
pub const BILATERAL_WORKS: usize = 4;

/// The places of the works in a state's ledger and in a row.
pub mod work {
    /// Work of the fingers' torques.
    pub const CONTROL: usize = 0;
    /// Work of the external forces.
    pub const EXTERNAL: usize = 1;
    /// Work of the constraints.
    pub const CONSTRAINT: usize = 3;
    /// Loss to friction.
    pub const FRICTION: usize = 4;
    /// Loss in impacts.
    pub const IMPACT: usize = 5;
    /// Energy that free tips gain while their tilt is frozen.
    pub const RELAXATION: usize = 6;
}

/// One row of the energy ledger, in joules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LedgerRow {
    /// The energies now.
    pub energies: Energies,
    /// Work since the start: of the fingers' torques, of the external forces, lost to viscosity, and of the
    /// constraints (lambda^T Phi p, and the energy that a correction of the state adds). In unilateral contact
    /// also the energy lost to friction and in impacts, and the energy that the elastic energies (5) gain
    /// because a free tip's tilt is frozen in them; in bilateral contact these three are zero. Each work is a
    /// quadrature of its own, or a sum over events.
    pub works: [f64; WORKS],
}

impl LedgerRow {
    /// The row's columns in the order in which they are recorded.
    #[inline(always)]
    #[must_use]
    pub fn columns(&self) -> [f64; 3 + WORKS] {
        let Energies { kinetic, elastic, gravity } = self.energies;
        let mut columns = [kinetic, elastic, gravity, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        columns[3..].copy_from_slice(&self.works);
        columns
    }
}
