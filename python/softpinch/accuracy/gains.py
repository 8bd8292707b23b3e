"""What the gains of the stabilisation (19, 20) do at one step: drift, and error of the motion."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..run.simulate import not_interrupted, simulate
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.errors import StabilityWarning
from ..support.result import Result
from . import reference
from .precision import ladder
from .precision_runs import EVERYTHING, Look, end_of, errors, look_at, switching


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilizationSweep(Result):
    """What the gains of (19, 20) do at one step: drift, and error of the motion.

    Attributes:
        dt: The step, s.
        method: How time is stepped.
        product: alpha dt = beta dt, (k,).
        status: Of each run.
        holonomic: Largest |C^H| along the run, m; inf of a run that did not complete.
        nonholonomic: Largest |C^N|, m/s.
        error: Largest error of q, p along the run, each component against its largest size.
        multipliers: The same of lambda.
        without: The same of "nullspace", which has no gains: "holonomic", "nonholonomic",
            "q and p", "multipliers".
    """

    dt: float
    method: str
    product: Floats
    status: tuple[str, ...]
    holonomic: Floats
    nonholonomic: Floats
    error: Floats
    multipliers: Floats
    without: Mapping[str, float]


def stabilization_sweep(
    scene: Scene,
    dt: float = 1e-4,
    method: str = "rk4",
    products: ArrayLike | None = None,
) -> StabilizationSweep:
    """Sweeps alpha dt = beta dt: a gain that hides drift can spoil the motion.

    Args:
        scene: On what.
        dt: The longest step, s.
        method: How time is stepped.
        products: alpha dt, (k,); None takes 33 from 1e-4 to 10.

    Raises:
        ValueError: An argument breaks its rule, or the scene starts off the constraints.
        TypeError: An argument is of the wrong kind.
        RuntimeError: The reference cannot be computed.
        ImportError: SciPy is not installed.
    """
    checks.instance("scene", scene, Scene)
    dt = checks.positive("dt", dt)
    method = checks.choice("method", method, _core.METHODS)
    given = np.geomspace(1e-4, 10.0, 33) if products is None else ladder("products", products)[::-1]

    switches = switching(scene)

    def look(formulation: str, gain: float) -> Look:
        run = simulate(
            scene,
            dt=dt,
            method=method,
            formulation=formulation,
            stabilization=Stabilization(alpha=gain, beta=gain),
            record=EVERYTHING,
        )
        return look_at(not_interrupted(run), switches)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StabilityWarning)
        plain, *looks = [look("nullspace", 0.0), *(look("csm", x / dt) for x in given.tolist())]
    instants = np.unique(np.concatenate([each.t for each in (plain, *looks)]))
    exact = reference.confirmed(scene, np.union1d(instants, [end_of(scene)]))
    along = [_along(each, exact) for each in looks]
    own = _along(plain, exact)
    finite = np.array([each.status == "completed" for each in looks])
    return StabilizationSweep(
        dt=dt,
        method=method,
        product=given,
        status=tuple(each.status for each in looks),
        holonomic=np.where(finite, [each.holonomic for each in looks], np.inf),
        nonholonomic=np.where(finite, [each.nonholonomic for each in looks], np.inf),
        error=np.array([max(each["q"], each["p"]) for each in along]),
        multipliers=np.array([each["multipliers"] for each in along]),
        without={
            "holonomic": plain.holonomic,
            "nonholonomic": plain.nonholonomic,
            "q and p": max(own["q"], own["p"]),
            "multipliers": own["multipliers"],
        },
    )


def _along(look: Look, exact: reference.Reference) -> dict[str, float]:
    """The largest errors over all rows."""
    found = errors(look, exact, exact.t[:1])
    return {name: float(size) for name, size in found["smooth"].items()}
