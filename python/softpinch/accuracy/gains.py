"""Effect of the stabilisation gains (19, 20) at one step: constraint drift, error of the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..run.options import Options
from ..scene import usual
from ..scene.contact import without_drift
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.choices import Formulation, Method
from ..support.result import Result
from . import own_reference, reference
from .precision import ladder
from .precision_runs import EVERYTHING, Look, end_of, errors, look_at, switching
from .trial_run import TrialRun


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StabilizationSweep(Result):
    """Effect of the gains of (19, 20) at one step: constraint drift, and error of the motion.

    Attributes:
        dt: The step, s.
        method: How time is stepped.
        product: Gain times step, alpha dt = beta dt, (k,).
        status: Status of each run (k,).
        holonomic: Largest |C^H| along each run (k,), m; inf if the run did not complete.
        nonholonomic: Largest |C^N| along each run (k,), m/s; inf if the run did not complete.
        error: Largest error of q and p along each run (k,), each component divided by its largest
            magnitude; inf if the run did not complete.
        multipliers: Largest error of lambda along each run (k,), scaled likewise.
        without: The four results of a run with "nullspace", or with "projected" in unilateral
            contact, which have no gains: "holonomic", "nonholonomic", "q and p", "multipliers".
    """

    dt: float
    method: Method
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
    method: Method = "rk4",
    products: ArrayLike | None = None,
) -> StabilizationSweep:
    """Runs a scene with "csm" over a range of gains, and measures drift and error of the motion.

    A gain that removes drift may at the same time make the motion wrong. Errors are relative to the
    same reference as in `work_precision`. Drift is that of the constraints that contacts hold.

    Args:
        scene: The scene to simulate.
        dt: The longest step, s.
        method: How time is stepped.
        products: Values of alpha dt = beta dt, (k,); None takes 33 from 1e-4 to 10, by equal
            factors.

    Raises:
        ValueError: An argument breaks its rule, or the scene starts off the constraints.
        TypeError: An argument is of the wrong kind.
        RuntimeError: The reference cannot be computed.
        ImportError: SciPy is not installed.
        KeyboardInterrupt: Ctrl-C.
    """
    checks.instance("scene", scene, Scene)
    dt = checks.positive("dt", dt)
    method = checks.choice("method", method, _core.METHODS)
    given = np.geomspace(1e-4, 10.0, 33) if products is None else ladder("products", products)[::-1]

    switches = switching(scene)

    def look(formulation: Formulation, gain: float) -> Look:
        options = Options.checked(
            dt=dt,
            method=method,
            formulation=formulation,
            stabilization=Stabilization(alpha=gain, beta=gain),
            record=EVERYTHING,
        )
        return look_at(TrialRun.of(scene, options).run, switches)

    usual.warn(scene)
    plain, *looks = [
        look(without_drift(scene), 0.0),
        *(look("csm", x / dt) for x in given.tolist()),
    ]
    instants = np.unique(np.concatenate([each.t for each in (plain, *looks)]))
    exact = own_reference.best(scene, np.union1d(instants, [end_of(scene)]))
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
    """Quantity -> largest error over all sampled rows of a run."""
    found = errors(look, exact, exact.t[:1])
    return {name: float(size) for name, size in found["smooth"].items()}
