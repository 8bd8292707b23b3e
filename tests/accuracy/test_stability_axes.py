"""The named axes of stability maps: what each sets in a scene, and which values it spans."""

import numpy as np
import pytest

import softpinch as sp
from scenes import uneven
from softpinch.accuracy import stability_axes

SCENE = sp.Scene(schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 4.8]])), duration=0.03)
UNEVEN = uneven()


def reached(axis: str, value: float, scene: sp.Scene) -> tuple[sp.Scene, sp.State]:
    found, _ = stability_axes.AXES[axis].apply(scene, sp.Stabilization(), value)
    state = found.start()
    terms = sp.evaluate(found, state.time, state.q, state.p, state.integral)
    # Consistent, at rest, and with the fingers held where they are.
    assert np.abs(terms.residuals).max() < 1e-12 and not state.p.any()
    assert found.schedule.target(0.0) == pytest.approx(state.q[3:5])
    free = sp.evaluate(found, state.time, state.q, state.p)
    assert np.abs(terms.accelerations[3:5]).max() <= 1e-6 * np.abs(free.accelerations[3:5]).max()
    return found, state


@pytest.mark.parametrize("scene", [SCENE, UNEVEN], ids=["paper", "uneven"])
@pytest.mark.parametrize("share", [1e-4, 0.3, 0.999])
def test_grasps_start_as_deep_as_asked(scene: sp.Scene, share: float) -> None:
    found, state = reached("grasp_depth", share, scene)
    tips = found.hand.tips
    radii = np.array([tip.radius for tip in tips])
    assert state.q[5:7] / radii == pytest.approx([share] * 2, rel=1e-9)
    assert state.q[2] == 0.0 and found.hand == scene.hand


@pytest.mark.parametrize("scene", [SCENE, UNEVEN], ids=["paper", "uneven"])
@pytest.mark.parametrize("degrees", [0.0, 60.0, 89.0])
def test_grasps_start_as_tilted_as_asked(scene: sp.Scene, degrees: float) -> None:
    found, state = reached("tilt", degrees, scene)
    tips = found.hand.tips
    tilts = state.q[3:5] + np.array([-1.0, 1.0]) * state.q[2]
    assert np.rad2deg(tilts) == pytest.approx([degrees] * 2)
    assert state.q[5:7] == pytest.approx([0.05 * tip.radius for tip in tips])


@pytest.mark.parametrize("scene", [SCENE, UNEVEN], ids=["paper", "uneven"])
def test_the_other_axes_set_the_parameters_of_their_names(scene: sp.Scene) -> None:
    def numbers(axis: str, value: float) -> dict[str, float]:
        found, _ = stability_axes.AXES[axis].apply(scene, sp.Stabilization(), value)
        return dict(zip(sp._core.PARAMETERS, found.parameters().tolist(), strict=True))

    before = dict(zip(sp._core.PARAMETERS, scene.parameters().tolist(), strict=True))

    def changed(axis: str, value: float) -> dict[str, float]:
        return {name: x for name, x in numbers(axis, value).items() if x != before[name]}

    sides = ("right", "left")
    assert changed("youngs_modulus", 7e5) == {f"hand.tip.{s}.youngs_modulus": 7e5 for s in sides}
    kinds = ("normal", "tangential")
    expected = {f"hand.tip.{side}.{kind}_viscosity": 0.0 for side in sides for kind in kinds}
    assert changed("viscosity", 0.0) == expected
    heavy = changed("object_mass", 3.0)
    assert heavy["grasped.mass"] == 3.0
    assert heavy["grasped.inertia"] == pytest.approx(
        before["grasped.inertia"] * 3.0 / before["grasped.mass"]
    )
    stiff = changed("gains", 4.0)
    assert stiff == {name: 4.0 * before[name] for name in before if name.startswith("control.")}
    blown, _ = stability_axes.AXES["impulse"].apply(scene, sp.Stabilization(), 2.0)
    (blow,) = blown.disturbances
    assert blow.time == pytest.approx(0.25 * scene.duration)
    assert np.hypot(*blow.impulse) == pytest.approx(2.0)
