"""`linearize`: the motion for small deviations from an equilibrium or from a state of a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import repeat
from typing import Any, TypeAlias

import numpy as np

from .. import _core
from ..run import ContactMode, Options, Request
from ..scene import Schedule, branches, jaws
from ..scene.contact import as_bilateral
from ..scene.control import WRITTEN, require_known_torque
from ..scene.fields import Jaws, of_column
from ..scene.scene import Scene, State, require_fit
from ..scene.scene import inputs as compiled_inputs
from ..support import Complexes, Floats, Result, ShownTable, checks, extras, read_only
from . import states
from .rest import Equilibrium, equilibrium

# States that are this far off the constraints or off the schedule, as a share of a tip's radius
# and in rad, are refused; the drift of `csm` is far smaller.
_OFF = 0.01
_OFF_SCHEDULE = 1e-6
# The modes of the right and of the left tip.
GivenModes: TypeAlias = Sequence[str | ContactMode]
# Name -> code in `State.contact`; "slip" takes its direction from the state.
_CODES = {mode.name.lower(): float(mode) for mode in ContactMode}
_CODES |= {"slip_up": _CODES["slip"], "slip_down": -_CODES["slip"]}
# Duration of the run whose start chooses the modes, s.
_MOMENT = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LinearModel(Result):
    """Small deviations from an operating point: dx/dt = A x + B u, y = C x + D u.

    x, u and y are differences from `state_values`, `input_values` and `output_values`. If the
    operating point moves, x is the difference from the motion that leaves it.

    Attributes:
        A: (N, N), the derivatives of the states' rates by the states, as B (N, m) by the inputs.
        C: (k, N), the derivatives of the outputs by the states, as D (k, m) by the inputs.
        states: Names of the states (N,), as of the `inputs` (m,) and of the `outputs` (k,); the
            rate of x is "rate of x".
        state_units: Units of the states (N,), as `input_units` (m,) and `output_units` (k,).
        state_values: The states at the operating point (N,), as `input_values` (m,) and
            `output_values` (k,).
        state_rates: The rates of the states at the operating point (N,).
        state: The operating point.
        neutral: Rows w, (k, N), of the combinations w x that no motion of the model changes: of the
            k tips that stick, shear plus slip, d_ti + Phi_Ni (x, y, theta, theta_1, theta_2) with
            the rows N of (25). They belong to as many eigenvalues zero. With driven fingers the
            angles theta_i are inputs: w x changes only with them, by B's columns of their rates.
            (0, N) if the operating point moves, and in a reduced model.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    state_values: Floats
    input_values: Floats
    output_values: Floats
    state_rates: Floats
    state: State
    neutral: Floats

    @cached_property
    def poles(self) -> Complexes:
        """The eigenvalues of A (N,), 1/s.

        Zeros are those of `neutral`, and one for each integral of a PID with K_I = 0: it drives
        nothing, so the sign of the other poles tells whether the grasp is stable.
        """
        return read_only(np.linalg.eigvals(self.A).astype(complex))

    def to_control(self) -> Any:
        """Converts to a `control.StateSpace` with these names. Needs the extra `control`."""
        control = extras.require("control", extra="control", purpose="LinearModel.to_control")
        names = {kind: list(getattr(self, kind)) for kind in ("states", "inputs", "outputs")}
        return control.StateSpace(*self._matrices(), **names)

    def to_scipy(self) -> Any:
        """Converts to a `scipy.signal.StateSpace`, which has no names. Needs the extra `study`."""
        signal = extras.require("scipy.signal", extra="study", purpose="LinearModel.to_scipy")
        return signal.StateSpace(*self._matrices())

    def _matrices(self) -> list[Floats]:
        # Writable, and separate from this model's.
        return [matrix.copy() for matrix in (self.A, self.B, self.C, self.D)]

    def _tables(self) -> Iterator[ShownTable]:
        rows = [
            (kind, *row)
            for kind, names, units, values in (
                ("state", self.states, self.state_units, self.state_values),
                ("input", self.inputs, self.input_units, self.input_values),
                ("output", self.outputs, self.output_units, self.output_values),
            )
            for row in zip(names, units, values, strict=True)
        ]
        yield ShownTable(("", "name", "unit", "at the operating point"), rows)
        poles = sorted(self.poles[self.poles.imag >= 0.0], key=lambda pole: -pole.real)
        swings = [(pole.real, pole.imag / (2.0 * np.pi)) for pole in poles]
        yield ShownTable(("pole: real part [1/s]", "frequency [Hz]"), swings)

    def __repr__(self) -> str:
        ports = f"{_brief(self.inputs)} -> {_brief(self.outputs)}"
        return f"<LinearModel at {self.state.time:.6g} s: {len(self.states)} states, {ports}>"


def _brief(names: tuple[str, ...]) -> str:
    shown = names if len(names) <= 6 else (*names[:2], "...", names[-1])
    return f"({', '.join(shown)})"


def linearize(
    scene: Scene,
    state: State | Equilibrium | None = None,
    inputs: str | Sequence[str] = ("targets",),
    outputs: str | Sequence[str] = ("pose",),
    *,
    modes: GivenModes | None = None,
    reduced: bool = False,
) -> LinearModel:
    """Linearises the motion about an equilibrium, or about a state of a run.

    The derivatives are exact to round-off. The states are the minimal coordinates of formulation
    "nullspace": the pose of the object (x, y, theta) and the fingers' angles (theta_1, theta_2),
    their rates, the shears, and the integrals of a PID; 14 with a PID, 12 with torques, 8 with
    driven fingers, whose angles are inputs. Of `state` only these are used; compressions, and rates
    of compressions and shears, follow from the constraints (9) and (25).

    In unilateral contact each tip keeps its mode. The rate of the shear is one more state for each
    tip that does not stick, and the compression and its rate are two more for each that is free.

    Inputs, by the names of their groups:

    - "targets": the schedule's values. Target angles for a PID, rad; torques with `Torque()`, N m;
      for driven fingers the angles, rad, their rates, rad/s, and accelerations, rad/s^2, which the
      model takes as six independent inputs;
    - "torque": torques on the fingers, N m, instead of the scene's law: the open loop;
    - "force": external force F_x and F_y along fixed axes, N, and moment, N m, on the object;
    - "acceleration": acceleration a_x and a_y of the hand's frame along its own axes, m/s^2.

    Outputs: "pose" (x, y, theta), "fingers" (theta_1, theta_2), "compressions", "shears",
    "multipliers" (lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N), "torque" (of both fingers), and
    "rates" (of pose and fingers).

    Args:
        scene: The physics.
        state: The operating point, such as `run.state(k)`, under the scene's inputs at `state.time`
            (if an input jumps there, after the jump); or an equilibrium of this scene, whose inputs
            are kept. None finds the equilibrium at the end of schedule and scene.
        inputs: Names of groups of inputs, in the order of B's columns.
        outputs: Names of groups of outputs, in the order of C's rows.
        modes: Modes of the contacts (right, left) in unilateral contact, each a `ContactMode`,
            "stick", "slip_up" or "slip_down" (the way of the face over the tip), "slip" (as the
            state moves), "graze" or "free". None takes those of the state, which a run chooses if
            `state.contact` is None; at an equilibrium both tips stick.
        reduced: Whether the neutral states of tips that stick are taken out, exactly: at rest the
            no-slip constraint ties these shears to the pose, whatever the inputs do. The transfer
            function stays the same, with driven fingers for all inputs whose rates and
            accelerations are those of the angles, and these eigenvalues zero are gone; those of the
            integrals of a PID with K_I = 0 stay.

    Raises:
        ValueError: There is no equilibrium, or it is one of another scene; the state does not fit
            the scene or the modes; `reduced` at a state that moves; or the law is a
            `SampledController`, except with "torque" at a state of its run, which has the torques
            in force.
    """
    checks.instance("scene", scene, Scene)
    chosen = checks.names("inputs", inputs, states.INPUTS)
    wanted = states.output_ports(checks.names("outputs", outputs, states.OUTPUTS))
    reduced = checks.boolean("reduced", reduced)
    open_loop = "torque" in chosen
    if open_loop and "targets" in chosen:
        why = "the targets act through the law that the torques replace"
        raise ValueError(f'inputs: "targets" and "torque" exclude each other; {why}')
    if not isinstance(state, State | Equilibrium | None):
        raise TypeError(f"state = {checks.shown(state)}: must be a State, an Equilibrium or None")
    if not open_loop:
        require_known_torque(scene.law, 'linearize without inputs "torque"')
    frozen = not isinstance(state, State)
    if not isinstance(state, State):
        rest = equilibrium(scene) if state is None else state
        # While both tips stick the contact model does not matter.
        if scene != rest.scene and as_bilateral(scene) != as_bilateral(rest.scene):
            advice = "scene = state.scene, or state.state to linearise that state under this scene"
            raise ValueError(f"state: is an equilibrium of another scene; pass {advice}")
        if rest.state is None:
            raise ValueError(f"linearize: {rest.message}")
        state = rest.state
        modes = ("stick", "stick") if modes is None and scene.contact == "unilateral" else modes
    require_fit(scene, "state", state)
    law = "torque" if open_loop else scene.law
    contact = _contact_row(scene, state, modes)
    how = {"inputs": _inputs(scene, state), "whole": True, "open_loop": open_loop, "frozen": frozen}
    found = states.linear_at(scene, state, contact, **how)
    _require_sound(scene, state, found)
    codes = (1.0, 1.0) if contact is None else tuple(contact[:2])
    names = states.state_names(law, "nullspace", branches(scene), codes)
    model = _selected(found, state, names, states.input_ports(chosen, law), wanted, jaws(scene))
    return _without_neutral(model) if reduced else model


def _inputs(scene: Scene, state: State) -> _core.Inputs:
    """The scene's inputs; the torques in force of a `SampledController` are held."""
    if scene.law != "sampled":
        return scene.inputs()
    if state.controller is None:
        why = "which a state of a run has (run.state(k)); this state has controller = None"
        raise ValueError(f"Scene.{WRITTEN['sampled']}: linearize needs the torques in force, {why}")
    held = Schedule.steps([0.0], [state.controller[3:5]])
    return compiled_inputs(held, scene.disturbances, "torque", motion=scene.motion)


def _contact_row(scene: Scene, state: State, modes: GivenModes | None) -> Floats | None:
    """Returns the contacts (4,) of a state, as in `State.contact`; None if both tips stick.

    The frozen tilt of a tip that is free in the given modes only is NaN: the present one.
    """
    if scene.contact == "bilateral":
        if modes is not None:
            rule = 'must be None with contact = "bilateral", in which both tips always stick'
            raise ValueError(f"modes = {checks.shown(modes)}: {rule}")
        return None
    row = state.contact
    if modes is not None:
        row = _given_row(scene, state, modes)
    elif row is None:
        short = replace(scene, initial=state, duration=_MOMENT)
        row = Request(short, Options.checked(_MOMENT, record="state")).run_to_end()["contacts"][0]
    return None if (row[:2] == ContactMode.STICK).all() else np.asarray(row)


def _given_row(scene: Scene, state: State, modes: GivenModes) -> Floats:
    if isinstance(modes, str) or len(modes) != 2:
        raise TypeError(f"modes = {checks.shown(modes)}: must be two, of the right and left tip")
    slip = _core.residuals(scene.parameters(), state.q[None], state.p[None])[0, 2:]
    row = np.zeros(4)
    for k, mode in enumerate(modes):
        field = f"modes[{k}]"
        name = mode.name.lower() if isinstance(mode, ContactMode) else mode
        row[k] = _CODES[checks.choice(field, name, tuple(_CODES))]
        if name == "slip":
            if not slip[k]:
                rule = 'must be "slip_up" or "slip_down", because this state has no slip velocity'
                raise ValueError(f"{field} = {checks.shown(mode)}: {rule}")
            row[k] *= np.sign(slip[k])
        if name == "free":
            own = state.contact
            row[2 + k] = np.nan if own is None or own[k] != ContactMode.FREE else own[2 + k]
    return row


def _require_sound(scene: Scene, state: State, found: _core._Linear) -> None:
    """Refuses a state that the equations do not have, and derivatives that overflowed."""
    q, on = state.q, found["output"][0]
    if not all(np.isfinite(found[name]).all() for name in ("A", "B", "C", "D")):
        raise ValueError(f"state.q = {q.tolist()}: the motion has no finite derivatives there")
    if scene.fingers == "driven" and np.abs(q[3:5] - on[3:5]).max() > _OFF_SCHEDULE:
        rule = f"must be what the schedule has at {state.time!r} s, {on[3:5].tolist()}"
        raise ValueError(f'state.q[3:5] = {q[3:5].tolist()}: with fingers="driven" {rule}')
    if np.abs(q[5:7] - on[5:7]).max() > _OFF * max(tip.radius for tip in scene.hand.tips):
        there = f"which gives {on[5:7].tolist()}; State.consistent() makes such a state"
        rule = f"compressions must satisfy C^H = 0 (9), {there}"
        raise ValueError(f"state.q[5:7] = {q[5:7].tolist()}: {rule}")


def _selected(
    found: _core._Linear,
    state: State,
    names: tuple[str, ...],
    ins: states.Ports,
    outs: states.Ports,
    own: Jaws,
) -> LinearModel:
    """The model with the chosen rows and columns."""
    columns, rows = list(ins.places), list(outs.places)
    # The rows w of d_t + Phi_N pose (k, N): at rest, d_t changes at -Phi_N times the pose's rates.
    pose, _, shears = states.places(names)
    slips = np.zeros((len(shears), len(names)))
    slips[:, pose] = -states.shears_by_pose(found["A"][0], names)
    slips[:, shears] = np.eye(len(shears))
    at_rest = not found["output"][0, 15:].any()
    return LinearModel(
        A=found["A"][0],
        B=found["B"][0][:, columns],
        C=found["C"][0][rows],
        D=found["D"][0][rows][:, columns],
        states=names,
        inputs=ins.names,
        outputs=outs.names,
        state_units=tuple(of_column(name, states.unit_of(name), own) for name in names),
        input_units=tuple(map(of_column, ins.names, ins.units, repeat(own))),
        output_units=tuple(map(of_column, outs.names, outs.units, repeat(own))),
        state_values=found["state"][0],
        input_values=found["input"][0, columns],
        output_values=found["output"][0, rows],
        state_rates=found["rate"][0],
        state=state,
        neutral=slips if at_rest else slips[:0],
    )


def _without_neutral(model: LinearModel) -> LinearModel:
    """The model on the subspace in which the neutral combinations are zero: d_t = -Phi_N pose.

    The share of driven angles in it goes from B's columns of their rates to those of the angles.
    """
    names, inputs = model.states, model.inputs
    pose, _, shears = states.places(names)
    if len(model.neutral) < len(shears):
        moves = "the operating point moves (state.p is not zero)"
        why = "the no-slip constraint turns with it and ties no shear to the pose"
        raise ValueError(f"reduced = True: {moves}, so {why}; reduced = False keeps all states")
    rows = states.kept(names)
    # d_t by the pose and by the inputs.
    by_pose = -model.neutral[:, pose]
    by_inputs = np.zeros((len(shears), len(inputs)))
    for name in ("target_1", "target_2"):
        rate = f"rate of {name}"
        if rate in inputs:
            by_inputs[:, inputs.index(name)] = model.B[shears, inputs.index(rate)]
    a, c = model.A[rows], model.C
    return replace(
        model,
        A=states.without_shears(a, by_pose, names),
        B=model.B[rows] + a[:, shears] @ by_inputs,
        C=states.without_shears(c, by_pose, names),
        D=model.D + c[:, shears] @ by_inputs,
        states=tuple(names[k] for k in rows),
        state_units=tuple(model.state_units[k] for k in rows),
        state_values=model.state_values[rows],
        state_rates=model.state_rates[rows],
        neutral=model.neutral[:0, rows],
    )
