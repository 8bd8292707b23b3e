"""Stepping from outside: a program of the user's chooses the torques, period by period.

`Simulator` steps one scene and `VectorSimulator` many at once; both keep their states in the core.
`common` has what they share. `task` and `tasks` have what an agent is to learn, `episodes`
runs tasks on a simulator; the room `gym` makes environments of them.
"""

from .simulator import Observation, Simulator
from .vector import Observations, VectorSimulator

__all__ = ["Observation", "Observations", "Simulator", "VectorSimulator"]
