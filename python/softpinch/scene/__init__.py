"""The description of a simulation: frozen records, validated once and compiled for the Rust core.

The public records are in `hand`, `control`, `sampled_control`, `schedule`, `disturbance`,
`stabilization` and `scene` (which also has `State`). `compilation` and `compiled` make the core's
arrays for one run or many runs; `template` is a scene with numbers that differ between runs.
`paths` resolves dotted paths into a scene, `units` has the unit of every field, and `usual` its
usual range.
"""

from .control import Pid, Torque
from .disturbance import Disturbance, Impulse, Noise, Pulse, Sampled, Sine, Step
from .hand import Finger, Fingertip, GraspedObject, Hand
from .sampled_control import SampledController
from .scene import Scene, State
from .schedule import Schedule
from .stabilization import Stabilization

__all__ = [
    "Disturbance",
    "Finger",
    "Fingertip",
    "GraspedObject",
    "Hand",
    "Impulse",
    "Noise",
    "Pid",
    "Pulse",
    "Sampled",
    "SampledController",
    "Scene",
    "Schedule",
    "Sine",
    "Stabilization",
    "State",
    "Step",
    "Torque",
]
