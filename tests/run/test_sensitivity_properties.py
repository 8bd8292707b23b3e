"""Exact properties of derivatives: symmetries, sums, and the same bits in other ways."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import derivative_paths as paths_of
import softpinch as sp
from derivative_differences import difference, of
from derivative_scenes import LOADS, SHARED, entries, moving, shared, uneven
from differences import changed
from softpinch import _core, strategies
from softpinch.run.ledger import LEDGER
from softpinch.run.options import STOP_ON
from transforms import MIRROR_MULTIPLIERS, MIRROR_ORDER, MIRROR_SIGN, Units, mirrored

RECORD = ("state", "multipliers", "torque", "energy", "residuals")
ALL = ("state", "integral", "multipliers", "torque")
DT = 5e-4
few = settings(max_examples=20)
scenes = strategies.scenes(duration=0.02)
methods = st.sampled_from(_core.METHODS)
formulations = st.sampled_from(_core.FORMULATIONS)
# Powers of two, so that the remaining time after each of them is exact.
BREAKS = tuple(k / 4096 for k in (23, 34, 46))
END = 82 / 4096
IMPULSES = (
    sp.Impulse(time=BREAKS[0], impulse=(0.02, -0.01), angular_impulse=3e-4),
    sp.Impulse(time=BREAKS[2], impulse=(-0.02, 0.01)),
)


def simulated(scene: sp.Scene, method: str, formulation: str, paths: Any, **more: Any) -> sp.Run:
    how = {"dt": DT, "record": RECORD, "stop_on": (), **more}
    return sp.simulate(scene, method=method, formulation=formulation, sensitivities=paths, **how)


def require_same_bits(ours: sp.Run, theirs: sp.Run, path: str, rows: Any = slice(None)) -> None:
    """All derivatives of both runs by a path are equal."""
    for name in ALL:
        np.testing.assert_array_equal(of(ours, name, path), of(theirs, name, path)[rows], name)
    for name, column in ours.sensitivity.energy.items():
        np.testing.assert_array_equal(column[path], theirs.sensitivity.energy[name][path][rows])


@pytest.mark.parametrize("method", _core.METHODS)
def test_the_derivative_by_the_start_begins_with_the_identity(method: str) -> None:
    paths = ("initial.q", "initial.p", "initial.integral")
    found = simulated(moving(uneven()), method, "csm", paths).sensitivity
    np.testing.assert_array_equal(found["initial.q"][0], np.eye(18)[:, :9])
    np.testing.assert_array_equal(found["initial.p"][0], np.eye(18)[:, 9:])
    np.testing.assert_array_equal(found.integral["initial.integral"][0], np.eye(2))
    assert not found["initial.integral"][0].any()


@few
@given(scenes, methods, formulations, st.sampled_from(["length", "mass"]))
def test_derivatives_obey_eulers_theorem(
    scene: sp.Scene, method: str, formulation: str, unit: str
) -> None:
    """A unit of length or mass that is smaller changes all numbers and the motion with them."""
    other = Units(**{"length": 0, "mass": 0, "time": 0} | {unit: 1}).scene(scene)
    paths = paths_of.sided(scene) + paths_of.inputs(scene)
    run = simulated(scene, method, formulation, paths)
    assume(run.success)
    terms = []
    for path in paths:
        numbers, scaled = paths_of.value(scene, path), paths_of.value(other, path)
        with np.errstate(invalid="ignore", divide="ignore"):
            power = np.where(numbers == 0.0, 0.0, np.log2(scaled / numbers))
        share = run.sensitivity[path] * (numbers * power)
        terms.append(share.reshape(*share.shape[:2], -1).sum(axis=2))
    whole = np.sum(terms, axis=0)
    if unit == "length":
        lengths = np.tile([1, 1, 0, 0, 0, 1, 1, 1, 1], 2)
        whole = whole - np.hstack([run.q, run.p]) * lengths
    assert np.isfinite(whole).all()
    sizes = np.abs(terms).max(axis=(0, 1)) + 1e-3
    assert (np.abs(whole) <= 1e-9 * sizes).all()


@few
@given(scenes, methods, formulations)
def test_the_mirror_image_has_mirrored_derivatives(
    scene: sp.Scene, method: str, formulation: str
) -> None:
    swap = {"right": "left", "left": "right"}
    image_of = {
        path: ".".join(swap.get(step, step) for step in path.split("."))
        for path in paths_of.sided(scene)
    }
    run = simulated(scene, method, formulation, [*image_of, "schedule.angles"])
    assume(run.success)
    image = simulated(mirrored(scene), method, formulation, [*image_of.values(), "schedule.angles"])
    order = [*MIRROR_ORDER, *(9 + k for k in MIRROR_ORDER)]
    sign = np.tile(MIRROR_SIGN, 2)
    pairs: list[tuple[str, str, tuple[int, ...]]] = [
        (path, own, ()) for path, own in image_of.items()
    ]
    pairs += [
        ("schedule.angles", "schedule.angles", at) for at in entries(scene, "schedule.angles")
    ]
    for path, own, at in pairs:
        turned = (at[0], 1 - at[1]) if at else at
        flip = -1.0 if path == "grasped.com_offset" else 1.0
        # A derivative that is only round-off is small beside the motion and the number.
        least = 1e-4 / paths_of.size(scene, path, at)
        theirs = flip * of(image, "state", own, turned)[:, order] * sign
        motion = np.hstack([run.q, run.p])
        assert difference(theirs, of(run, "state", path, at), "state", least * motion) <= 1e-8, path
        ours = of(run, "multipliers", path, at)
        forces = flip * of(image, "multipliers", own, turned)[:, MIRROR_MULTIPLIERS]
        off = difference(forces, ours, "multipliers", least * run.multipliers)
        assert off <= 1e-8, path


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize("method", _core.METHODS)
def test_the_two_sides_add_up_to_the_derivative_by_what_they_share(
    method: str, formulation: str
) -> None:
    scene = shared(initial="touching")
    both = simulated(scene, method, formulation, SHARED)
    for path in SHARED:
        if path.startswith("grasped"):
            continue
        owner, _, name = path.rpartition(".")
        sides = [f"{owner}.{side}.{name}" for side in ("right", "left")]
        each = simulated(scene, method, formulation, sides)
        for quantity in ALL:
            together = sum(of(each, quantity, side) for side in sides)
            assert difference(together, of(both, quantity, path), quantity) <= 1e-11, path


@few
@given(st.data(), methods, formulations)
def test_a_run_that_goes_on_has_the_bits_of_the_whole_derivatives(
    data: st.DataObject, method: str, formulation: str
) -> None:
    schedule = sp.Schedule.steps([0.0, BREAKS[1]], np.deg2rad([[4, 5], [8, 3]]))
    scene = uneven(disturbances=(*IMPULSES, *LOADS), schedule=schedule, duration=END)
    paths = ["hand.right.length", "grasped.mass", "schedule.angles", "disturbances.0.impulse"]
    paths += ["schedule.times", "disturbances.1.time", "disturbances.2.duration", "control.left.ki"]
    run = simulated(scene, method, formulation, paths)
    at_breaks = [int(k) for k in np.flatnonzero(np.isin(run.t, BREAKS))]
    assert len(at_breaks) == 3
    k = data.draw(st.one_of(st.sampled_from(at_breaks), st.integers(0, len(run.t) - 2)))
    left = END - float(run.t[k])
    # Else the last step has another length, by round-off.
    assume(run.t[k] + left == END)
    rest = replace(scene, initial=run.state(k), duration=left)
    again = simulated(rest, method, formulation, run.sensitivity.at(k))
    np.testing.assert_array_equal(again.q, run.q[k:])
    for path in paths:
        for name in ("state", "integral", "multipliers", "torque"):
            ours, theirs = of(again, name, path), of(run, name, path)[k:]
            np.testing.assert_array_equal(ours, theirs, f"{name} by {path} from row {k}")


@few
@given(scenes, methods, formulations, st.booleans())
def test_a_run_has_the_same_bits_with_derivatives_and_without(
    scene: sp.Scene, method: str, formulation: str, free: bool
) -> None:
    how: dict[str, Any] = {"stop_on": STOP_ON}
    if free and method in ("dop853", "radau5", "rosenbrock"):
        how |= {"dt": None, "tolerance": 1e-6}
    paths = [*paths_of.sided(scene), *paths_of.inputs(scene)]
    plain, run = (simulated(scene, method, formulation, one, **how) for one in ((), paths))
    assert (run.status, run.holds) == (plain.status, plain.holds)
    assert run.stats == plain.stats
    assert run.violations == plain.violations
    for name in ("t", "q", "p", "integral", "multipliers", "torque", "residuals"):
        np.testing.assert_array_equal(getattr(run, name), getattr(plain, name), name)
    assert len(run.sensitivity[paths[0]]) == len(run.t)


@few
@given(scenes, st.randoms(use_true_random=False), methods, formulations)
def test_the_order_and_the_number_of_paths_change_no_bit(
    scene: sp.Scene, random: Any, method: str, formulation: str
) -> None:
    paths = [*paths_of.sided(scene), *paths_of.inputs(scene), *paths_of.inputs(scene, times=True)]
    run = simulated(scene, method, formulation, paths)
    assume(run.success)
    shuffled = random.sample(paths, len(paths))
    other = simulated(scene, method, formulation, shuffled)
    assert list(other.sensitivity) == shuffled
    for path in paths:
        require_same_bits(other, run, path)
    alone = random.choice(paths)
    require_same_bits(simulated(scene, method, formulation, alone), run, alone)


@pytest.mark.parametrize("method", _core.METHODS)
@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_derivatives_of_energies_are_those_of_the_ledger(method: str, formulation: str) -> None:
    """Beside differences; and the ledger's closure, which stays small, has a small derivative."""
    scene = uneven(duration=0.01, disturbances=(sp.Step(time=0.00213, force=(1.0, 2.0)),))
    path, h = "hand.tip.right.youngs_modulus", 30.0
    how: dict[str, Any] = {
        "dt": 2e-4,
        "method": method,
        "formulation": formulation,
        "record": ("state", "energy"),
    }
    run = sp.simulate(scene, **how, sensitivities=path)
    stiff, soft = (sp.simulate(changed(scene, path, (), by), **how).energy for by in (h, -h))
    assert set(run.sensitivity.energy) <= set(LEDGER)
    largest = 0.0
    for name, found in run.sensitivity.energy.items():
        theirs = (getattr(stiff, name) - getattr(soft, name)) / (2.0 * h)
        largest = max(largest, float(np.abs(theirs).max()))
        assert np.abs(found[path] - theirs).max() <= 1e-6 * largest + 1e-15, name
