"""A run that has settled lies beside the equilibrium to which the no-slip constraint leads."""

from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp

TURN = np.array([1e-2, 1e-2, 1.0, 1.0, 1.0, 1e-2, 1e-2, 1e-2, 1e-2])


@pytest.mark.parametrize(
    ("contact", "friction"),
    [("bilateral", None), ("unilateral", 0.5), ("unilateral", (0.5, 0.9))],
)
def test_after_each_operation_the_rest_is_as_far_as_the_speed_explains(
    contact: str, friction: float | None
) -> None:
    """The slowest motion decays as exp(-s t): it still goes as far as its speed divided by s."""
    scene = replace(sp.paper.manipulation(), contact=contact, friction=friction)
    run = sp.simulate(scene, formulation="projected", every=10, record=("state", "contact"))
    assert run.status == "completed"
    slipped = (run.contact == sp.ContactMode.SLIP).any() if contact == "unilateral" else False
    assert slipped == (contact == "unilateral")
    for number in range(1, 9):
        row = int(np.argmin(np.abs(run.t - number)))
        assert run.t[row] == pytest.approx(number, abs=1e-9)
        # The targets switch at this instant: it has come to rest under those before.
        before = float(np.nextafter(run.t[row], 0.0))
        found = sp.equilibrium(scene, before, near=run.state(row))
        assert found.state is not None and found.stable and not found.violations
        assert np.array_equal(found.state.q[3:5], scene.schedule.angles[number - 1])
        slowest = -found.growth
        assert 5.0 < slowest < 8.0
        moved = np.abs((found.state.q - run.q[row]) / TURN).max()
        assert moved <= 1.01 * np.abs(run.p[row] / TURN).max() / slowest
        assert moved < 1e-3


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_a_run_is_its_last_state_before_its_end(contact: str) -> None:
    scene = replace(sp.paper.manipulation(), contact=contact, friction=0.5)
    run = sp.simulate(replace(scene, duration=5.0), every=10, formulation="projected")
    found = sp.equilibrium(scene, near=run)
    # The run ends where the targets switch, and has come to rest under those before.
    assert found.time == np.nextafter(5.0, 0.0)
    assert found == sp.equilibrium(scene, found.time, near=run.state(-1))
    assert np.array_equal(found.state.q[3:5], scene.schedule.angles[4])
    assert found.grip != pytest.approx([0.0, 0.0], abs=1e-5)


def test_the_rest_of_later_states_stays_while_the_run_approaches_it() -> None:
    scene = sp.paper.manipulation()
    run = sp.simulate(replace(scene, duration=5.0), every=10, formulation="nullspace")
    places, away = [], []
    for time in (4.5, 4.8, 4.99):
        row = int(np.argmin(np.abs(run.t - time)))
        found = sp.equilibrium(scene, time, near=run.state(row))
        assert found.state is not None
        places.append(found.state.q)
        away.append(np.abs((found.state.q - run.q[row]) / TURN).max())
    assert away[0] > 5.0 * away[1] > 5.0 * away[2]
    # The rest depends on the way in between by the area that it encloses, of second order.
    assert np.abs((places[0] - places[2]) / TURN).max() < 0.05 * away[0]
