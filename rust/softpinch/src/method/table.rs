//! The table of the methods, and their properties.

use crate::method::{dop853, rk4};

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

/// The methods by their public names.
pub const METHODS: [(&str, Method); 5] = [
    ("rk4", Method::Rk4),
    ("dop853", Method::Dop853),
    ("implicit_midpoint", Method::ImplicitMidpoint),
    ("radau5", Method::Radau5),
    ("rosenbrock", Method::Rosenbrock),
];

impl Method {
    /// The public name of the method.
    #[must_use]
    pub fn name(self) -> &'static str {
        METHODS.iter().find(|(_, method)| *method == self).map_or("", |&(name, _)| name)
    }

    /// The order of the method: the error falls with this power of the step if nothing is stiff.
    #[must_use]
    pub fn order(self) -> u32 {
        match self {
            Self::Rk4 | Self::Rosenbrock => 4,
            Self::Dop853 => 8,
            Self::ImplicitMidpoint => 2,
            Self::Radau5 => 5,
        }
    }

    /// The end of the method's stability region on the negative real axis, without its sign; `None` if the
    /// region has no end there.
    #[must_use]
    pub fn real_stability_limit(self) -> Option<f64> {
        match self {
            Self::Rk4 => Some(rk4::REAL_STABILITY_LIMIT),
            Self::Dop853 => Some(dop853::REAL_STABILITY_LIMIT),
            Self::ImplicitMidpoint | Self::Radau5 | Self::Rosenbrock => None,
        }
    }

    /// Whether the steps keep a Jacobian for the steps that follow.
    #[must_use]
    pub fn keeps_jacobian(self) -> bool {
        matches!(self, Self::ImplicitMidpoint | Self::Radau5)
    }

    /// Whether the method estimates its error, so that it can choose the length of its steps.
    #[must_use]
    pub fn is_adaptive(self) -> bool {
        self.adaptive().is_some()
    }

    /// The method as one that chooses the length of its steps, if it estimates its error.
    #[must_use]
    pub fn adaptive(self) -> Option<AdaptiveMethod> {
        match self {
            Self::Rk4 | Self::ImplicitMidpoint => None,
            Self::Dop853 => Some(AdaptiveMethod::Dop853),
            Self::Radau5 => Some(AdaptiveMethod::Radau5),
            Self::Rosenbrock => Some(AdaptiveMethod::Rosenbrock),
        }
    }
}
