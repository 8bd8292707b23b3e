"""Every term of the equations of motion beside the SymPy oracle, which shares no code.

The random states are off the constraints as well as on them, and wide: tilts to 80 degrees, E from
1e3 to 1e10 Pa, masses from 1e-5 to 1e2 kg, inertias from 1e-8 to 1 kg m^2, lengths over two
decades.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from oracle import PARAMETERS, Quantity
from oracle.evaluate import Oracle
from oracle.evaluate import evaluate as oracle
from oracle.lagrangian import SHAPES
from softpinch import _core

TOLERANCE = 1e-11
ROUND_OFF = float(np.finfo(float).eps)
# Single precision: its smallest numbers are far from where products of doubles underflow.
unit = st.floats(-1.0, 1.0, width=32, allow_subnormal=False)


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    """Between two positive numbers, evenly over the decades."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda u: 10.0**u)


lengths = powers(0.01, 1.0)
masses = powers(1e-5, 1e2)
inertias = powers(1e-8, 1.0)
drags = st.one_of(st.just(0.0), powers(1e-2, 1e4))
tips = st.builds(
    sp.Fingertip,
    radius=powers(1e-3, 0.1),
    youngs_modulus=powers(1e3, 1e10),
    normal_viscosity=drags,
    tangential_viscosity=drags,
    tilt_coupling=st.sampled_from([1.0, -1.0, 0.0, 0.37]),
    normal_mass=st.one_of(st.none(), masses),
    tangential_mass=st.one_of(st.none(), masses),
)
fingers = st.builds(
    sp.Finger,
    length=lengths,
    root_offset=lengths,
    half_thickness=powers(1e-3, 0.05),
    mass=masses,
    inertia=inertias,
)
gains = st.one_of(st.just(0.0), powers(1e-3, 1e4))
pids = st.builds(sp.Pid, kp=gains, kd=gains, ki=gains)
scenes = st.builds(
    sp.Scene,
    hand=st.builds(sp.Hand, right=fingers, left=fingers, tip=st.tuples(tips, tips)),
    grasped=st.builds(
        sp.GraspedObject,
        width=lengths,
        mass=masses,
        inertia=inertias,
        com_offset=st.floats(-0.05, 0.05),
    ),
    control=st.tuples(pids, pids),
    gravity=st.sampled_from([9.81, 0.0, 1.62]),
    disturbances=st.lists(
        st.builds(sp.Step, time=st.just(0.0), force=st.tuples(unit, unit), moment=unit), max_size=1
    ),
)
angles = st.floats(-math.radians(80), math.radians(80))


@st.composite
def states(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Any q with |theta_p| <= 80 degrees, and any p."""
    theta = draw(st.floats(-1.5, 1.5))
    tilts = np.array([draw(angles), draw(angles)])
    fingers = tilts - np.array([-1.0, 1.0]) * theta
    place = 0.2 * np.array([draw(unit), draw(unit)])
    press = draw(powers(1e-7, 0.1)) * np.array([abs(draw(unit)), abs(draw(unit))])
    shear = draw(powers(1e-7, 0.1)) * np.array([draw(unit), draw(unit)])
    q = np.concatenate([place, [theta], fingers, press, shear])
    p = draw(powers(1e-4, 100.0)) * np.array([draw(unit) for _ in range(9)])
    return q, p


def beside(
    scene: sp.Scene,
    q: np.ndarray,
    p: np.ndarray,
    integral: tuple[float, float] = (0.0, 0.0),
    stabilization: sp.Stabilization | None = None,
) -> tuple[Oracle, dict[str, object]]:
    """The oracle's terms and the core's."""
    stabilization = stabilization or sp.Stabilization()
    parameters = scene.parameters()
    gains = (stabilization.alpha, stabilization.beta)
    ours = _core.evaluate(parameters, scene.inputs(), 0.5, q, p, np.array(integral), "csm", *gains)
    push = scene.disturbances[0] if scene.disturbances else sp.Step(time=0.0)
    assert isinstance(push, sp.Step)
    theirs = oracle(
        dict(zip(_core.PARAMETERS, parameters, strict=True)),
        q,
        p,
        integral,
        np.asarray(scene.schedule.angles)[-1],
        (*push.force, push.moment),
        *gains,
    )
    return theirs, dict(ours)


@settings(max_examples=80)
@given(
    scenes,
    states(),
    st.tuples(unit, unit),
    st.builds(sp.Stabilization, alpha=powers(1, 1e5), beta=powers(1, 1e5)),
)
def test_every_term_agrees_with_the_oracle(
    scene: sp.Scene,
    state: tuple[np.ndarray, np.ndarray],
    integral: tuple[float, float],
    stabilization: sp.Stabilization,
) -> None:
    theirs, ours = beside(scene, *state, integral, stabilization)
    differences = theirs.differences(ours, forming_a=True)
    assert set(differences) >= {*SHAPES, "multipliers", "accelerations"}
    worst = max(differences, key=lambda name: differences[name])
    # The core takes the acceleration of a tip from those of the object and the finger, which cancel
    # where the tip is far heavier than they are.
    inertias = np.diag(theirs.mass_matrix.value)
    allowed = max(TOLERANCE, ROUND_OFF * inertias.max() / inertias.min())
    assert differences[worst] <= allowed, (worst, differences)


@given(states(), st.tuples(unit, unit))
def test_the_papers_hand_agrees_without_any_allowance(
    state: tuple[np.ndarray, np.ndarray], integral: tuple[float, float]
) -> None:
    theirs, ours = beside(sp.Scene(), *state, integral)
    differences = theirs.differences(ours)
    worst = max(differences, key=lambda name: differences[name])
    assert differences[worst] <= TOLERANCE, (worst, differences)


def test_evaluate_returns_the_terms_of_the_core() -> None:
    scene = sp.Scene(disturbances=[sp.Step(time=0.0, force=(1.0, -2.0), moment=0.1)])
    state = sp.State.consistent(
        scene, rotation=0.1, fingers=(0.2, 0.15), shear=(1e-3, 2e-3), velocity=(0.1, 0.2, 1.0)
    )
    # Off the constraints, and with gains that differ.
    q = state.q + 1e-4 * np.arange(9)
    gains = sp.Stabilization(alpha=300.0, beta=700.0)
    terms = sp.evaluate(scene, 0.5, q, state.p, integral=(0.01, 0.02), stabilization=gains)
    theirs, ours = beside(scene, q, np.array(state.p), (0.01, 0.02), gains)
    for name in ("mass_matrix", "constraint_matrix", "constraint_rate", "multipliers"):
        np.testing.assert_array_equal(getattr(terms, name), ours[name])
    for name in ("elastic", "gravity", "viscous", "control", "external"):
        np.testing.assert_array_equal(getattr(terms.forces, name), ours[name])
    assert terms.energies.elastic == ours["elastic_energy"]
    energies = terms.energies
    assert energies.total == energies.kinetic + energies.elastic + energies.gravity
    total = terms.forces.total + terms.constraint_matrix.T @ terms.multipliers
    np.testing.assert_allclose(terms.mass_matrix @ terms.accelerations, total, atol=1e-9)
    assert theirs.differences(ours)["accelerations"] <= TOLERANCE


@pytest.mark.parametrize("time", [0.0, 1.0])
def test_evaluate_takes_the_inputs_from_just_after_a_switch(time: float) -> None:
    schedule = sp.Schedule.steps([0.0, 1.0], [[0.1, 0.1], [0.2, 0.3]])
    scene = replace(sp.Scene(), schedule=schedule)
    torque = sp.evaluate(scene, time, np.zeros(9), np.zeros(9)).forces.control[3:5]
    np.testing.assert_allclose(torque, 100.0 * schedule.angles[int(time)], rtol=1e-15)


def test_differences_see_a_change_of_1e_10_and_a_wrong_shape() -> None:
    here = oracle(dict.fromkeys(PARAMETERS, 0.5), [0.3] * 9, [0.2] * 9)
    exact = {name: quantity.value for name, quantity in vars(here).items()}
    assert max(here.differences(exact).values()) == 0
    for name, value in exact.items():
        if value.any():
            assert here.differences({name: value * (1 + 1e-10)})[name] > 1e-12
    assert here.differences({"residuals": np.zeros(3)})["residuals"] == np.inf
    assert Quantity(np.zeros(1), np.zeros(1)).difference([1e-280]) > 1e19
    assert Quantity(np.zeros(1), np.ones(1)).difference([np.nan]) == np.inf
    allowed = here.differences({"multipliers": exact["multipliers"] * 1.1}, forming_a=True)
    strict = here.differences({"multipliers": exact["multipliers"] * 1.1})
    assert 0 < allowed["multipliers"] < strict["multipliers"]
