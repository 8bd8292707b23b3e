"""`monte_carlo` refuses wrong values of `vary` by name, before it computes anything."""

from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp
from refusals import SCENE, refused

TWO = np.array([1.0, 1.0])
SMOOTH = sp.Schedule.minimum_jerk([0.0, 0.1, 0.5], np.full((3, 2), 0.1), move_time=0.2)


PATHS = {
    "grasped.mas": r"vary: 'grasped.mas': Scene.grasped has no .*mean \"grasped.mass\"",
    "graspd.mass": r"Scene has no field 'graspd'; it has .*; did you mean \"grasped.mass\"\?",
    "grasped": "GraspedObject|Scene.grasped is not a number, a pair or an array of numbers",
    "grasped.mass.x": r"GraspedObject.mass = 0.1 has no parts",
    "hand.tip.right.right.radius": "Hand.tip.right has no field 'right'",
    "schedule.kind": "Schedule.kind is not a number",
    "schedule.angles.0.2": r"Schedule.angles.0 has 0 to 1, not '2'",
    "disturbances.force": r"Scene.disturbances has 0 to 4, not 'force'",
    "disturbances.0.force.2": r"has 0 to 1, not '2'",
}


@pytest.mark.parametrize("path", PATHS)
def test_a_path_must_lead_to_numbers(path: str) -> None:
    refused(ValueError, PATHS[path], vary={path: TWO})


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("disturbances.0.force", "disturbances.0.force.1"),
        ("schedule.angles.0", "schedule.angles.0.1"),
        ("schedule.angles", "schedule.angles.1.1"),
        ("hand.tip.radius", "hand.tip.left.radius"),
        ("control.right.kp", "control.kp"),
    ],
)
def test_two_paths_to_one_number_are_refused(one: str, other: str) -> None:
    shapes = {"disturbances.0.force": (2, 2), "schedule.angles.0": (2, 2)}
    shapes |= {"schedule.angles": (2, 2, 2)}
    vary = {path: np.ones(shapes.get(path, 2)) for path in (one, other)}
    message = f"vary: '{one}' and '{other}' set the same number"
    refused(ValueError, message, vary=vary)
    refused(ValueError, "is given twice", vary={one: vary[one], (one, other): vary[other]})
    # What are two sides, or another disturbance, are not the same number.
    apart = {"hand.tip.left.radius": [0.02], "hand.tip.right.radius": [0.02]}
    assert sp.monte_carlo(sp.Scene(duration=1e-3), vary=apart, progress=False).runs == 1


def runs_of(good: object, bad: object, at: int = 5, runs: int = 9) -> np.ndarray:
    """Values of which one breaks a rule."""
    values = np.stack([np.asarray(good, float)] * runs)
    values[at] = bad
    return values


TIMES = np.linspace([0.0, 0.1, 0.2], [1.0, 1.1, 1.2], 9)
LATE = TIMES.copy()
LATE[5, 1] = TIMES[5, 0]
# Neither the least nor the greatest of any component.
FIRST = np.linspace([0.0, 0.1], [4.0, 4.1], 9)
FIRST[5, 1] = FIRST[5, 0] - 0.3
DRAWS: list[tuple[dict[str, object], str]] = [
    ({"grasped.mass": runs_of(0.1, -0.2)}, r"GraspedObject.mass = -0.2: must be finite and > 0"),
    ({"grasped.mass": runs_of(0.1, np.nan)}, "GraspedObject.mass = NaN"),
    ({"hand.tip.left.radius": runs_of(0.02, 0.0)}, r"Fingertip.radius = 0.0: must be finite"),
    ({"control.kp": runs_of(100, -1)}, "Pid.kp = -1.0: must be finite and >= 0"),
    ({"disturbances.0.force": runs_of([1, 0], [np.nan, 0])}, r"Step.force\[0\] = nan"),
    ({"disturbances.1.duration": runs_of(1e-3, -1)}, "Pulse.duration = -1.0: must be finite"),
    ({"disturbances.4.times": LATE}, r"Sampled.times\[1\] = 0.625: must be greater than the time"),
    ({"schedule.angles": runs_of(np.ones((2, 2)), np.nan)}, r"Schedule.angles\[0, 0\] = nan"),
    ({"grasped.width": runs_of(0.049, 0.01)}, "gap of .* mm|finger"),
]


@pytest.mark.parametrize(("vary", "message"), DRAWS, ids=range(len(DRAWS)))
def test_a_value_that_breaks_a_rule_says_run_field_and_value(
    vary: dict[str, object], message: str
) -> None:
    refused(ValueError, f"^run 5: .*({message})", vary=vary)
    # Its own number, whoever computes beside it; and it is asked only of runs that are computed.
    refused(ValueError, f"^run 5: .*({message})", vary=vary, only=[3, 5])
    calm = sp.monte_carlo(SCENE, vary=vary, only=[3, 6, 8], dt=1e-3, progress=False)
    assert calm.runs == 3


def test_rules_between_two_numbers_hold_in_every_run() -> None:
    # The end of a sine or a noise that is no later than its start: neither number is an extreme.
    times = np.array([0.0, 1e10, 1e12, 1.0, 2.0])
    for place in (1, 2, 3):
        durations = np.array([1.0, 1e-7, 1e3, 1e-8, 2.0])
        vary = {f"disturbances.{place}.time": times, f"disturbances.{place}.duration": durations}
        refused(ValueError, "run 1: .*duration = 1e-07: must be long enough", vary=vary)
    scene = replace(SCENE, schedule=SMOOTH)
    moves = np.array([0.1, 0.2, 0.41, 0.3])
    refused(
        ValueError, "run 2: .*moves would overlap", scene=scene, vary={"schedule.move_time": moves}
    )
    scene = replace(scene, schedule=sp.Schedule.ramps([0.0, 0.1], np.full((2, 2), 0.1)))
    refused(
        ValueError,
        r"run 1: Schedule.times\[1\] = 1.0: must be greater than the time before it, 2.0",
        scene=scene,
        vary={"schedule.times": np.array([[0, 0.5], [2.0, 1.0], [3.0, 4.0]])},
    )


def test_starts_off_the_constraints_and_out_of_reach_are_refused() -> None:
    start = sp.State.consistent(SCENE, fingers=(0.05, 0.05))
    scene = replace(SCENE, initial=start)
    q = np.tile(start.q, (4, 1))
    q[2, 0] += 1e-3
    refused(ValueError, "^run 2: .*C_1\\^H", scene=scene, vary={"initial.q": q})
    refused(ValueError, "^run 2: .*C_1\\^H", scene=scene, vary={"initial.q": q}, only=[1, 2])
    p = np.zeros((4, 9))
    p[1, 5] = 0.1
    refused(ValueError, "run 1: .*C_1\\^H", scene=scene, vary={"initial.p": p})
    refused(ValueError, "run 1: State.time = nan", scene=scene, vary={"initial.time": [0, np.nan]})
    free = replace(SCENE, initial=replace(start, check=False))
    for formulation in ("nullspace", "projected"):
        how = {"formulation": formulation, "scene": free, "vary": {"initial.q": q}}
        refused(ValueError, "run 2: .*C_1\\^H", **how)
    loose = sp.monte_carlo(free, vary={"initial.q": q}, dt=1e-3, progress=False)
    assert loose.runs == 4
    touching = replace(SCENE, initial="touching")
    widths = {"grasped.width": np.array([0.05, 0.06, 3.0])}
    refused(ValueError, "run 2: .*(reach|mm)", scene=touching, vary=widths)
