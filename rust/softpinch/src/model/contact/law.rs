//! Laws of the tip: its elastic energy P as a function of theta_p, d_n and d_t.
//!
//! The paper's law (5) is compiled into the equations. All others are called, and are springs as (4) has them, with the
//! force F(d) of the upright tip as a curve (`law/springs.rs`): a new one is a file in `law/` that computes a
//! `springs::Curve`, and an entry of the table `laws!`.

mod inoue_hirai;
mod measured;
mod power;
mod relaxation;
mod springs;

pub use inoue_hirai::InoueHirai;
use measured::Measured;
pub use measured::WEIGHTS;
use power::Power;
pub use relaxation::{BRANCHES, RELAXATIONS, Relaxing};
use springs::Curve;
pub use springs::Springs;

use crate::model::{Motion, Source, numbered};
use crate::number::{LaneTask, Lift, Real, task};

/// Declares the kinds of laws; of the others than (5) also the type that has the curve.
macro_rules! laws {
    ($(#[$first_doc:meta])* $first:ident, $($(#[$doc:meta])* $kind:ident: $curve:ident,)*) => {
        numbered! {
            LawKind {
                $(#[$first_doc])*
                $first,
                $($(#[$doc])* $kind,)*
            }
        }

        #[derive(Debug, Clone, Copy)]
        enum Force<R> {
            /// pi E of (5).
            $first(R),
            $($kind($curve<R>),)*
        }

        impl<R: Real> Force<R> {
            #[inline(always)]
            fn new(source: &impl Source<R>, i: usize) -> Self {
                match source.kinds().law(i) {
                    LawKind::$first => {
                        Self::$first(R::constant(std::f64::consts::PI) * source.number(|p| p.tips[i].youngs_modulus))
                    }
                    $(LawKind::$kind => Self::$kind($curve::new(source, i)),)*
                }
            }

            /// The curve at a compression that is not negative.
            #[inline(always)]
            fn curve<T: Lift<R>>(&self, d: T) -> Curve<T> {
                match self {
                    Self::$first(c) => Curve::square(T::lift(*c), d),
                    $(Self::$kind(law) => law.curve(d),)*
                }
            }
        }
    };
}

laws! {
    /// Parallel linear springs in a hemisphere (5): the paper's, with the modulus of the fingertip.
    ParallelSprings,
    /// A force F = c d_n^n of the upright tip.
    Power: Power,
    /// A measured force of the upright tip.
    Measured: Measured,
}

/// The modulus E with which (5) is as stiff at full compression as the law of tip `i`, Pa.
pub(crate) fn modulus<R: Real>(source: &impl Source<R>, i: usize) -> R {
    if source.kinds().law(i) == LawKind::ParallelSprings {
        return source.number(|p| p.tips[i].youngs_modulus);
    }
    let radius = source.number(|p| p.tips[i].radius);
    curve(source, i, radius).slope / (R::constant(2.0 * std::f64::consts::PI) * radius)
}

/// F of the upright tip `i` at a compression, N.
pub(crate) fn force<R: Real>(source: &impl Source<R>, i: usize, d_n: R) -> R {
    curve(source, i, d_n).force
}

#[inline(never)]
fn curve<R: Real>(source: &impl Source<R>, i: usize, d_n: R) -> Curve<R> {
    R::outlined(Build { source, i }).curve_called(d_n)
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

impl<R: Real> ElasticGradient<R> {
    #[inline(always)]
    fn zero() -> Self {
        Self { tilt: R::zero(), normal: R::zero(), tangential: R::zero() }
    }
}

/// The elastic and viscous constants of one tip.
#[derive(Debug, Clone, Copy)]
pub struct Tip<R> {
    law: InoueHirai<R>,
    /// The law if that of one of the tips is not the paper's.
    other: Option<Springs<R>>,
    pub normal_viscosity: R,
    pub tangential_viscosity: R,
}

task! {
    ['a, R: Real, S: Source<R>] Build<'a, S>(source: &'a S, i: usize) for R => Springs<R> = Springs::new(source, i)
}
task! {
    /// Computes the energies of other laws, and their gradients.
    ['a, R: Real]
    Elastic<'a, R>(laws: [&'a Springs<R>; 2], at: [[R; 4]; 2]) for R => [(R, ElasticGradient<R>); 2] = {
        let mut found = [(R::zero(), ElasticGradient::zero()); 2];
        for i in 0..2 {
            found[i] = laws[i].elastic(at[i]);
        }
        found
    }
}

task! {
    ['a, R: Real]
    Relax<'a, R>(law: &'a Springs<R>, i: usize, at: [R; 2], states: &'a [R; RELAXATIONS], ledger: bool)
    for R => Relaxing<R> = law.relaxing(i, at, states, ledger)
}

impl<R: Real> Tip<R> {
    #[inline(always)]
    pub fn new(source: &impl Source<R>, i: usize) -> Self {
        let mut other = None;
        if !source.kinds().has_the_papers_laws() {
            other = Some(R::outlined(Build { source, i }));
        }
        Self {
            law: InoueHirai::new(source, i),
            other,
            normal_viscosity: source.number(|p| p.tips[i].normal_viscosity),
            tangential_viscosity: source.number(|p| p.tips[i].tangential_viscosity),
        }
    }

    /// The effect of the branches of this tip, which is that of finger `i`. A law with branches counts as another than (5).
    #[inline(always)]
    pub(crate) fn relaxing(&self, i: usize, motion: &Motion<R>, ledger: bool) -> Relaxing<R> {
        let Motion { q, relaxation: states, .. } = motion;
        match &self.other {
            Some(law) => {
                let at = [q.compression[i], q.shear[i]];
                R::outlined(Relax { law, i, at, states, ledger })
            }
            None => Relaxing::nothing(),
        }
    }
}

/// The other laws of both tips. The paper's equations call them, too.
#[inline(always)]
fn others<R: Real>([right, left]: &[Tip<R>; 2]) -> Option<[&Springs<R>; 2]> {
    Some([right.other.as_ref()?, left.other.as_ref()?])
}

/// The elastic energies of both tips, J, for their sin theta_p, cos theta_p, d_n and d_t.
#[inline(always)]
pub fn energies<R: Real>(tips: &[Tip<R>; 2], at: [[R; 4]; 2]) -> [R; 2] {
    if let Some(laws) = others(tips) {
        let [right, left] = R::outlined(Elastic { laws, at });
        return [right.0, left.0];
    }
    [tips[0].law.energy(at[0]), tips[1].law.energy(at[1])]
}

/// The gradients of [`energies`] in theta_p, d_n and d_t.
#[inline(always)]
pub fn gradients<R: Real>(tips: &[Tip<R>; 2], at: [[R; 4]; 2]) -> [ElasticGradient<R>; 2] {
    if let Some(laws) = others(tips) {
        let [right, left] = R::outlined(Elastic { laws, at });
        return [right.1, left.1];
    }
    [tips[0].law.gradient(at[0]), tips[1].law.gradient(at[1])]
}
