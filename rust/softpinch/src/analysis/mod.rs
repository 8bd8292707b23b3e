//! What a scene is at one state: every term of (24), and the motion linearised.

pub mod evaluate;
pub mod modes;
