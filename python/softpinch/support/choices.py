"""The names that arguments choose from, as types for editors and type checkers.

The tables of these names are in the core and beside what they choose; a test compares both. An
editor completes the names, and a type checker refuses others; at run time an unknown name is an
error that lists them.
"""

from typing import Literal, TypeAlias

Method: TypeAlias = Literal["rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock"]
Formulation: TypeAlias = Literal["csm", "nullspace", "projected"]
ContactModel: TypeAlias = Literal["bilateral", "unilateral"]
Fingers: TypeAlias = Literal["pid", "driven"]
Recordable: TypeAlias = Literal["state", "multipliers", "residuals", "energy", "torque", "contact"]
Violation: TypeAlias = Literal[
    "separated", "crushed", "folded", "pulling", "slipping", "rim", "off_face", "opened"
]
Summary: TypeAlias = Literal[
    "final_state",
    "peak_rotation",
    "min_compression",
    "peak_friction_angle",
    "peak_friction_ratio",
    "pulling_time",
    "settling_time",
    "max_residual",
    "energy_closure",
    "peak_torque",
    "slip_distance",
    "free_time",
    "margin",
]
Sampler: TypeAlias = Literal["random", "sobol", "latin_hypercube"]
ScheduleKind: TypeAlias = Literal["steps", "ramps", "minimum_jerk", "via_points", "sampled"]
Hold: TypeAlias = Literal["zero", "linear"]
Jitter: TypeAlias = Literal["uniform", "normal"]
