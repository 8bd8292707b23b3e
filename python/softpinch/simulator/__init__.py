"""Stepping from outside: a program of the user's chooses the torques, period by period.

`Simulator` steps one scene and `VectorSimulator` many at once; both keep their states in the core.
`tasks` has the tasks that an agent learns, and their episodes; the room `gym` makes environments of
them.
"""

from .simulator import Observation, Observations, Simulator, VectorSimulator

__all__ = ["Observation", "Observations", "Simulator", "VectorSimulator"]
