"""Ensembles say that the loop of the scene's sampled controller is unstable."""

import warnings
from dataclasses import replace

import pytest

import softpinch as sp
from softpinch.study import compute

SERVO = sp.SampledController.pid(1e-3, 20.0, 0.2, 0.0)
SCENE = sp.Scene(schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]]), control=SERVO, duration=0.5)
VARY = {"grasped.mass": sp.Uniform(0.08, 0.12)}


def caught(scene: sp.Scene, **how: object) -> list[str]:
    with warnings.catch_warnings(record=True) as all_of_them:
        warnings.simplefilter("always")
        sp.monte_carlo(scene, 6, vary=VARY, progress=False, **how)  # type: ignore[arg-type]
    return [
        str(one.message)
        for one in all_of_them
        if "SampledController is unstable" in str(one.message)
    ]


def test_an_unstable_loop_is_named_once() -> None:
    late = replace(SCENE, control=replace(SERVO, delay=12e-3))
    assert sp.equilibrium(late).growth > 10.0
    (text,) = caught(late)
    assert f"grows with {sp.equilibrium(late).growth:.4g} 1/s" in text
    # Not of a stable loop, of a run that ends before much has grown, and without a rest.
    assert not caught(SCENE)
    assert not caught(replace(late, duration=0.03))
    damper = sp.SampledController.pid(1e-3, 0.0, 0.2, 0.0)
    assert not caught(replace(SCENE, control=damper))


def test_runs_that_come_to_rest_are_not_looked_at_further(monkeypatch: pytest.MonkeyPatch) -> None:
    """To find the rest of a loop would take longer than to compute these runs."""

    def found(scene: sp.Scene) -> sp.Equilibrium:
        raise AssertionError("looked for a rest")

    moving = replace(SCENE, duration=0.021)
    assert not caught(moving)
    monkeypatch.setattr(compute, "equilibrium", found)
    assert not caught(SCENE)
    assert not caught(moving)  # nor twice
    with pytest.raises(AssertionError, match="looked for a rest"):
        caught(SCENE, summaries="margin")  # without the rates at the end
    with pytest.raises(AssertionError, match="looked for a rest"):
        caught(replace(SCENE, duration=0.022))
