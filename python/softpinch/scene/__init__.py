"""The description of a simulation: frozen records, validated once and compiled for the Rust core.

`scene` makes the core's inputs of one run or many; `template` is a scene with numbers that differ
between runs. `fields` is the table of all quantities with units, symbols and usual ranges.
"""

from .control import GainSwitch, Pid, SampledController, Torque
from .disturbance import Disturbance, Impulse, Noise, Pulse, Sampled, Sine, Step
from .fields import ESTIMATED as ESTIMATED
from .hand import Finger, Fingertip, GraspedObject, Hand
from .motion import HandMotion
from .parts import Arc, Face, Jaw, Maxwell, MeasuredLaw, Parallelogram, ParallelSprings, PowerLaw
from .parts import branches as branches
from .parts import jaws as jaws
from .paths import shapes_of as shapes_of
from .scene import Scene, State
from .schedule import Schedule
from .stabilization import Stabilization
from .template import SceneTemplate as SceneTemplate

__all__ = ["Arc", "Disturbance", "Face", "Finger", "Fingertip", "GainSwitch", "GraspedObject"]
__all__ += ["Hand", "HandMotion", "Impulse", "Jaw", "Maxwell", "MeasuredLaw", "Noise"]
__all__ += ["ParallelSprings", "Parallelogram", "Pid", "PowerLaw", "Pulse", "Sampled"]
__all__ += ["SampledController", "Scene", "Schedule", "Sine", "Stabilization", "State", "Step"]
__all__ += ["Torque"]
