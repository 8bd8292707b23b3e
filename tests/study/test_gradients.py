"""Gradients of summaries are those of the rows of each run at its own peak or end."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from derivative_scenes import LOADS, entries, uneven
from softpinch import _core

SUMMARIES = (
    "final_state",
    "peak_rotation",
    "min_compression",
    "peak_friction_angle",
    "peak_friction_ratio",
    "peak_torque",
)
RECORD = ("state", "multipliers", "torque")
SCENE = uneven(disturbances=LOADS)
VARY: dict[str | tuple[str, ...], Any] = {
    "hand.tip.right.youngs_modulus": np.array([2.5e5, 3e5, 3.5e5, 4e5]),
    "disturbances.0.force": np.array([[3.0, -2.0], [1.0, 2.0], [-4.0, 0.5], [2.0, 2.0]]),
    "schedule.angles.1": np.deg2rad([[8.0, 3.0], [7.0, 5.0], [4.0, 9.0], [6.0, 6.0]]),
}
PATHS = ("hand.tip.right.youngs_modulus", "disturbances.0.force", "schedule.angles.1", "gravity")


def expected(run: sp.Run, path: str, after: float = -np.inf) -> dict[str, Any]:
    """Summary -> its derivative by the value at a path, (18, ...) or (...), from a run's rows."""
    found = run.sensitivity
    seen = np.flatnonzero(run.t >= after)
    by_state, by_force, by_torque = found[path], found.multipliers[path], found.torque[path]

    def at(place: Any, values: Any, slopes: Any, sign: bool = True) -> Any:
        row, side = place
        return (np.sign(values[row, side]) if sign else 1.0) * slopes[row, side]

    def place(values: Any, largest: bool = True) -> tuple[int, int]:
        pick = np.argmax if largest else np.argmin
        row, side = np.unravel_index(pick(values[seen]), values[seen].shape)
        return int(seen[row]), int(side)

    rotation = run.q[:, 2:3]
    normal, tangential = run.multipliers[:, :2], np.abs(run.multipliers[:, 2:])
    ratio = np.where(normal > 0.0, tangential / normal, np.inf)
    angle = place(np.arctan2(tangential, normal))
    row, side = angle
    x, y = normal[row, side], tangential[row, side]
    turn = np.sign(run.multipliers[row, 2 + side]) * by_force[row, 2 + side]
    by_angle = (x * turn - y * by_force[row, side]) / (x**2 + y**2)
    return {
        "final_state": by_state[-1],
        "peak_rotation": at(place(np.abs(rotation)), rotation, by_state[:, 2:3]),
        "min_compression": at(place(run.q[:, 5:7], False), run.q[:, 5:7], by_state[:, 5:7], False),
        "peak_friction_angle": by_angle,
        # d tan(angle) = (1 + tan^2) d angle.
        "peak_friction_ratio": by_angle * (1 + (y / x) ** 2)
        if np.isfinite(ratio).all()
        else np.nan,
        "peak_torque": at(place(np.abs(run.torque)), run.torque, by_torque),
    }


# Of the angle and the ratio, the same sums are taken in another order.
EXACT = ("final_state", "peak_rotation", "min_compression", "peak_torque")


def require_rows_of_runs(ensemble: sp.Ensemble, paths: Any, **how: Any) -> None:
    for row, number in enumerate(ensemble.run):
        scene = ensemble.scene_of(number)
        run = sp.simulate(scene, record=RECORD, sensitivities=paths, **how)
        for path in paths:
            for summary, theirs in expected(run, path).items():
                ours = ensemble.gradients[summary][path][row]
                if summary in EXACT:
                    np.testing.assert_array_equal(ours, theirs, f"{summary} by {path}")
                else:
                    np.testing.assert_allclose(
                        ours, np.broadcast_to(theirs, ours.shape), rtol=1e-10, err_msg=summary
                    )


@pytest.mark.parametrize("method", _core.METHODS)
@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_gradients_are_those_of_the_rows_at_the_peak(method: str, formulation: str) -> None:
    how: Any = {"dt": 5e-4, "method": method, "formulation": formulation}
    ensemble = sp.monte_carlo(
        SCENE, vary=VARY, gradients=SUMMARIES, sensitivities=PATHS, progress=False, **how
    )
    assert set(ensemble.gradients) == set(SUMMARIES)
    require_rows_of_runs(ensemble, PATHS, **how)


@pytest.mark.parametrize("method", ["dop853", "radau5", "rosenbrock"])
def test_gradients_with_adaptive_steps_are_those_of_the_rows_at_the_peak(method: str) -> None:
    how: Any = {"tolerance": 1e-7, "method": method}
    ensemble = sp.monte_carlo(
        SCENE, vary=VARY, gradients=SUMMARIES, sensitivities=PATHS, progress=False, **how
    )
    require_rows_of_runs(ensemble, PATHS, **how)


def test_paths_are_those_of_vary_if_left_out_and_threads_change_no_bit() -> None:
    one, two = (
        sp.monte_carlo(
            SCENE, vary=VARY, dt=1e-3, gradients=SUMMARIES, threads=n, progress=False
        ).gradients
        for n in (1, 2)
    )
    assert list(one["final_state"]) == list(VARY)
    for summary in SUMMARIES:
        for path in VARY:
            np.testing.assert_array_equal(one[summary][path], two[summary][path])
            shape = (18,) if summary == "final_state" else ()
            value = entries(SCENE, path)[-1]
            assert one[summary][path].shape == (4, *shape, *(k + 1 for k in value))


def test_instants_before_summaries_after_are_left_out_of_gradients_as_of_summaries() -> None:
    how: Any = {"dt": 5e-4, "summaries_after": 0.012}
    ensemble = sp.monte_carlo(
        SCENE, vary=VARY, gradients=SUMMARIES, sensitivities="gravity", progress=False, **how
    )
    rows = [
        sp.simulate(ensemble.scene_of(k), dt=5e-4, record=RECORD, sensitivities="gravity")
        for k in ensemble.run
    ]
    for name in EXACT:
        theirs = np.array([expected(run, "gravity", 0.012)[name] for run in rows])
        np.testing.assert_array_equal(ensemble.gradients[name]["gravity"], theirs, name)


@pytest.mark.parametrize("exponent", [1.6, 2.5])
def test_the_margin_of_tips_with_another_law_has_the_derivative_of_its_scale_too(
    exponent: float,
) -> None:
    """Forces count in the modulus with which (5) would be as stiff: it changes with the law."""
    numbers = {"coefficient": 2.5e5 * 0.01 ** (2.0 - exponent), "exponent": exponent}

    def grasp(**changes: float) -> sp.Scene:
        c, n = {**numbers, **changes}.values()
        law = {"law": sp.PowerLaw(c, n, foot=1e-4), "youngs_modulus": 3e5}
        tips = tuple(replace(tip, **law) for tip in SCENE.hand.tips)
        return uneven(friction=(0.9, 0.9), hand=replace(SCENE.hand, tip=tips))

    def margin(scene: sp.Scene) -> float:
        rows = sp.monte_carlo(scene, 1, dt=5e-4, summaries="margin", progress=False)
        return float(rows["margin"][0])

    for name, path in (("coefficient", "law.coefficient"), ("exponent", "law.exponent")):
        sides = [f"hand.tip.{side}.{path}" for side in ("right", "left")]
        found = sp.monte_carlo(
            grasp(), 1, dt=5e-4, gradients="margin", sensitivities=sides, progress=False
        ).gradients["margin"]
        size = numbers[name]
        ours = size * sum(float(found[side][0]) for side in sides)
        after, before = (margin(grasp(**{name: size * (1.0 + by)})) for by in (1e-5, -1e-5))
        assert ours == pytest.approx((after - before) / 2e-5, rel=1e-5), name


def test_gradients_of_a_run_that_ends_early_are_those_of_its_end() -> None:
    scene = replace(SCENE, disturbances=(sp.Step(time=0.001, force=(400.0, 0.0)),))
    ensemble = sp.monte_carlo(
        scene, 1, dt=5e-4, gradients="final_state", sensitivities="gravity", progress=False
    )
    assert ensemble.status[0] == "separated"
    run = sp.simulate(ensemble.scene_of(0), dt=5e-4, sensitivities="gravity")
    np.testing.assert_array_equal(
        ensemble.gradients["final_state"]["gravity"][0], run.sensitivity["gravity"][-1]
    )


@pytest.mark.parametrize(
    ("how", "error", "text"),
    [
        ({"gradients": "settling_time"}, ValueError, "gradients"),
        ({"sensitivities": "gravity"}, ValueError, "goes with gradients"),
        ({"gradients": "final_state"}, ValueError, "give sensitivities"),
        (
            {"gradients": "final_state", "sensitivities": "mass"},
            ValueError,
            "sensitivities: 'mass'",
        ),
        (
            {"gradients": "final_state", "sensitivities": "gravity", "store": "folder"},
            ValueError,
            "gradients and store",
        ),
    ],
)
def test_wrong_arguments_are_refused_before_any_run(
    how: dict[str, Any], error: type[Exception], text: str
) -> None:
    with pytest.raises(error, match=text):
        sp.monte_carlo(SCENE, 2, dt=1e-3, progress=False, **how)


def test_gradients_that_were_not_asked_for_are_an_error_that_says_what_to_do() -> None:
    plain = sp.monte_carlo(SCENE, 2, dt=1e-3, progress=False)
    with pytest.raises(sp.NotRecordedError, match=r"pass gradients=\(summary, ...\)"):
        _ = plain.gradients
    ensemble = sp.monte_carlo(
        SCENE, 2, dt=1e-3, gradients="final_state", sensitivities="gravity", progress=False
    )
    with pytest.raises(KeyError, match='gradients of "final_state"'):
        _ = ensemble.gradients["peak_torque"]


def test_a_mass_that_a_run_sets_does_not_follow_the_mass_of_the_object() -> None:
    ensemble = sp.monte_carlo(
        sp.Scene(duration=0.02, disturbances=[sp.Step(time=0.0, force=(1.0, 2.0))]),
        vary={"hand.tip.normal_mass": [0.01, 0.03]},
        dt=1e-3,
        gradients="final_state",
        sensitivities="grasped.mass",
        progress=False,
    )
    for k in range(2):
        run = sp.simulate(ensemble.scene_of(k), 1e-3, sensitivities="grasped.mass")
        found = ensemble.gradients["final_state"]["grasped.mass"][k]
        assert (found == run.sensitivity["grasped.mass"][-1]).all()


def test_copies_of_an_ensemble_keep_its_gradients() -> None:
    ensemble = sp.monte_carlo(
        SCENE, vary={"gravity": [9.0, 10.0]}, dt=1e-3, gradients="peak_rotation", progress=False
    )
    again = pickle.loads(pickle.dumps(ensemble)).gradients["peak_rotation"]["gravity"]
    assert (again == ensemble.gradients["peak_rotation"]["gravity"]).all()
