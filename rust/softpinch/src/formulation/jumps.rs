//! What happens to the motion at the events of unilateral contact, once all choices have been made. It is the same for
//! numbers of every kind, so that derivatives follow a run through its events.

use crate::formulation::contact_solve::Load;
use crate::formulation::{Equations, States, response};
use crate::model::{Contacts, Coordinates, Geometry, Input, Mode, Motion, each_coordinate};
use crate::number::{LaneTask, Lanes, task};

/// A part of an event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ContactJump {
    /// The surface of a tip takes the gap at its contact.
    Meet(usize),
    /// The surface of a tip comes to rest without compression and shear.
    Relax(usize),
    /// An impact, in which contacts are in these modes, and an impulse on the object.
    Impact([Mode; 2]),
    /// The surfaces of closed contacts take the residuals, so that gaps and slips start at zero. Of each contact: whether it
    /// is closed, and whether it slips.
    Absorb([(bool, bool); 2]),
}

impl ContactJump {
    #[inline(always)]
    pub fn apply<R: Lanes, E: Equations<R>>(
        &self,
        equations: &E,
        Motion { q, p, .. }: &mut Motion<R>,
        impulse: &[R; 3],
    ) {
        let Some(friction) = equations.friction() else { return };
        let (plant, zero) = (equations.plant(), R::zero());
        let geometry = Geometry::<R, E::Parts>::of(&plant.sides, q, p);
        match *self {
            Self::Meet(i) => q.compression[i] = q.compression[i] - geometry.residuals()[i],
            Self::Relax(i) => {
                (q.compression[i], q.shear[i], p.compression[i], p.shear[i]) = (zero, zero, zero, zero);
            }
            Self::Impact(modes) => {
                let bias = geometry.constraint_velocity();
                let (pair, mut contacts) = ([zero; 2], Contacts::sticking());
                for lane in 0..R::WIDTH {
                    contacts.set(lane, modes, [0.0; 2]);
                }
                let force = Coordinates { object: *impulse, ..Coordinates::zero() };
                let load = Load { force, couple: pair, friction, bias, finger_acceleration: pair };
                let change = response(plant.driven, &geometry, plant, &contacts, &load).acceleration;
                *p = each_coordinate!([p, change] => p + change);
            }
            Self::Absorb(contacts) => {
                let gaps = geometry.residuals();
                for i in 0..2 {
                    if contacts[i].0 {
                        q.compression[i] = q.compression[i] - gaps[i];
                    }
                }
                // The velocities of a contact depend on its compression.
                let velocity = Geometry::<R, E::Parts>::of(&plant.sides, q, p).constraint_velocity();
                for (i, (closed, slips)) in contacts.into_iter().enumerate() {
                    if closed {
                        p.compression[i] = p.compression[i] - velocity[i];
                    }
                    if closed && !slips {
                        p.shear[i] = p.shear[i] - velocity[2 + i];
                    }
                }
            }
        }
    }
}

task! {
    /// Lets it happen to a state, whose works stay.
    pub(crate) ['a, R: Lanes, E: Equations<R>]
    ApplyJump<'a, R, E>(equations: &'a E, input: &'a Input<R>, y: &'a mut States<R>, jump: ContactJump,
        impulse: &'a [R; 3])
    for R => () = {
        let driven = equations.plant().driven;
        let mut motion = equations.unpack(driven, input, y);
        jump.apply(equations, &mut motion, impulse);
        let states = equations.states(driven);
        y[..states].copy_from_slice(&equations.begin(driven, &motion)[..states]);
    }
}
