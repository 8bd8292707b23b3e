"""Jaws and parallelograms, faces and arcs, laws of the tip: through the public names."""

import numpy as np
import pytest

import softpinch as sp
from other_hands import FACTS, scene_of


@pytest.mark.parametrize("name", FACTS)
def test_the_scenes_of_an_independent_program_end_where_it_says(name: str) -> None:
    fact = FACTS[name]
    run = sp.simulate(
        scene_of(name), method="dop853", tolerance=1e-12, formulation="nullspace",
        record=("state", "multipliers", "energy"),
    )  # fmt: skip
    assert run.status == "completed"
    state = run.state(-1)
    assert np.abs(state.q - np.array(fact["q"], float)).max() < 1e-9
    assert np.abs(state.p - np.array(fact["p"], float)).max() < 1e-9
    assert np.abs(np.array(state.integral) - np.array(fact["integral"], float)).max() < 1e-9
    assert np.abs(run.multipliers[-1] - np.array(fact["multipliers"], float)).max() < 1e-7
    assert run.energy.controller_work[-1] == pytest.approx(fact["work"]["torque"], abs=1e-9)
