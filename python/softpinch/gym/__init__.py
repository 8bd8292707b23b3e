"""Environments for Gymnasium: `gymnasium.make("softpinch/Pinch-v0")`. Needs the extra `gym`.

    import gymnasium
    import softpinch.gym  # registers the environments

    env = gymnasium.make("softpinch/Pinch-v0")
    envs = gymnasium.make_vec("softpinch/Pinch-v0", num_envs=256)

Rewards, pushes and observations are those of a task: `HoldAgainstPushes`, `FollowPath`,
`HoldWithLeastGrip`, or a class of your own derived from `Task`.
"""

from ..simulator.tasks import (
    Episode,
    FollowPath,
    HoldAgainstPushes,
    HoldWithLeastGrip,
    Measure,
    Task,
    Transition,
)
from ..support.extras import require

require("gymnasium", extra="gym", purpose="softpinch.gym")

from gymnasium.envs.registration import register, registry  # noqa: E402

from .environments import PinchEnv, PinchVectorEnv  # noqa: E402

__all__ = ["Episode", "FollowPath", "HoldAgainstPushes", "HoldWithLeastGrip", "Measure", "PinchEnv"]
__all__ += ["PinchVectorEnv", "Task", "Transition"]

ID = "softpinch/Pinch-v0"
# A second import, for example after a reload, finds it registered already.
if ID not in registry:
    register(ID, "softpinch.gym:PinchEnv", vector_entry_point="softpinch.gym:PinchVectorEnv")
