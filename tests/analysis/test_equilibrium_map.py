"""Maps of equilibria: each cell balances, and no cell comes from a jump over a fold."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import softpinch as sp
from resting import held, leaning
from transforms import Units

OFFSETS = np.linspace(-2e-3, 2e-3, 21)
MASSES = np.linspace(1.0, 4.0, 13)
# The rotation along a branch changes less between neighbouring cells; to the other branch, more.
SMOOTH = np.deg2rad(3.5)


def over_offsets(start: float) -> sp.EquilibriumMap:
    return sp.equilibrium_map(leaning(4.0, start), {"grasped.com_offset": OFFSETS}, progress=False)


@cache
def cusp() -> sp.EquilibriumMap:
    axes = {"grasped.com_offset": OFFSETS, "grasped.mass": MASSES}
    return sp.equilibrium_map(leaning(1.0, 0.0), axes, progress=False)


def acceleration(cell: sp.Equilibrium) -> float:
    """The largest acceleration of the object at rest, m/s^2 and rad/s^2."""
    assert cell.state is not None
    q, p, integral = cell.state.q, cell.state.p, cell.state.integral
    found = sp.evaluate(cell.scene, cell.time, q, p, integral, formulation="nullspace")
    return float(np.abs(found.accelerations[:3]).max())


def test_every_cell_is_at_rest_in_its_own_scene() -> None:
    axes = {"schedule.angles.0.0": np.linspace(0.05, 0.2, 4), "grip.left": [-0.01, 0.0, 0.002]}
    map = sp.equilibrium_map(held(), axes, grip=(0.003, 0.0), progress=False)
    assert map.shape == (4, 3)
    for i, j in np.ndindex(4, 3):
        angle, grip = axes["schedule.angles.0.0"][i], axes["grip.left"][j]
        cell = map.equilibrium(i, j)
        assert cell.scene.schedule.angles[0, 0] == angle
        np.testing.assert_allclose(cell.grip, [0.003, grip], rtol=0.0, atol=1e-12)
        assert acceleration(cell) < 1e-8
        assert cell.state is not None
        np.testing.assert_array_equal(map.q[i, j], cell.state.q)
        assert map.rotation[i, j] == cell.state.q[2] and map.energy[i, j] == cell.energy
        np.testing.assert_array_equal(map.stiffness[i, j], cell.stiffness)
        assert map.growth[i, j] == cell.growth == cell.eigenvalues[2:].real.max()
    assert (map.branch == 0).all() and map.stable.all() and not len(map.seams)


def test_the_continuation_does_not_jump_at_a_fold() -> None:
    """The lean at the right edge of each branch is kept as far as it exists, as hysteresis."""
    from_left, from_right = over_offsets(OFFSETS[0]), over_offsets(OFFSETS[-1])
    for map in (from_left, from_right):
        assert (map.status == "at_rest").all()
        assert set(map.branch.tolist()) == {0, 1}
        along = map.branch[1:] == map.branch[:-1]
        steps = np.abs(np.diff(map.rotation))
        assert steps[along].max() < SMOOTH < 4 * SMOOTH < steps[~along].min()
        # The branches touch at one place only: between two cells lies the fold.
        assert np.count_nonzero(~along) == 1
    both = (from_left.branch == 0) & (from_right.branch == 0)
    assert np.count_nonzero(both) >= 3
    assert (from_left.rotation[both] > from_right.rotation[both] + SMOOTH).all()


def test_the_branch_ends_at_the_fold_and_not_before() -> None:
    fine = np.linspace(4.0e-4, 6.0e-4, 81)
    axis = np.concatenate([[-2e-3, 0.0], fine])
    scene = leaning(4.0, -2e-3)
    map = sp.equilibrium_map(scene, {"grasped.com_offset": axis}, progress=False)
    last = int(np.flatnonzero(map.branch == 0)[-1])
    assert 10 < last < len(axis) - 10
    # Beside the fold the offset is a smooth function of the rotation, which has a maximum there.
    near = slice(last - 9, last + 1)
    offset = np.polynomial.Polynomial.fit(map.rotation[near], axis[near], 3)
    turns = offset.deriv().roots()
    fold = offset(turns[np.argmin(np.abs(turns - map.rotation[last]))].real)
    assert axis[last] <= fold < axis[last + 1]


def test_branches_that_meet_around_a_cusp_have_a_seam() -> None:
    map = cusp()
    assert (map.branch == 0).all()
    assert len(map.seams) > 3
    seams = {(tuple(a), tuple(b)) for a, b in map.seams.tolist()}
    for i, j in np.ndindex(map.shape):
        for other in ((i + 1, j), (i, j + 1)):
            if other[0] < map.shape[0] and other[1] < map.shape[1]:
                turn = abs(map.rotation[other] - map.rotation[i, j])
                assert (((i, j), other) in seams) == (turn > SMOOTH), (i, j, other)
    # Light objects stand upright on one sheet: a seam begins above the cusp.
    assert map.values[1][map.seams[:, :, 1].min()] > 2.0


def test_other_units_by_powers_of_two_give_the_same_bits() -> None:
    units = Units(length=3, mass=-2, time=4)
    scene = leaning(2.0, 1e-4)
    axes = {"grasped.com_offset": OFFSETS[::4], "grip": np.array([-0.004, 0.0, 0.004])}
    map = sp.equilibrium_map(scene, axes, progress=False)
    scaled = {name: values * units.of(1) for name, values in axes.items()}
    other = sp.equilibrium_map(units.scene(scene), scaled, progress=False)
    np.testing.assert_array_equal(other.q, map.q * units.coordinates)
    np.testing.assert_array_equal(other.branch, map.branch)
    np.testing.assert_array_equal(other.energy, map.energy * units.of(2, 1, -2))


def test_cells_without_equilibrium_have_the_reason() -> None:
    angles = np.deg2rad(np.linspace(-8.0, 4.0, 7))
    scene = held(fingers="driven")
    map = sp.equilibrium_map(
        scene, {"schedule.angles.0.0": angles, "schedule.angles.0.1": angles}, progress=False
    )
    none = map.status != "at_rest"
    assert none.any() and not none.all()
    assert map.status[0, 0] == "apart"
    for i, j in np.argwhere(none).tolist():
        alone = sp.equilibrium(map.equilibrium(i, j).scene)
        cell = map.equilibrium(i, j)
        assert (cell.status, cell.message) == (alone.status, alone.message)
    assert (map.branch[none] == -1).all() and not map.stable[none].any()
    for array in (map.q, map.stiffness, map.growth, map.energy):
        assert np.isnan(array[none]).all()
        assert np.isfinite(array[~none]).all()
    assert np.isnan(map.friction_margin[none]).all() and scene.friction is None
    assert (map.friction_margin[~none] == np.inf).all()
    assert f"apart {np.count_nonzero(map.status == 'apart')}" in repr(map)


def test_tips_that_would_slip_have_a_branch_but_no_equilibrium() -> None:
    scene = held(contact="unilateral", friction=0.5)
    masses = np.linspace(1.0, 12.0, 12)
    map = sp.equilibrium_map(scene, {"grasped.mass": masses}, progress=False)
    bilateral = sp.equilibrium_map(
        replace(scene, contact="bilateral"), {"grasped.mass": masses}, progress=False
    )
    slips = bilateral.friction_margin < 0.0
    assert slips.any() and not slips.all()
    np.testing.assert_array_equal(map.status == "slipping", slips)
    np.testing.assert_array_equal(map.branch, 0)
    np.testing.assert_array_equal(map.q[~slips], bilateral.q[~slips])


def test_the_time_is_that_of_a_single_search() -> None:
    scene = sp.paper.manipulation()
    for time in (None, 1.5):
        map = sp.equilibrium_map(scene, {"grasped.mass": [0.1]}, time=time, progress=False)
        alone = sp.equilibrium(scene, time)
        assert alone.state is not None
        np.testing.assert_array_equal(map.q[0], alone.state.q)


def test_infinite_friction_beside_an_axis() -> None:
    values = np.array([0.1, 0.4])
    beside = held(friction=(0.5, np.inf), grasped=replace(held().grasped, com_offset=1e-3))
    map = sp.equilibrium_map(beside, {"friction.left": values}, progress=False)
    assert (map.friction_needed[:, 0] != map.friction_needed[:, 1]).all()
    np.testing.assert_allclose(
        map.friction_margin,
        np.minimum(0.5 - map.friction_needed[:, 0], values - map.friction_needed[:, 1]),
    )
    endless = replace(beside, friction=(np.inf, np.inf))
    map = sp.equilibrium_map(endless, {"grasped.mass": values}, progress=False)
    assert (map.friction_margin == np.inf).all()


def test_an_axis_of_shears_sets_the_shears() -> None:
    rest = sp.equilibrium(held())
    assert rest.state is not None
    shear = rest.state.q[7:]
    values = shear[0] + np.array([-1e-4, 0.0, 1e-4])
    map = sp.equilibrium_map(
        held(grasped=replace(held().grasped, com_offset=1e-3)),
        {"shear.right": values},
        shear=(0.0, shear[1]),
        progress=False,
    )
    at_rest = map.status == "at_rest"
    np.testing.assert_allclose(map.q[at_rest, 7], values[at_rest], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(map.q[at_rest, 8], shear[1], rtol=0.0, atol=1e-12)


def test_a_map_is_a_value(tmp_path) -> None:  # type: ignore[no-untyped-def]
    map = sp.equilibrium_map(held(), {"grip": [0.0, 0.01], "grasped.mass": [0.1]}, progress=False)
    copy = pickle.loads(pickle.dumps(map))
    assert copy == map and hash(copy) == hash(map)
    assert not any(values.flags.writeable for values in (*copy.values, copy.q))
    assert repr(map) == "<EquilibriumMap grip (2) x grasped.mass (1): 2 of 2 at rest, 2 stable>"
    assert map.equilibrium(-1, 0) is map.cells[1]
    with np.load(map.save(tmp_path / "map.npz")) as saved:
        np.testing.assert_array_equal(saved["q"], map.q)
        np.testing.assert_array_equal(saved["grip"], [0.0, 0.01])
    lines = map.save(tmp_path / "map.csv").read_text().splitlines()
    assert lines[0].startswith("grip [m],grasped.mass [kg],status,branch [1],x [m],y [m]")
    assert len(lines) == 3 and len({line.count(",") for line in lines}) == 1
    assert lines[2].startswith(f"0.01,0.1,at_rest,0,{map.q[1, 0, 0].item()!r},")


def test_progress_counts_up_to_all_steps_and_an_interrupt_passes() -> None:
    angles = np.deg2rad(np.linspace(-8.0, 4.0, 4))
    apart = {"schedule.angles.0.0": angles, "schedule.angles.0.1": angles}
    folded = {"grasped.com_offset": OFFSETS[::4], "grasped.mass": MASSES[::4]}
    for scene, axes in ((held(fingers="driven"), apart), (leaning(4.0, -2e-3), folded)):
        seen: list[tuple[int, int]] = []
        sp.equilibrium_map(scene, axes, progress=lambda *steps: seen.append(steps))  # noqa: B023
        done = [steps for steps, _ in seen]
        assert done == sorted(done) and len({total for _, total in seen}) == 1
        assert seen[0][0] == 0 and seen[-1][0] == seen[-1][1]

    def interrupt(done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sp.equilibrium_map(leaning(4.0, -2e-3), folded, progress=interrupt)


def test_a_notebook_lists_the_axes_and_the_place_of_each_cell() -> None:
    masses, offsets = np.linspace(0.1, 1.0, 6), np.linspace(-0.01, 0.01, 5)
    html = sp.equilibrium_map(
        sp.Scene(), {"grasped.mass": masses, "grasped.com_offset": offsets}
    )._repr_html_()
    assert "grasped.mass [kg]" in html and "grasped.com_offset [m]" in html
    assert html.count("<details>") == 1
    assert html.count("<tr>") == 1 + 30
    # Whole equilibria with their scenes and states took 1.8 KB for each cell.
    assert "State(" not in html and "Scene(" not in html
