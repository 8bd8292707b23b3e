"""Every term of the equations of motion at one state."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from numpy.typing import ArrayLike

from .. import _core
from ..scene import Scene, Stabilization
from ..scene.contact import require_bilateral
from ..scene.control import require_known_torque
from ..support import Floats, Formulation, Result, checks


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Forces(Result):
    """Generalised forces (9,) in the order of q, N and N m.

    Attributes:
        elastic: Minus the gradient of P (5), as `gravity` is that of P_g (16).
        viscous: The viscous forces of the fingertips (44, 45).
        control: The PID torques (39), or the driving torques of "driven" fingers.
        external: The disturbances at this instant, without impulses.
    """

    elastic: Floats
    gravity: Floats
    viscous: Floats
    control: Floats
    external: Floats

    @property
    def total(self) -> Floats:
        """The sum of these forces (9,), which excludes the constraint forces."""
        return self.elastic + self.gravity + self.viscous + self.control + self.external


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Energies(Result):
    """The kinetic energy p^T M p / 2, P of (5) and P_g of (16) at one state, J."""

    kinetic: float
    elastic: float
    gravity: float

    @property
    def total(self) -> float:
        """The sum of the energies, J."""
        return self.kinetic + self.elastic + self.gravity


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Evaluation(Result):
    """Every term at one state, in the order of q and of (C_1^H, C_2^H, C_1^N, C_2^N).

    Attributes:
        mass_matrix: M (14), (9, 9); `constraint_matrix` is Phi (25), (4, 9).
        constraint_rate: b = (dPhi/dt) p, (4,), m/s^2.
        residuals: C^H (9), m, and C^N (12), m/s, (4,); `residual_rates` are dC^H/dt, (2,), m/s.
        forces: All forces except the constraint forces; `energies` are those of (5), (14) and (16).
        multipliers: lambda (4,), N; `accelerations` are dp/dt, (9,), m/s^2 and rad/s^2.
        target: Target angles theta_1^d and theta_2^d, (2,), rad.
    """

    mass_matrix: Floats
    constraint_matrix: Floats
    constraint_rate: Floats
    residuals: Floats
    residual_rates: Floats
    forces: Forces
    multipliers: Floats
    accelerations: Floats
    energies: Energies
    target: Floats


def evaluate(
    scene: Scene,
    t: float,
    q: ArrayLike,
    p: ArrayLike,
    integral: ArrayLike = (0.0, 0.0),
    *,
    formulation: Formulation = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
) -> Evaluation:
    """Evaluates every term of (24) at one state, which may violate the constraints.

    These are the terms of bilateral contact. `replace(scene, contact="bilateral")` gives them for a
    scene with unilateral contact; they are its own terms while both tips stick.

    Args:
        scene: The physics, with bilateral contact; the scene's start is not used.
        t: Time on the clock of schedule and disturbances, s. At a jump of an input, the value after
            the jump is used.
        q, p, integral: As of `State`, (9,), (9,) and (2,).
        formulation, stabilization: As for `simulate`; of multipliers and accelerations.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    advice = 'replace(scene, contact="bilateral") gives them, which hold while both tips stick'
    require_bilateral(scene, "evaluate", f"has the terms of bilateral contact only; {advice}")
    require_known_torque(scene.law, "evaluate")
    found = _core.evaluate(
        scene.parameters(),
        scene.inputs(),
        checks.finite("t", t),
        checks.array("q", q, (9,)),
        checks.array("p", p, (9,)),
        checks.array("integral", integral, (2,)),
        checks.choice("formulation", formulation, _core.FORMULATIONS),
        stabilization.alpha,
        stabilization.beta,
    )
    terms: dict[str, Any] = {**found}
    forces = {f.name: terms.pop(f.name) for f in fields(Forces)}
    energies = {f.name: terms.pop(f"{f.name}_energy") for f in fields(Energies)}
    return Evaluation(**terms, forces=Forces(**forces), energies=Energies(**energies))
