"""The reference of a scene: SciPy's, or the core's own where unilateral contact needs it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..run import scaled_error
from ..run.run import Run
from ..run.simulate import not_interrupted, simulate
from ..scene.scene import Scene
from ..support.arrays import Floats, read_only
from . import reference
from .reference import Reference

# Formulation and tolerance of the reference, and of the run that confirms it.
_RUNS = (("projected", 1e-13), ("csm", 1e-12))
# Besides the wanted instants, the magnitudes of the components are looked for at so many.
_INSTANTS = 1000


def best(scene: Scene, times: Floats) -> Reference:
    """Solves a scene by the most independent means that can: `reference.confirmed`, or the core.

    Args:
        scene: The scene.
        times: Wanted instants (n,), s, increasing, of which the last is the end of the run.

    Raises:
        RuntimeError: There is no reference; the message has the reason.
        ValueError: As `reference.confirmed`.
        ImportError: SciPy is not installed, for a scene with bilateral contact.
        KeyboardInterrupt: Ctrl-C.
    """
    if scene.contact == "bilateral":
        return reference.confirmed(scene, times)
    first, second = (_accurate(scene, times, *how) for how in _RUNS)
    return replace(
        first,
        method=f"{first.method}, confirmed by {second.method}: the core's own runs, because the "
        "independent reference has no unilateral contact",
        evaluations=first.evaluations + second.evaluations,
        own_error=scaled_error.largest(second, first),
    )


def _accurate(scene: Scene, times: Floats, formulation: str, tolerance: float) -> Reference:
    begin = float(scene.start().time)
    asked = np.union1d(times, np.linspace(begin, times[-1], _INSTANTS))
    run = not_interrupted(
        simulate(
            scene,
            method="dop853",
            formulation=formulation,  # type: ignore[arg-type]
            tolerance=tolerance,
            times=asked,
            record=("state", "multipliers"),
        )
    )
    if not run.success:
        raise RuntimeError(
            f"reference: with unilateral contact {formulation} ended as {run.status} at t = "
            f"{run.t[-1]} s: {run.message}"
        )
    return _as_reference(run, times, f"{formulation} dop853 at tolerance {tolerance:.0e}")


def _as_reference(run: Run, times: Floats, method: str) -> Reference:
    rows = np.searchsorted(run.t, times)
    usual = scaled_error.usual(run.scene)
    return Reference(
        t=times,
        q=read_only(run.q[rows]),
        p=read_only(run.p[rows]),
        multipliers=read_only(run.multipliers[rows]),
        integral=read_only(run.integral[rows]),
        method=method,
        evaluations=run.stats["evaluations"],
        scales={
            name: read_only(scaled_error.scales(name, getattr(run, name), usual))
            for name in scaled_error.UNITS
        },
    )
