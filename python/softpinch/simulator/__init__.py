"""Stepping from outside: a program of the user's chooses the torques, period by period.

`tasks` has the tasks that an agent learns, and their episodes; `gym` makes environments of them.
"""

from .simulator import Observation, Observations, Simulator, VectorSimulator

__all__ = ["Observation", "Observations", "Simulator", "VectorSimulator"]
