//! The mechanics: parameters, inputs, geometry, energy, forces and initial states.

pub(crate) mod contact;
pub(crate) mod contact_modes;
pub(crate) mod control;
pub(crate) mod controller_state;
pub(crate) mod coordinates;
pub(crate) mod drive;
pub(crate) mod energy;
pub(crate) mod forces;
pub(crate) mod frame;
pub(crate) mod geometry;
pub(crate) mod inputs;
pub(crate) mod measures;
pub(crate) mod motion;
pub(crate) mod noise;
pub(crate) mod parameters;
pub(crate) mod piecewise;
pub(crate) mod rates;
pub(crate) mod rule;
pub(crate) mod sampled;
pub(crate) mod scene;
pub(crate) mod source;
pub mod start;

pub(crate) use crate::names::numbered;
pub(crate) use contact::law::{ElasticGradient, RELAXATIONS, Relaxing};
pub(crate) use contact::mechanism::MechanismKind;
pub(crate) use contact::shape::{Counterface, Frame, ShapeKind, Surface};
pub(crate) use contact::{Any, Contact, Others, Papers, Parts};
pub use contact_modes::{CONTACT_MODELS, CONTACT_MODES, ContactModel, ContactRow};
pub(crate) use contact_modes::{Contacts, Mode, Slip};
pub use control::{FINGERS, Fingers};
pub(crate) use controller_state::{ControllerState, Known, Measured, Scratch, require_length};
pub use coordinates::Coordinates;
pub(crate) use coordinates::each_coordinate;
pub use drive::MAX_DEGREE;
pub(crate) use drive::{Input, SegmentDrive, SegmentFrame};
pub(crate) use energy::{BILATERAL_WORKS, CONTACT_WORKS, Energies, WORKS, work};
pub(crate) use forces::{Applied, Forces, Plant};
pub(crate) use frame::{FrameLoads, FrameMotion};
pub use geometry::Geometry;
pub use inputs::{HandMotion, Impulse, Inputs, Sinusoid};
pub(crate) use inputs::{Held, Sampled};
pub use measures::{MEASURES, Measure};
pub(crate) use motion::{Linearized, unpacked};
pub use motion::{Motion, NUMBERS};
pub use noise::Noise;
pub use parameters::{
    Finger, Fingertip, Friction, GraspedObject, Law, Maxwell, Mechanism, PARAMETER_COUNT, Parameters,
    PidGains, SIDES, Side, Stabilization, Surroundings, parameter_table,
};
pub use piecewise::PiecewisePolynomial;
pub(crate) use rates::fastest_rate;
pub use rule::Rule;
pub use sampled::{GainSwitch, Place, SampledController};
pub use scene::Scene;
pub(crate) use source::{Constants, DIRECTIONS, Source, VariedParameters};
pub use start::{STARTS, Start, State, relaxed};
pub(crate) use start::{
    allowed_residuals, apart, coordinate_at, require_consistent, require_held, require_scheduled,
};
