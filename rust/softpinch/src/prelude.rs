//! What a program that simulates a scene needs: `use softpinch::prelude::*`.

pub use crate::driver::simulate::simulate;
pub use crate::error::Error;
pub use crate::method::table::Method;
pub use crate::model::contact_modes::ContactModel;
pub use crate::model::inputs::Inputs;
pub use crate::model::parameters::{Finger, Fingertip, Friction, GraspedObject, Parameters};
pub use crate::model::scene::Scene;
pub use crate::model::start::{State, contact};
pub use crate::stepping::ending::Status;
pub use crate::stepping::options::{Options, Steps};
pub use crate::stepping::record::Run;
