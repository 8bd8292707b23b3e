//! The table of the methods.

use crate::method::entry::MethodEntry;
use crate::method::{dop853, implicit_midpoint, radau5, rk4, rosenbrock};

/// The methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The classical Runge-Kutta method of order four.
    Rk4,
    /// Dormand and Prince's explicit method of order eight.
    Dop853,
    /// The implicit midpoint rule of order two.
    ImplicitMidpoint,
    /// The three-stage Radau IIA method of order five.
    Radau5,
    /// Rodas4P2, linearly implicit, of order four.
    Rosenbrock,
}

/// The methods by their public names.
pub const METHODS: [(&str, Method); 5] = [
    (rk4::ENTRY.name, Method::Rk4),
    (dop853::ENTRY.name, Method::Dop853),
    (implicit_midpoint::ENTRY.name, Method::ImplicitMidpoint),
    (radau5::ENTRY.name, Method::Radau5),
    (rosenbrock::ENTRY.name, Method::Rosenbrock),
];

impl Method {
    /// The properties of the method.
    pub const fn entry(self) -> &'static MethodEntry {
        match self {
            Self::Rk4 => &rk4::ENTRY,
            Self::Dop853 => &dop853::ENTRY,
            Self::ImplicitMidpoint => &implicit_midpoint::ENTRY,
            Self::Radau5 => &radau5::ENTRY,
            Self::Rosenbrock => &rosenbrock::ENTRY,
        }
    }

    /// The public name of the method.
    pub const fn name(self) -> &'static str {
        self.entry().name
    }
}
