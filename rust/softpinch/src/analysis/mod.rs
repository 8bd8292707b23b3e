//! A scene at one state: every term of (24), and the linearised motion.

pub mod evaluate;
pub mod modes;
