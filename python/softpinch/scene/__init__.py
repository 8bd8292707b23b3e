"""What is simulated: hand, object, control, schedule, disturbances, and where it starts.

Descriptions are frozen, checked once, and compiled here to the numbers that the core takes. Here
are also the dotted paths into a scene, the units of its numbers, and what is usual for them.
"""

from .disturbance import Disturbance, Impulse, Noise, Pulse, Sampled, Sine, Step
from .hand import Finger, Fingertip, GraspedObject, Hand, Pid
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
    "Scene",
    "Schedule",
    "Sine",
    "Stabilization",
    "State",
    "Step",
]
