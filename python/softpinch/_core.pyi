"""Types of the Rust core. Bad input raises ValueError with the field, the value and the rule."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NotRequired, TypeAlias, TypedDict, final

import numpy as np
from numpy.typing import NDArray

from .support.choices import Formulation, Method, Recordable

_Floats: TypeAlias = NDArray[np.float64]
_Components: TypeAlias = tuple[float, float, float]
# Times, coordinates, velocities, multipliers and codes of statuses of all runs.
_Arrays: TypeAlias = tuple[_Floats, _Floats, _Floats, _Floats, NDArray[np.uint8]]

__all__ = [
    "ADAPTIVE_METHODS",
    "CONTACT_MODELS",
    "CONTACT_MODES",
    "DEFAULTS",
    "FINGERS",
    "FORMULATIONS",
    "GRADIENTS",
    "MAX_STEPS",
    "MEASURES",
    "METHODS",
    "ORDERS",
    "PARAMETERS",
    "RECORDABLE",
    "RESULTS_VERSION",
    "RULES",
    "SENSITIVITIES",
    "SIMD_LEVELS",
    "STATUSES",
    "SUMMARIES",
    "VIOLATIONS",
    "Batch",
    "Directions",
    "Inputs",
    "RestScene",
    "Simulation",
    "Simulator",
    "__version__",
    "consistent",
    "contacts",
    "evaluate",
    "gradients",
    "linearize",
    "noise",
    "residuals",
    "sensitivities",
    "simd_level",
    "stable_step",
    "start",
    "start_driven",
    "validate",
]

__version__: Final[str]
RESULTS_VERSION: Final[int]
RULES: Final[dict[str, dict[str, str]]]
PARAMETERS: Final[tuple[str, ...]]
DEFAULTS: Final[_Floats]
MAX_STEPS: Final[int]
METHODS: Final[tuple[Method, ...]]
ORDERS: Final[dict[str, int]]
ADAPTIVE_METHODS: Final[tuple[Method, ...]]
CONTACT_MODELS: Final[tuple[str, ...]]
CONTACT_MODES: Final[dict[str, int]]
# Measure of a discrete controller -> number of its entries.
MEASURES: Final[dict[str, int]]
FINGERS: Final[tuple[str, ...]]
FORMULATIONS: Final[tuple[Formulation, ...]]
GRADIENTS: Final[tuple[str, ...]]
RECORDABLE: Final[tuple[Recordable, ...]]
SENSITIVITIES: Final[dict[str, int]]
SIMD_LEVELS: Final[tuple[str, ...]]
STATUSES: Final[tuple[str, ...]]
SUMMARIES: Final[dict[str, str]]
VIOLATIONS: Final[tuple[str, ...]]

# `softpinch.State`, which the core takes by its attributes.
_State: TypeAlias = Any

class _Terms(TypedDict):
    mass_matrix: _Floats
    constraint_matrix: _Floats
    constraint_rate: _Floats
    residuals: _Floats
    residual_rates: _Floats
    elastic: _Floats
    gravity: _Floats
    viscous: _Floats
    control: _Floats
    external: _Floats
    multipliers: _Floats
    accelerations: _Floats
    target: _Floats
    kinetic_energy: float
    elastic_energy: float
    gravity_energy: float

class _Final(TypedDict):
    t: float
    q: _Floats
    p: _Floats
    integral: _Floats
    relaxation: _Floats
    anchor: float
    step: int
    linearized: _Floats | None
    contacts: _Floats | None
    controller: _Floats | None

# The first axis of every array counts the instants. Only A is there unless the model is whole.
class _Linear(TypedDict):
    A: _Floats
    B: NotRequired[_Floats]
    C: NotRequired[_Floats]
    D: NotRequired[_Floats]
    state: NotRequired[_Floats]
    rate: NotRequired[_Floats]
    input: NotRequired[_Floats]
    output: NotRequired[_Floats]

class _Run(TypedDict):
    t: _Floats
    q: _Floats | None
    p: _Floats | None
    integral: _Floats | None
    relaxation: _Floats | None
    grid_anchor: _Floats | None
    grid_step: NDArray[np.int64] | None
    linearized: _Floats | None
    multipliers: _Floats | None
    residuals: _Floats | None
    energy: _Floats | None
    torque: _Floats | None
    contacts: _Floats | None
    controllers: _Floats | None
    contact: NDArray[np.uint8] | None
    contact_changes: list[tuple[float, str, int, int, str]]
    begun: tuple[float, float, float] | None
    final: _Final
    status: str
    message: str
    violations: dict[str, float]
    violation_intervals: dict[str, _Floats]
    holds: bool
    stats: dict[str, int]
    warnings: list[str]
    step_to_stable_one: float

class _Outline(TypedDict):
    segments: int
    steps: int | None
    bytes: int | None

class _Rows(TypedDict):
    run: NDArray[np.uint64]
    status: NDArray[np.uint64]
    message: NDArray[np.uint64]
    messages: list[str]
    t: _Floats
    steps: NDArray[np.uint64]
    final_state: _Floats
    holds: NDArray[np.bool_]
    violations: dict[str, _Floats]
    summaries: dict[str, _Floats]
    interrupted: bool

# The first axis of every array in `Inputs` counts the runs; its length is 1 where all runs share
# the values.
@final
class Directions:
    def __new__(
        cls,
        parameters: _Floats,
        inputs: Inputs,
        *,
        initial: _Floats,
        shifts: _Floats,
        impulse_times: _Floats,
        start: str | None,
    ) -> Directions: ...

@final
class Inputs:
    def __new__(
        cls,
        schedule: tuple[_Floats, _Floats],
        forces: Sequence[tuple[_Floats, _Floats]],
        sines: Sequence[_Floats],
        impulses: Sequence[_Floats],
        noises: Sequence[tuple[_Floats, int, NDArray[np.uint64], int]],
        fingers: str,
        controller: tuple[
            list[tuple[list[str], int, tuple[bool, bool], _Floats, tuple[str, bool] | None]],
            int,
            NDArray[np.uint64],
        ]
        | None = None,
        motion: tuple[tuple[_Floats, _Floats], tuple[_Floats, _Floats], _Floats] | None = None,
    ) -> Inputs: ...
    def controller(self, time: float) -> list[float]: ...

@final
class Batch:
    warning: str | None
    least_stable: tuple[float, int]
    def __new__(
        cls,
        parameters: _Floats,
        columns: Sequence[tuple[int, _Floats]],
        inputs: Inputs,
        *,
        runs: int,
        start: str,
        initial: _State,
        time: _Floats,
        q: _Floats,
        p: _Floats,
        integral: _Floats,
        contact: str,
        duration: _Floats,
        summaries: list[str],
        band: float,
        options: Mapping[str, Any],
    ) -> Batch: ...
    def run(self, threads: int, watch: Callable[[int], bool]) -> _Rows: ...

@final
class Simulation:
    def __new__(
        cls,
        parameters: _Floats,
        inputs: Inputs,
        initial: _State,
        *,
        contact: str,
        duration: float,
        times: _Floats | None,
        every: int,
        refine: int,
        record: Sequence[str],
        summaries: Sequence[str],
        options: Mapping[str, Any],
    ) -> Simulation: ...
    def run(self) -> _Run: ...
    def outline(self) -> _Outline: ...

@final
class Simulator:
    @staticmethod
    def alone(simulation: Simulation, period: float) -> Simulator: ...
    @staticmethod
    def many(batch: Batch, period: float, threads: int) -> Simulator: ...
    def step(
        self, right: float, left: float, acceleration: Sequence[float] | None
    ) -> tuple[float, _Floats, _Floats, _Floats, int]: ...
    def step_all(
        self, actions: _Floats, accelerations: _Floats | None, arrays: _Arrays
    ) -> None: ...
    def observation(self, run: int) -> tuple[float, _Floats, _Floats, _Floats, int]: ...
    def observe(self, arrays: _Arrays) -> None: ...
    def message(self, run: int) -> str: ...
    def end(self, run: int) -> float: ...
    def state(
        self, run: int
    ) -> tuple[
        float,
        _Floats,
        _Floats,
        _Floats,
        tuple[float, int] | None,
        _Floats | None,
        _Floats | None,
    ]: ...
    def reset(self, run: int, state: _State | None) -> None: ...
    def set_state(self, run: int, state: _State) -> None: ...
    def set_force(self, run: int, force: tuple[float, float, float]) -> None: ...

def validate(record: str, field: str, value: float) -> None: ...
def sensitivities(
    simulation: Simulation, directions: Directions, rows: _Floats
) -> tuple[_Floats, list[tuple[str | None, list[float]]]]: ...
def gradients(
    batch: Batch,
    directions: Sequence[Directions],
    until: _Floats,
    summaries: Sequence[str],
    threads: int,
) -> tuple[_Floats, list[tuple[int, str]]]: ...
def start(parameters: _Floats, kind: str) -> _Floats: ...
def start_driven(
    parameters: _Floats, inputs: Inputs, time: float, contact: str
) -> tuple[_Floats, _Floats]: ...
def consistent(
    parameters: _Floats, pose: _Floats, shear: _Floats, velocity: _Floats
) -> tuple[_Floats, _Floats]: ...
def contacts(parameters: _Floats, q: _Floats) -> _Floats: ...
def residuals(parameters: _Floats, q: _Floats, p: _Floats) -> _Floats: ...
def evaluate(
    parameters: _Floats,
    inputs: Inputs,
    t: float,
    q: _Floats,
    p: _Floats,
    integral: _Floats,
    formulation: str,
    alpha: float,
    beta: float,
) -> _Terms: ...

@final
class RestScene:
    def __new__(cls, parameters: _Floats, inputs: Inputs, time: float) -> RestScene: ...
    def equilibrium(
        self, kind: str, values: _Floats, start: _Floats | None = None
    ) -> dict[str, Any]: ...
    def continued(
        self,
        kind: str,
        values: _Floats,
        before: RestScene,
        values_before: _Floats,
        start: _Floats,
    ) -> dict[str, Any]: ...
    def limits(self, q: _Floats, loads: _Floats) -> tuple[_Floats, list[str], _Floats]: ...

def linearize(
    parameters: _Floats,
    inputs: Inputs,
    t: _Floats,
    q: _Floats,
    p: _Floats,
    integral: _Floats,
    formulation: str,
    alpha: float,
    beta: float,
    *,
    contacts: _Floats | None,
    whole: bool,
    open_loop: bool,
    frozen: bool,
) -> _Linear: ...
def stable_step(method: str, rates: NDArray[np.complex128]) -> _Floats: ...
def noise(
    std: _Components, key: tuple[int, int], stream: int, first: int, count: int
) -> _Floats: ...
def simd_level() -> str: ...
