"""The scenes of Inoue and Hirai, "Dynamic Stable Manipulation via Soft-fingered Hand", ICRA 2007.

Angles and disturbances are those of the paper's section VI. The parameters are the defaults of
`Scene`, which are ours: see `PARAMETER_NOTE`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from .scene import Disturbance, Pulse, Scene, Schedule, Step
from .support.arrays import read_only
from .support.checks import choice, positive

# Why the parameters are ours and not those of the paper.
PARAMETER_NOTE = (
    "The paper's Tables I and II are images that its text has lost: the parameters are ours, "
    "chosen to agree with what the text still says."
)

# Target angles (theta_1^d, theta_2^d) of operations 1 to 8, degrees, (8, 2).
OPERATIONS = read_only(
    np.array(
        [[6, 6], [20, -10], [-2, 13], [-10, 20], [-7, 17], [17, -7], [-15, 25], [5, 5]],
        dtype=np.float64,
    )
)
# Duration of each operation, s. The value is ours, because our text of the paper lacks the times;
# it is long enough for the grasp to settle.
OPERATION_TIME = 1.0
# Begin of the disturbances, when the grasp has settled, s. The value is ours.
ONSET = 1.0
# Duration of the scenes after the begin of the disturbances, s. The value is ours.
SHOWN = 1.0

# Case -> (target angle of both fingers, degrees; function from pulse duration, s, to disturbance).
_CASES: dict[str, tuple[float, Callable[[float], Disturbance]]] = {
    "i": (6.0, lambda _: Step(time=ONSET, force=(130.0, 130.0), moment=5.0)),
    "ii": (6.0, lambda d: Pulse(time=ONSET, duration=d, force=(0.9, 0.0), moment=0.327)),
    "iii": (3.0, lambda d: Pulse(time=ONSET, duration=d, force=(0.9, 0.0), moment=0.327)),
    "iv": (2.0, lambda d: Pulse(time=ONSET, duration=d, force=(0.3, 0.0), moment=0.109)),
}
# Names of the four disturbances, which `disturbance` takes.
CASES = tuple(_CASES)


def manipulation(**changes: Any) -> Scene:
    """The eight operations of section VI-A in sequence from t = 0, without disturbance.

    `changes` are fields of `Scene` to replace, as with `dataclasses.replace`.
    """
    times = OPERATION_TIME * np.arange(len(OPERATIONS))
    schedule = Schedule.steps(times, np.deg2rad(OPERATIONS))
    scene = Scene(schedule=schedule, duration=OPERATION_TIME * len(OPERATIONS))
    return replace(scene, **changes)


def disturbance(case: str, pulse_duration: float = 0.01, **changes: Any) -> Scene:
    """One of the four cases of Fig. 7: the fingers hold the object, and a disturbance acts at 1 s.

    "i" is the step (40) with both fingers at 6 degrees. "ii" is the impulse (41) at 6 degrees, a
    strong grasp. "iii" is the impulse (41) at 3 degrees, a light grasp. "iv" is the impulse (42) at
    2 degrees.

    The paper does not give the duration of the pulse delta(t) in (41, 42). Read as N s and N m s,
    its numbers throw the object out of the grasp. Here they are the height, in N and N m, of a
    pulse of length `pulse_duration`. With 10 ms the object turns by 0.68 degrees in (ii), 1.07 in
    (iii) and 0.41 in (iv). The rotation in (iii) exceeds that in (ii), as the paper says, for all
    durations from 1 to 100 ms.

    Args:
        case: "i", "ii", "iii" or "iv".
        pulse_duration: Duration of the pulse in cases "ii" to "iv", s.
        changes: Fields of `Scene` to replace, as with `dataclasses.replace`.
    """
    degrees, make = _CASES[choice("case", case, CASES)]
    pulse_duration = positive("pulse_duration", pulse_duration)
    scene = Scene(
        schedule=Schedule.steps([0.0], np.deg2rad([[degrees, degrees]])),
        disturbances=(make(pulse_duration),),
        duration=ONSET + SHOWN,
    )
    return replace(scene, **changes)
