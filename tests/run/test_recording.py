"""Recording, going on and instructions change nothing in what is computed."""

import os
import subprocess
import sys
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from scenes import some_scene
from softpinch import _core, strategies

EVERYTHING = ("state", "multipliers", "residuals", "energy")


@pytest.mark.parametrize("record", [(), *combinations(EVERYTHING, 1), EVERYTHING[:3]], ids=str)
@pytest.mark.parametrize("method", _core.METHODS)
def test_recording_less_changes_nothing_in_what_is_recorded(
    method: str, record: tuple[str, ...]
) -> None:
    full = sp.simulate(some_scene(), dt=3e-4, method=method, record=EVERYTHING)
    less = sp.simulate(some_scene(), dt=3e-4, method=method, record=record, every=7)
    rows = [*range(0, len(full.t) - 1, 7), len(full.t) - 1]
    np.testing.assert_array_equal(less.t, full.t[rows])
    if "state" in record:
        np.testing.assert_array_equal(less.q, full.q[rows])
        np.testing.assert_array_equal(less.p, full.p[rows])
    if "multipliers" in record:
        np.testing.assert_array_equal(less.multipliers, full.multipliers[rows])
    if "residuals" in record:
        np.testing.assert_array_equal(less.residuals, full.residuals[rows])
    if "energy" in record:
        np.testing.assert_array_equal(less.energy.closure, full.energy.closure[rows])
    assert less.status == full.status
    assert less.violations == full.violations
    assert less.state(-1) == full.state(-1)
    if ("energy" in record) or method in ("rk4", "dop853", "rosenbrock"):
        assert less.stats == full.stats
    else:
        # The ledger's works take the powers at the solved stages.
        assert less.stats["iterations"] == full.stats["iterations"]
        assert less.stats["evaluations"] < full.stats["evaluations"]


@given(
    st.sampled_from(["pid", "driven"]).flatmap(
        lambda fingers: strategies.scenes(duration=0.03, fingers=fingers)
    ),
    st.floats(0, 1),
    st.sampled_from([1e-4, 3e-4, 7.3e-5]),
    st.sampled_from(_core.METHODS),
    st.sampled_from(_core.FORMULATIONS),
)
def test_a_run_goes_on_from_any_recorded_state_to_the_same_bits(
    scene: sp.Scene, share: float, dt: float, method: str, formulation: str
) -> None:
    options = {"dt": dt, "method": method, "formulation": formulation}
    whole = sp.simulate(scene, **options)
    k = int(share * (len(whole.t) - 2))
    rest = scene.duration - (whole.t[k] - whole.t[0])
    if not whole.success or rest <= 0:
        return
    went_on = sp.simulate(replace(scene, initial=whole.state(k), duration=rest), **options)
    assert len(went_on.t) == len(whole.t) - k
    if went_on.t[-1] == whole.t[-1]:  # whole.t[k] + rest may round to a neighbour
        np.testing.assert_array_equal(went_on.q, whole.q[k:])
        np.testing.assert_array_equal(went_on.p, whole.p[k:])


def test_an_unknown_level_is_refused_by_name() -> None:
    done = subprocess.run(
        [sys.executable, "-c", "import softpinch as sp; sp.simulate(sp.Scene())"],
        env={**os.environ, "SOFTPINCH_SIMD": "sse9"},
        capture_output=True,
        text=True,
        check=False,
    )
    allowed = ", ".join(f'"{level}"' for level in _core.SIMD_LEVELS)
    assert f'SOFTPINCH_SIMD = "sse9": must be one of {allowed}' in done.stderr
