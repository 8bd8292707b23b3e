//! The paper's side: a face that is parallel to the object's other one (9).

/// A face whose normal is the object's first axis.
#[derive(Debug, Clone, Copy)]
pub struct ParallelFace<R> {
    /// W/2 + s_i w, from the centre of gravity to the face.
    pub(super) distance: R,
}
