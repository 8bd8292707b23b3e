"""What `explain` and `evaluate` say of scenes with unilateral contact."""

import re
from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp
from unilateral_scenes import RECORD, gripped, regripped


def test_explain_names_the_modes_and_what_it_does_not_count() -> None:
    scene = regripped()
    found = sp.explain(scene, record=RECORD, measure=False)
    both = sp.explain(replace(scene, contact="bilateral"), record=RECORD, measure=False)
    assert "contact modes" in found.kept and "contact modes" in both.left_out
    assert found.operations == both.operations
    assert "floating-point operations, without those of modes and events\n" in str(found)
    assert "modes and events" not in str(both)
    # Friction, impacts and relaxation join the four works of bilateral contact.
    assert found.states == both.states + 3 == 27
    bare = sp.explain(scene, measure=False)
    assert bare.states == 20
    assert found.steps == sp.simulate(scene).stats["steps"]
    with pytest.raises(ValueError, match=r'^formulation = "nullspace": must be one of "csm" or'):
        sp.explain(scene, formulation="nullspace", measure=False)


def test_evaluate_refuses_it_and_says_what_to_do() -> None:
    scene = gripped()
    run = sp.simulate(scene, dt=1e-5, formulation="projected", record=("state", "multipliers"))
    state = run.t[-1], run.q[-1], run.p[-1], run.integral[-1]
    message = 'Scene.contact = "unilateral": evaluate has the terms of bilateral contact only; '
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        sp.evaluate(scene, *state)
    terms = sp.evaluate(replace(scene, contact="bilateral"), *state, formulation="projected")
    # Both tips stick here.
    np.testing.assert_allclose(terms.multipliers, run.multipliers[-1], rtol=1e-9, atol=1e-7)
