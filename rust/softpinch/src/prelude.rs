//! What a program that simulates a scene needs: `use softpinch::prelude::*`.

pub use crate::driver::simulate::simulate;
pub use crate::error::Error;
pub use crate::method::Method;
pub use crate::model::start::contact;
pub use crate::model::{
    ContactModel, Finger, Fingertip, Friction, GraspedObject, Inputs, Parameters, Scene, State,
};
pub use crate::stepping::{Options, Run, Status, Steps};
