//! The table of the methods, and their properties.

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

/// The methods that can choose the length of their steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdaptiveMethod {
    /// [`Method::Dop853`].
    Dop853,
    /// [`Method::Radau5`].
    Radau5,
    /// [`Method::Rosenbrock`].
    Rosenbrock,
}

/// The properties of a method.
pub struct MethodEntry {
    /// Its public name.
    pub name: &'static str,
    /// Its order: the error falls with this power of the step if nothing is stiff.
    pub order: u32,
    /// The end of its stability region on the negative real axis, without its sign; `None` if the region has no end
    /// there.
    pub real_stability_limit: Option<f64>,
    /// Whether its steps keep a Jacobian for the steps that follow.
    pub keeps_jacobian: bool,
    /// The method as one that chooses the length of its steps, if it estimates its error.
    pub adaptive: Option<AdaptiveMethod>,
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
    #[must_use]
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
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.entry().name
    }
}
