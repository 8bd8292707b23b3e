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

pub use contact::law::{BRANCHES, ElasticGradient, RELAXATIONS, Relaxing};
pub use contact::mechanism::MechanismKind;
pub(crate) use contact::numbered;
pub use contact::shape::{Counterface, Frame, ShapeKind, Surface};
pub use contact::{Any, Contact, Others, Papers, Parts};
pub use contact_modes::{CONTACT_MODELS, CONTACT_MODES, ContactModel, ContactRow, Contacts, Mode, Slip};
pub use control::{FINGERS, Fingers};
pub use controller_state::{ControllerState, Kept, Known, Measured, Scratch};
pub use coordinates::Coordinates;
pub(crate) use coordinates::each_coordinate;
pub(crate) use drive::SegmentFrame;
pub use drive::{Input, MAX_DEGREE, SegmentDrive};
pub use energy::{BILATERAL_WORKS, CONTACT_WORKS, Energies, WORKS, work};
pub use forces::{Applied, Carriage, Forces, Plant};
pub use frame::{FrameLoads, FrameMotion};
pub use geometry::Geometry;
pub use inputs::{HandMotion, Held, Impulse, Inputs, Sampled, Sinusoid};
pub use measures::{MEASURES, Measure};
pub use motion::{Linearized, Motion, unpacked};
pub use noise::Noise;
pub use parameters::{
    Finger, Fingertip, Friction, GraspedObject, Law, Maxwell, Mechanism, PARAMETER_COUNT, Parameters,
    PidGains, SIDES, Side, Stabilization, Surroundings, parameter_table,
};
pub use piecewise::PiecewisePolynomial;
pub use rates::fastest_rate;
pub use rule::Rule;
pub use sampled::SampledController;
pub use scene::Scene;
pub use source::{Constants, DIRECTIONS, Source, VariedParameters};
pub use start::{
    STARTS, Start, State, allowed_residuals, apart, coordinate_at, relaxed, require_consistent, require_held,
    require_scheduled,
};
