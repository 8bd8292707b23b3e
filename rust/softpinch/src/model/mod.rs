//! The mechanics: parameters, inputs, geometry, energy, forces and initial states.

pub mod contact;
pub mod contact_modes;
pub mod control;
pub mod controller_state;
pub mod coordinates;
pub mod drive;
pub mod energy;
pub mod forces;
pub mod frame;
pub mod geometry;
pub mod inputs;
pub mod measures;
pub mod motion;
pub mod noise;
pub mod parameters;
pub mod piecewise;
pub mod rates;
pub mod rule;
pub mod sampled;
pub mod scene;
pub mod source;
pub mod start;
