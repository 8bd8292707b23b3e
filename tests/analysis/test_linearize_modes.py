"""`linearize` and `modes` of tips that slip, graze and open, beside the oracle's equations."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import softpinch as sp
from oracle.contact import DrivenInputs
from oracle.contact_modes import FREE, GRAZE, SLIP_DOWN, SLIP_UP, STICK
from oracle.contact_parts import PartsMechanics
from oracle.contact_system import STATES, Contact, ContactSystem
from oracle.contact_terms import Mechanics
from oracle.evaluate import parameters
from softpinch.scene.parts import others
from support.linear_reference import EVERY_OUTPUT, off, sizes, whole
from support.random_pinches import random_pinch

Floats = NDArray[np.float64]
_NAMES = {0: FREE, 1: STICK, 2: SLIP_UP, -2: SLIP_DOWN, 3: GRAZE, 4: GRAZE, -4: GRAZE}


class Reference:
    """The oracle's equations at a state, in fixed modes."""

    def __init__(self, scene: sp.Scene, state: sp.State, codes: Any, frozen: Any = None) -> None:
        self.driven = scene.fingers == "driven"
        pid = sp.Pid()
        assert scene.control == pid
        self.gains = np.full((2, 3), 0.0 if self.driven else (pid.kp, pid.kd, pid.ki)).T
        mechanics: Any = PartsMechanics(scene) if others(scene) else None
        if mechanics is None:
            numbers = parameters(scene)
            if self.driven:
                numbers |= {name: 0.0 for name in numbers if name.startswith("control.")}
            mechanics = Mechanics(numbers)
        friction = scene.friction
        assert isinstance(friction, float)
        self.system = ContactSystem(
            mechanics, (friction,) * 2, [1.0] * 2, length=0.1, driven=self.driven
        )
        self.modes = [_NAMES[int(code)] for code in codes]
        tilts = mechanics.tilts([*state.q, *state.p, *state.integral])
        self.contact = Contact(self.modes, list(tilts if frozen is None else frozen), [False] * 2)
        end = state.time + 1e-6
        inputs = DrivenInputs(scene, state.time, end)
        self.asked = np.array(inputs.between(state.time, end)(state.time))
        self.y = np.concatenate([state.q, state.p, state.integral, np.zeros(STATES - 20)])

    def rates(self, y: Floats, asked: Floats) -> tuple[Floats, list[float], Floats]:
        """Rates of the 20 states, multipliers, and torques on the fingers."""
        given = asked.tolist()
        _, terms, found = self.system.at(y, given, self.contact)
        rates = self.system.rates_of(y, terms, found, given, self.contact)[:20]
        torque = -(self.gains * [y[3:5] - asked[:2], y[12:14], y[18:20]]).sum(axis=0)
        if self.driven:
            torque = self.system.mechanics.masses[3:5] * asked[5:] - found.force[3:5]
        return rates, found.multipliers, torque

    def constrained(self, y: Floats, asked: Floats) -> Floats:
        """The state on the constraints that the modes hold."""
        y = y.copy()
        for i, mode in enumerate(self.modes):
            if mode == FREE:
                continue
            y[5 + i] -= self.system.at(y, asked.tolist(), self.contact)[1].gaps[i]
        phi = self.system.at(y, asked.tolist(), self.contact)[1].phi
        for i, mode in enumerate(self.modes):
            if mode != FREE:
                y[14 + i] -= phi[i] @ y[9:18]
            if mode == STICK:
                y[16 + i] -= phi[2 + i] @ y[9:18]
        return y


def differences(evaluate: Any, point: Floats, steps: Floats) -> Floats:
    """Derivatives by differences of order 4, a column for each entry of the point."""
    columns = []
    for k, step in enumerate(steps):
        own = step * np.eye(len(point))[k]
        near, far = (evaluate(point + m * own) - evaluate(point - m * own) for m in (1, 2))
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.transpose(columns)


def rows_in_modes(run: sp.Run, most: int) -> list[sp.State]:
    """States of a run, each in another combination of modes."""
    found: dict[tuple[float, ...], sp.State] = {}
    for k in range(1, len(run) - 1):
        state = run.state(k)
        assert state.contact is not None
        if np.abs(run.q[k, 2]) < 0.8 and np.abs(state.p).max() < 50.0:
            found.setdefault(tuple(state.contact[:2]), state)
    return list(found.values())[:most]


def states(seeds: range, fingers: str = "pid") -> list[tuple[sp.Scene, sp.State]]:
    found = []
    for seed in seeds:
        scene = random_pinch(np.random.default_rng(seed), "unilateral")
        if fingers == "driven":
            close = sp.Schedule.minimum_jerk([0.0, 0.1], np.deg2rad([[3, 3], [9, 2]]), 0.1)
            scene = replace(scene, fingers="driven", schedule=close, initial=None)
        run = sp.simulate(scene, tolerance=1e-9, method="dop853", formulation="projected")
        found += [(scene, state) for state in rows_in_modes(run, 6)]
    return found


def reference_model(model: sp.LinearModel, reference: Reference) -> tuple[Floats, Floats]:
    """[[A, B], [C, D]] by differences, and the rates and outputs at the point."""
    names = ["x", "y", "theta", "theta_1", "theta_2", "d_n1", "d_n2", "d_t1", "d_t2"]
    names = [*names, *(f"rate of {name}" for name in names), "integral_1", "integral_2"]
    places = [names.index(name) for name in model.states]

    def evaluate(point: Floats) -> Floats:
        y, asked = reference.y.copy(), reference.asked.copy()
        y[places], given = np.split(point, [len(places)])[0], point[len(places) :]
        if reference.driven:
            y[3:5], y[12:14], asked[5:7], asked[2:5] = np.split(given, [2, 4, 6])
        else:
            asked[:5] = given
        y = reference.constrained(y, asked)
        rates, multipliers, torque = reference.rates(y, asked)
        return np.concatenate([rates[places], y[:9], multipliers, torque, y[9:14]])

    point = np.concatenate([model.state_values, model.input_values])
    units = (*model.state_units, *model.input_units)
    steps = np.array([{"m": 3e-6, "rad": 3e-5}.get(unit, 3e-3) for unit in units])
    return differences(evaluate, point, steps), evaluate(point)


@pytest.mark.parametrize("fingers", ["pid", "driven"])
def test_minimal_models_are_those_of_the_oracle_in_the_same_modes(fingers: str) -> None:
    seen: set[str] = set()
    for scene, state in states(range(8), fingers):
        assert state.contact is not None
        codes, frozen = state.contact[:2], state.contact[2:]
        model = sp.linearize(scene, state, ("targets", "force"), EVERY_OUTPUT)
        reference = Reference(scene, state, codes, frozen)
        matrix, values = reference_model(model, reference)
        columns = sizes(scene, (*model.state_units, *model.input_units))
        assert off(whole(model), matrix, columns) < 1e-7, codes
        found = np.concatenate([model.state_rates, model.output_values])
        np.testing.assert_allclose(found, values, rtol=1e-7, atol=1e-7 * np.abs(values).max())
        seen |= set(reference.modes)
    assert {FREE, STICK, SLIP_UP, SLIP_DOWN} <= seen


def test_modes_are_the_eigenvalues_of_all_coordinates_in_the_same_modes() -> None:
    for scene, state in states(range(8, 12)):
        assert state.contact is not None
        reference = Reference(scene, state, state.contact[:2], state.contact[2:])

        def evaluate(y: Floats, reference: Reference = reference) -> Floats:
            whole = np.concatenate([y, np.zeros(STATES - 20)])
            return reference.rates(whole, reference.asked)[0]

        y = reference.y[:20]
        steps = np.array([3e-6, 3e-6, *[3e-5] * 3, *[3e-6] * 4, *[3e-3] * 9, *[3e-5] * 2])
        matrix = differences(evaluate, y, steps)
        at = [state.time], state.q[None], state.p[None], [state.integral]
        contacts = state.contact[None]
        found = sp.modes(scene, *at, contacts=contacts, formulation="projected")
        columns = sizes(scene, ("m", "m", *["rad"] * 3, *["m"] * 4) * 1)
        pace = sizes(scene, ("m/s", "m/s", *["rad/s"] * 3, *["m/s"] * 4))
        every = np.concatenate([columns, pace, sizes(scene, ("rad s",) * 2)])
        assert off(found.jacobian[0], matrix, every) < 1e-7, state.contact


@pytest.mark.parametrize(
    "modes", [("graze", "stick"), ("slip_up", "free"), ("free", "free"), ("graze", "slip_down")]
)
def test_given_modes_replace_those_of_the_state(modes: tuple[str, str]) -> None:
    codes = [{"free": 0, "stick": 1, "slip_up": 2, "slip_down": -2, "graze": 3}[m] for m in modes]
    for seed in range(3):
        scene = random_pinch(np.random.default_rng(seed), "unilateral")
        how = {"fingers": (0.12, 0.1), "rotation": 0.05, "velocity": (0.01, -0.02, 0.3)}
        state = sp.State.consistent(scene, **how, shear=(1e-4, -2e-4))
        model = sp.linearize(scene, state, ("targets", "force"), EVERY_OUTPUT, modes=modes)
        reference = Reference(scene, state, codes)
        matrix, _ = reference_model(model, reference)
        columns = sizes(scene, (*model.state_units, *model.input_units))
        assert off(whole(model), matrix, columns) < 1e-7
        assert len(model.states) == 14 + sum({1: 0, 0: 3}.get(code, 1) for code in codes)


def test_a_state_without_modes_has_those_that_a_run_chooses() -> None:
    scene = replace(random_pinch(np.random.default_rng(1), "unilateral"), friction=0.01)
    state = sp.State.consistent(scene, fingers=(0.1, 0.1))
    chosen = sp.simulate(replace(scene, initial=state), dt=1e-5).state(0)
    assert chosen.contact is not None and list(chosen.contact[:2]) == [2.0, -2.0]
    assert sp.linearize(scene, state) == replace(sp.linearize(scene, chosen), state=state)
    names = ("slip_down", sp.ContactMode.STICK)
    assert "rate of d_t1" in sp.linearize(scene, state, modes=names).states
    with pytest.raises(
        ValueError, match=r'^modes\[0\] = .*must be "slip_up" or "slip_down", because'
    ):
        sp.linearize(scene, state, modes=("slip", "stick"))
    with pytest.raises(ValueError, match=r"^modes = .*: must be None with contact = \"bilateral\""):
        sp.linearize(replace(scene, contact="bilateral"), state, modes=names)
    with pytest.raises(TypeError, match=r"^modes = 'slip': must be two"):
        sp.linearize(scene, state, modes="slip")
    with pytest.raises(ValueError, match=r"^contacts with Scene.contact = \"unilateral\": must be"):
        sp.modes(scene, [0.0], state.q[None], state.p[None], [(0.0, 0.0)], formulation="csm")


def test_sticking_tips_have_the_bilateral_model_and_one_tie_goes_with_each() -> None:
    scene = random_pinch(np.random.default_rng(1), "unilateral")
    state = sp.State.consistent(scene, fingers=(0.1, 0.1))
    stick = sp.linearize(scene, state, modes=("stick", "stick"))
    both = sp.linearize(replace(scene, contact="bilateral"), state)
    np.testing.assert_array_equal(stick.A, both.A)
    open_right = sp.linearize(scene, state, "force", modes=("free", "stick"))
    assert len(open_right.neutral) == 1
    less = sp.linearize(scene, state, "force", modes=("free", "stick"), reduced=True)
    assert len(less.states) == len(open_right.states) - 1 and "d_t1" in less.states
    apart = np.abs(open_right.poles[:, None] - less.poles).min(axis=1)
    assert np.sort(apart)[:-1].max() < 1e-6 * np.abs(less.poles).max()
    s = 30.0j
    transfers = [
        model.C @ np.linalg.solve(s * np.eye(len(model.A)) - model.A, model.B)
        for model in (open_right, less)
    ]
    np.testing.assert_allclose(*transfers, rtol=1e-9, atol=1e-9 * np.abs(transfers[0]).max())


def test_a_jaw_on_a_tilted_face_slips_and_an_arc_is_free() -> None:
    hand = sp.Hand(right=sp.Jaw(0.06, 0.01, 0.1, 0.07), left=sp.Finger())
    for side, modes in (("right", ("slip_up", "stick")), ("left", ("slip_down", "free"))):
        shape: Any = sp.Face(tilt=0.1) if side == "right" else sp.Arc(0.03, center=(0.005, 0.0))
        scene = sp.Scene(
            hand=hand,
            grasped=replace(sp.GraspedObject(), **{side: shape}),
            contact="unilateral",
            friction=0.3,
        )
        how = {"fingers": (0.002, 0.1), "rotation": 0.05, "velocity": (0.01, -0.02, 0.3)}
        state = sp.State.consistent(scene, **how, shear=(1e-4, -2e-4))
        model = sp.linearize(scene, state, ("targets", "force"), EVERY_OUTPUT, modes=modes)
        codes = [{"free": 0, "stick": 1, "slip_up": 2, "slip_down": -2}[mode] for mode in modes]
        reference = Reference(scene, state, codes)
        matrix, _ = reference_model(model, reference)
        units = (*model.state_units, *model.input_units)
        columns = sizes(scene, tuple(unit.replace("m s", "rad s") for unit in units))
        assert off(whole(model), matrix, columns) < 1e-7
