"""`work_precision`: error against run time of every pair, with an independent reference."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..run.options import some_names
from ..scene import usual
from ..scene.contact import formulations_of, require_formulations
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.choices import Formulation, Method
from ..support.progress import Report, reporting
from . import own_reference
from .measurements import Measurement, Peer, WorkPrecision
from .precision_runs import Curve, end_of, peer_rows, switching
from .stability import trusted_run

# The default steps: the longest as a multiple of the mean step that a stiff method takes at
# tolerance 1e-6, and the number of steps, each half of the one before.
_LONGEST, _HALVINGS = 16.0, 11
_TOLERANCES = 10.0 ** -np.arange(2.0, 12.0)


def work_precision(
    scene: Scene,
    *,
    formulations: Formulation | Sequence[Formulation] | None = None,
    methods: Method | Sequence[Method] = _core.METHODS,
    dt: ArrayLike | None = None,
    tolerances: ArrayLike | None = None,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    peers: Iterable[Peer] = (),
    longest: float = 2.0,
    progress: bool | Report = True,
) -> WorkPrecision:
    """Measures error and run time of every pair of formulation and method over a sweep of steps.

    An error is the largest over components of |difference| from the reference, each component
    divided by its largest magnitude along the run; q, p and lambda have separate errors
    (docs/error-against-run-time.md, "The problem"). SciPy computes the reference from an
    independent statement of the equations, and a second method confirms it (`softpinch.reference`).
    This statement has no unilateral contact: there the reference is a run of the core itself, by
    "dop853" with adaptive steps at a tight tolerance, which a run with another formulation
    confirms; `WorkPrecision.reference` says so. Rows at the very instant of a change of a contact
    are not compared, because the change may come just before or just after them.

    Args:
        scene: The scene to simulate. The reference ignores violations, so a run that a violation
            ends counts as failed.
        formulations: Formulations to measure; None measures all that the scene's contact allows,
            which are "csm" and "projected" in unilateral contact.
        methods: Methods to measure.
        dt: Longest steps, s, (k,); None takes eleven, each half of the one before, starting at 16
            times the mean step that a stiff method takes at tolerance 1e-6.
        tolerances: Tolerances for the methods with adaptive steps, (k,); None takes 1e-2 to 1e-11;
            () measures no adaptive steps.
        stabilization: The gains of "csm".
        peers: External solvers to measure on this scene.
        longest: A setting expected to take longer is not run, s; `WorkPrecision.skipped` lists it.
        progress: As for `monte_carlo`.

    Raises:
        ValueError: An argument breaks its rule, or the scene starts off the constraints.
        TypeError: An argument is of the wrong kind.
        RuntimeError: The reference cannot be computed, usually because the grasp is lost.
        ImportError: SciPy is not installed.
        KeyboardInterrupt: Ctrl-C.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    if formulations is None:
        formulations = formulations_of(scene)
    kept = some_names("formulations", formulations, _core.FORMULATIONS)
    require_formulations("formulations", kept, scene)
    stepped = some_names("methods", methods, _core.METHODS)
    longest = checks.positive("longest", longest)
    steps = _default_steps(scene) if dt is None else ladder("dt", dt)
    allowed = _TOLERANCES if tolerances is None else ladder("tolerances", tolerances)
    switches = switching(scene)
    ours = [
        Curve(scene, (formulation, method), setting, values, stabilization, switches)
        for formulation in kept
        for method in stepped
        for setting, values in (("dt", steps), ("tolerance", allowed))
        if setting == "dt" or method in _core.ADAPTIVE_METHODS
    ]
    others = checks.several("peers", peers, "Peers")
    for each in others:
        checks.instance("peers", each, Peer)
    total = sum(len(curve.values) for curve in ours) + sum(len(peer.values) for peer in others)
    skipped: list[str] = []
    rows: list[Measurement] = []
    usual.warn(scene)
    with reporting(progress, "measuring") as report:
        instants = np.unique(np.concatenate([curve.look(longest) for curve in ours]))
        exact = own_reference.best(scene, np.union1d(instants, [end_of(scene)]))
        for curve in ours:
            rows += curve.measured(exact, skipped)
            report(len(rows), total)
        for peer in others:
            rows += peer_rows(peer, scene, exact, longest, skipped)
            report(len(rows), total)
    assert exact.own_error is not None
    return WorkPrecision(
        scene=scene,
        rows=tuple(rows),
        reference=exact.method,
        floor=dict(exact.own_error),
        stabilization=stabilization,
        skipped=tuple(skipped),
    )


def ladder(name: str, values: ArrayLike) -> Floats:
    """Checks the values of `dt` or `tolerances`, and sorts them from loose to tight, (k,)."""
    given = checks.numbers(name, values)
    if given.size == 0 and name == "tolerances":
        return given.reshape(0)
    ladder = np.unique(checks.array(name, given, ("k",)))[::-1]
    if not (ladder > 0).all():
        raise ValueError(f"{name} = {ladder[-1]}: must be > 0")
    if name == "tolerances" and not (ladder[0] < 1.0 and ladder[-1] >= 1e-14):
        wrong = ladder[0] if ladder[0] >= 1.0 else ladder[-1]
        raise ValueError(f"tolerances = {wrong}: must be from 1e-14 to below 1")
    return ladder


def _default_steps(scene: Scene) -> Floats:
    stiff = trusted_run(scene, tolerance=1e-6)
    mean = scene.duration / max(stiff.stats["steps"], 1)
    steps = _LONGEST * mean * 0.5 ** np.arange(_HALVINGS)
    return np.unique(np.minimum(steps, scene.duration))[::-1]
