//! The table of the methods, and those of them that can be made for lanes.

use crate::formulation::scene_equations::{SceneEquations, Tangent};
use crate::formulation::system::System;
use crate::method::called::{AnyAdaptiveMethod, Called};
use crate::method::dop853::Dop853;
use crate::method::entry::{AdaptiveLaneMethod, MethodEntry};
use crate::method::linearize::DIRECTIONS_IN_LANES;
use crate::method::rosenbrock::Rosenbrock;
use crate::method::traits::Runs;
use crate::method::{dop853, implicit_midpoint, radau5, rk4, rosenbrock};
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::linear::LaneEntry;

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

/// Makes a method in lanes. The zeros of its vectors need the instructions of the lanes.
struct MakeInLanes<'a, R> {
    method: AdaptiveLaneMethod,
    runs: Runs<'a>,
    system: &'a SceneEquations<R>,
}

impl<R: Lanes> LaneTask<R> for MakeInLanes<'_, R> {
    type Output = AnyAdaptiveMethod<R>;

    #[inline(always)]
    fn run(self) -> AnyAdaptiveMethod<R> {
        let Self { method, runs, system } = self;
        match method {
            AdaptiveLaneMethod::Dop853 => Box::new(Called::new(runs, Dop853::default())),
            AdaptiveLaneMethod::Rosenbrock => {
                type InLanes<R> = Rosenbrock<Tangent<R, DIRECTIONS_IN_LANES>, R, LaneEntry<R>>;
                let method = InLanes::<R>::new(system.size(), runs.tangent());
                Box::new(Called::renewed_by(runs, method, |method, runs| method.tangent = runs.tangent()))
            }
        }
    }
}

/// A method whose lanes choose the length of their own steps, before its first step.
pub fn adaptive_in_lanes<R: Lanes>(
    method: AdaptiveLaneMethod,
    runs: Runs<'_>,
    system: &SceneEquations<R>,
) -> AnyAdaptiveMethod<R> {
    R::call(runs.instructions, MakeInLanes { method, runs, system })
}
