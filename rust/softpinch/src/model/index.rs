//! Index of each coordinate in q and p.

/// x of the centre of gravity.
pub const X: usize = 0;
/// y of the centre of gravity.
pub const Y: usize = 1;
/// Orientation of the object.
pub const THETA: usize = 2;
/// Angle of the right finger; the angle of the left finger is next.
pub const FINGER: usize = 3;
/// Compression of the right tip; the compression of the left tip is next.
pub const D_N: usize = 5;
/// Shear of the right tip; the shear of the left tip is next.
pub const D_T: usize = 7;
