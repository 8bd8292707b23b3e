"""`equilibrium`, which finds where a grasp comes to rest, and whether it stays."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..run.request import rest_scene
from ..run.run import Run
from ..scene.contact import coefficients
from ..scene.control import SampledController
from ..scene.outline import drawings
from ..scene.parts import branches
from ..scene.scene import Scene, State
from ..support import checks
from ..support.arrays import Complexes, Floats
from ..support.result import Result
from .sampled_rest import sampled_eigenvalues, sampled_rest
from .states import kept, linear_at, shears_by_pose, state_names, without_shears

# The violations that a tip which can slip and open does not stand at rest.
_UNILATERAL = ("pulling", "slipping", "off_face")
_INTEGRALS = ("integral_1", "integral_2")
_GAINS = [_core.PARAMETERS.index(f"control.{side}.ki") for side in ("right", "left")]
# A real part of an eigenvalue below this share of the largest eigenvalue is round-off.
ROUND_OFF = 1e-13


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Equilibrium(Result):
    """A state of rest of a scene, or the reason why there is none.

    Without an equilibrium `state` is None, `message` has the reason, `stable` and `minimum` are
    False, and all numbers are nan. The no-slip constraint (12) restricts velocities only. So the
    grasp can rest in a family of states with two parameters, `grip`, by the way there.

    Attributes:
        scene: The scene.
        time: The instant whose inputs hold, s.
        state: The state at rest, from which `simulate` can start; None if there is none. A run
            stays there while the inputs keep the values of `time`; driven fingers that move at
            `time` cannot start at rest. A `SampledController` starts anew at `time`.
        status: "at_rest", or why there is no equilibrium: "apart" (the tips do not reach the
            object unless it is turned between them), "overloaded" (the object is too heavy, or
            pushed too hard), "separated", "crushed" or "folded" (a tip leaves the range of the
            model), "pulling", "slipping" or "off_face" (in unilateral contact), or "not_found".
        message: The result in words.
        multipliers: lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N (4,), N; positive lambda^H
            presses the tip on the object.
        torque: The holding torques on the right and the left finger (2,), N m, or N of a jaw,
            positive where they close it, as in `Run.torque`.
        stiffness: The stiffness of the grasp (3, 3), N/m, N and N m/rad: the force and the moment
            on the object that a displacement in x, y and theta needs while the fingers are held.
            It is not symmetric, because the forms of the no-slip constraint (12) are no
            differentials: K - K^T has the entries +-(lambda_1^N + lambda_2^N) cos(theta) in x and
            theta, and the same with sin(theta) in y and theta.
        eigenvalues: Eigenvalues of the linearised motion with its fingers (N,), 1/s, by their real
            parts, largest first. The two zeros of the family come first of all. Integrals of a PID
            with K_I = 0, which drive nothing, are left out. Of a `SampledController` they are
            ln(f) / period, of the factors f by which deviations grow in the common period of its
            blocks; nan if it has none (`sp.loop`).
        stable: Whether the other eigenvalues have negative real parts: the grasp comes to rest
            again after a small push.
        minimum: Whether elastic energy and gravity have a minimum along every displacement that
            the no-slip constraint admits. Fingers that are not held are displaced too; K_P then
            counts as a spring, a torque of the schedule as a constant force. A
            `SampledController` holds the fingers.
        neutral: The derivatives of q along the family by the grip of the right and left tip (2, 9).
        grip: Where each tip holds the object's face (2,), m above the centre of gravity: there its
            middle would be, if it were turned upright without shear.
        energy: Elastic energy (5) plus energy of gravity (16), J.
        elastic_energy: The elastic energy (5) alone, J.
        violations: Assumptions of the model that do not hold at rest: "pulling", "slipping"
            (the scene's friction does not suffice), "rim" or "off_face".
    """

    scene: Scene
    time: float
    state: State | None
    status: str
    message: str
    multipliers: Floats = field(default_factory=lambda: np.full(4, np.nan))
    torque: Floats = field(default_factory=lambda: np.full(2, np.nan))
    stiffness: Floats = field(default_factory=lambda: np.full((3, 3), np.nan))
    eigenvalues: Complexes = field(default_factory=lambda: np.empty(0, np.complex128))
    stable: bool = False
    minimum: bool = False
    neutral: Floats = field(default_factory=lambda: np.full((2, 9), np.nan))
    grip: Floats = field(default_factory=lambda: np.full(2, np.nan))
    energy: float = np.nan
    elastic_energy: float = np.nan
    violations: tuple[str, ...] = ()

    @property
    def growth(self) -> float:
        """The spectral abscissa without the two zeros, 1/s: the largest real part of the others.

        A deviation grows or decays as exp(growth t) in the end; nan without an equilibrium.
        """
        rates = self.eigenvalues[2:].real
        return float(rates.max()) if rates.size else np.nan

    @property
    def friction_needed(self) -> Floats:
        """|lambda^N| / lambda^H of both contacts (2,); inf where a tip pulls."""
        pressing, along = self.multipliers[:2], np.abs(self.multipliers[2:])
        otherwise = np.where(pressing <= 0.0, np.inf, np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(pressing > 0.0, along / pressing, otherwise)

    @property
    def friction_margin(self) -> float:
        """The smallest mu - |lambda^N| / lambda^H; inf if the scene has no `friction`."""
        mu, needed = np.array(coefficients(self.scene.friction)), self.friction_needed
        # A tip that pulls needs infinite friction, and a contact without a limit has it.
        free = np.isinf(mu) & ~np.isnan(needed)
        return float(np.min(np.where(free, np.inf, np.where(free, 0.0, mu) - needed)))

    def __repr__(self) -> str:
        if self.state is None:
            return f"<Equilibrium {self.status}: {self.message}>"
        # Adding zero turns -0.0 into 0.0.
        x, y, theta = np.round(self.state.q[:3] * [1e3, 1e3, np.degrees(1.0)], 3) + 0.0
        place = f"x = {x:.3f} mm, y = {y:.3f} mm, theta = {theta:.3f} deg"
        return f"<Equilibrium {place}: {self.message}>"

    def _picture(self) -> str:
        if self.state is None:
            return ""
        return drawings(self.scene, [np.asarray(self.state.q)], [f"at rest, t = {self.time:.6g} s"])


def equilibrium(
    scene: Scene,
    time: float | None = None,
    shear: ArrayLike | None = None,
    near: State | Run | None = None,
    *,
    grip: ArrayLike | None = None,
) -> Equilibrium:
    """Finds where a grasp comes to rest under the inputs of one instant, or why it does not.

    The forces balance at p = 0: f_5 - Phi_5^T f_d = 0 on the null space of Phi (docs/equilibria.md,
    "The equations"). Fingers with integral action and driven fingers stand at their targets. A PID
    without K_I gives way until its torque balances, and fingers with `Torque()` until the
    schedule's torque does. A `SampledController` rests where its own equations at rest, and the
    balance of its torques, have one solution; noise, resolution and dead zones are left out.

    The equilibria of a scene are a family with two parameters. `grip`, `shear` or `near` says which
    one is meant; by default both tips hold the object at the height of its centre of gravity.

    Args:
        scene: The scene. Its start is not used.
        time: The instant whose targets and forces hold, s: of an input that jumps there, the value
            after the jump. None takes the end of the schedule and of the scene, whichever is later,
            or the time of `near`; of a run, the last instant before its end. Sines and noise, whose
            mean is zero, and impulses are left out.
        shear: The shears d_t1 and d_t2 at rest (2,), m. Prefer `grip`: in an upright symmetric
            grasp most shears have no equilibrium and others have many.
        near: A state, or a run whose last state is meant. The search begins there; without `shear`
            and `grip` it finds the member to which the no-slip constraint leads from there, which
            is where a settled run will be at rest.
        grip: Where the tips hold the object's faces (2,), right and left, m above its centre of
            gravity (`Equilibrium.grip`).

    Raises:
        ValueError: Both `shear` and `grip` are given, or the scene's `SampledController` has no
            unique rest, as without gains on angles, or a measure decides which gains act.
    """
    checks.instance("scene", scene, Scene)
    if shear is not None and grip is not None:
        raise ValueError("shear and grip: give one of them, each chooses the member of the family")
    # The coordinates at which the search begins, and their instant.
    start, instant = None, 0.0
    if near is not None:
        checks.instance("near", near, (State, Run), "a State, a Run or None")
        state = near.state(-1) if isinstance(near, Run) else near
        start, instant = state.q, state.time
    if time is not None:
        instant = checks.finite("time", time)
    elif start is None:
        instant = last_instant(scene)
    elif isinstance(near, Run):
        # A run that ends where its targets switch has come to rest under those before. The
        # eigenvalues depend on them too, so this is the equilibrium's own instant.
        instant = float(np.nextafter(instant, -np.inf))
    if shear is not None:
        kind, member = "shear", checks.array("shear", shear, (2,))
    elif grip is not None:
        kind, member = "grip", checks.array("grip", grip, (2,))
    else:
        kind, member = ("grip", np.zeros(2)) if start is None else ("from", start)
    control = scene.control
    if not isinstance(control, SampledController):
        found = rest_scene(scene, instant).equilibrium(kind, member, start)
        return from_core(scene, instant, found, kind, member)
    control = control.gains_at(instant)
    found, row, message = sampled_rest(scene, control, instant, kind, member, start)
    if message:
        status = "not_found" if found["status"] == "at_rest" else found["status"]
        return _no_equilibrium(scene, instant, status, message, kind, member)
    return from_core(scene, instant, found, kind, member, row)


def last_instant(scene: Scene) -> float:
    """The end of the schedule and of the scene, whichever is later, s."""
    begin = scene.initial.time if isinstance(scene.initial, State) else 0.0
    return max(begin + scene.duration, scene.schedule.end)


def from_core(
    scene: Scene, time: float, found: Any, kind: str, member: Floats, row: Floats | None = None
) -> Equilibrium:
    """Makes an `Equilibrium` from the core's result of a search, and `State.controller`."""
    status = found["status"]
    if status != "at_rest":
        return _no_equilibrium(scene, time, status, found["message"], kind, member)
    violations = tuple(found["violations"])
    if scene.contact == "unilateral":
        for name in _UNILATERAL:
            if name in violations:
                words = f"with sticking tips {_WORDS[name]}"
                return _no_equilibrium(scene, time, name, words, kind, member)
    # The integral of a tiny K_I, or the rates of tiny masses, may overflow.
    if not np.isfinite(found["integral"]).all():
        words = "the PID's integral overflows"
        return _no_equilibrium(scene, time, "not_found", words, kind, member)
    control = scene.control
    if isinstance(control, SampledController):
        control, state = control.gains_at(time), State(found["q"], time=time, controller=row)
        eigenvalues, known = sampled_eigenvalues(scene, control, state, found["torque"])
    else:
        state = State(found["q"], integral=tuple(found["integral"].tolist()), time=time)
        eigenvalues = _eigenvalues(scene, state)
        known = np.abs(eigenvalues).max() * ROUND_OFF
    growing = eigenvalues[2:].real.max(initial=-np.inf)
    stable = bool(growing < -known)
    return Equilibrium(
        scene=scene,
        time=time,
        state=state,
        status=status,
        message=_message(growing, known, violations),
        multipliers=found["multipliers"],
        torque=found["torque"],
        stiffness=found["stiffness"],
        eigenvalues=eigenvalues,
        stable=stable,
        minimum=found["minimum"],
        neutral=found["neutral"],
        grip=found["grip"],
        energy=found["elastic"] + found["gravity"],
        elastic_energy=found["elastic"],
        violations=violations,
    )


def _no_equilibrium(
    scene: Scene, time: float, status: str, reason: str, kind: str, member: Floats
) -> Equilibrium:
    """The reason why there is no equilibrium, which of a grip or shears is not that of others."""
    message = f"no equilibrium: {reason}"
    if kind != "from":
        right, left = 1e3 * member
        where = f"{kind} = ({right:.6g}, {left:.6g}) mm"
        advice = "sp.equilibrium(scene, near=run) finds where a run settles"
        message = f"no equilibrium with {where}: {reason}; no other {kind} was searched; {advice}"
    return Equilibrium(scene=scene, time=time, state=None, status=status, message=message)


_WORDS = {
    "pulling": "a tip would have to pull",
    "slipping": "a tip would slip",
    "off_face": "a contact would lie beyond the end of its face",
    "rim": "a contact reaches the rim of its tip",
}


def _message(growing: float, known: float, violations: tuple[str, ...]) -> str:
    """The result in words; `known` is the smallest real part that is not round-off."""
    if growing < -known:
        words = ["at rest, stable"]
    elif growing > known:
        words = [f"at rest, but unstable: a deviation grows with {growing:.6g} 1/s"]
    elif np.isfinite(growing):
        words = ["at rest; whether the slowest deviation grows or decays is hidden by round-off"]
    else:
        words = ["at rest; whether it is stable is not known, because eigenvalues are not finite"]
    return "; ".join([*words, *(_WORDS[name] for name in violations if name in _WORDS)])


def _eigenvalues(scene: Scene, state: State) -> Complexes:
    """Eigenvalues of the linearised motion (N,), 1/s: the two zeros, then by their real parts."""
    a = linear_at(scene, state, frozen=True)["A"][0]
    names = state_names(scene.law, "nullspace", branches(scene))
    rows = kept(names)
    a = without_shears(a, shears_by_pose(a, names), names)[rows]
    # Integrals that drive nothing are left out: they would be zeros too.
    gains = dict(zip(_INTEGRALS, scene.parameters()[_GAINS], strict=True))
    driving = [k for k, row in enumerate(rows) if gains.get(names[row], 1.0)]
    a = a[np.ix_(driving, driving)]
    if not np.isfinite(a).all():
        return np.full(len(a) + 2, complex(np.nan, np.nan))
    values = np.linalg.eigvals(a)
    return np.concatenate([np.zeros(2, np.complex128), values[np.argsort(-values.real)]])
