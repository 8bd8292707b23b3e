//! Shapes of the object's sides: where the foot of the perpendicular from a tip's centre is, and the side's normal there.
//!
//! All kinds but the paper's are one surface with four numbers, which are exact for flat ones (`shape/surface.rs`): its apex, its
//! tilt there and its curvature. A new kind of them is an entry of [`ShapeKind`] and a branch of `Surface::new`. The paper's
//! parallel face is inlined into the equations.

mod parallel_face;
mod surface;

pub use parallel_face::{Frame, ParallelFace};
pub use surface::Surface;

use crate::model::numbered;

numbered! {
    ShapeKind {
        /// A face that is parallel to the other one: the paper's.
        ParallelFace,
        /// A face that is tilted about its middle, or that has a height of its own.
        Face,
        /// An arc of a circle, convex.
        Arc,
    }
}

numbered! {
    /// How the curvature of an arc changes the elastic energy of a tip. (4) is for a flat side.
    Counterface {
        Flat,
        /// The arc is that of a cylinder, straight out of the plane: P is multiplied by (1 + a/R)^(-1/2).
        Cylinder,
        /// It is that of a sphere: (1 + a/R)^(-1).
        Sphere,
    }
}
