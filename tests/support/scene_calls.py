"""Arguments that the constructors and methods of a scene's parts take, for `callables`."""

from typing import Any

TIMES, ANGLES = [0.0, 0.1], [[0.1, 0.1], [0.2, 0.2]]

# "Class.method" -> arguments, every parameter that has no default among them.
SCENE_CALLS: dict[str, dict[str, Any]] = {
    "GraspedObject.box": {"width": 0.05, "height": 0.05, "mass": 0.1},
    "GraspedObject.cylinder": {"length": 0.05, "radius": 0.02, "mass": 0.1},
    "Schedule": {"kind": "steps", "times": TIMES, "angles": ANGLES},
    "Schedule.steps": {"times": TIMES, "angles": ANGLES},
    "Schedule.ramps": {"times": TIMES, "angles": ANGLES},
    "Schedule.minimum_jerk": {"times": TIMES, "angles": ANGLES, "move_time": 0.05},
    "Schedule.in_degrees": {"kind": "steps", "times": TIMES, "angles": ANGLES},
    "Schedule.sampled": {"times": TIMES, "angles": ANGLES},
    "Schedule.target": {"t": [0.0, 0.1]},
    "Scene.from_toml": {"source": "duration = 1.0"},
    "Scene.with_": {"values": {"grasped.mass": 0.2}},
}
