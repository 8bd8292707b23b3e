"""`explain`: the size of a scene's equations, the computed parts, memory, and the time of a step.

docs/what-a-scene-pays.md has the measurements behind the choices.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..scene import Scene, Stabilization, parts
from ..scene.control import WRITTEN, Pid, SampledController
from ..scene.piecewise import Piecewise
from ..support import Floats, Formulation, Method, Recordable, Result, Violation, checks
from .options import STOP_ON, Options, names
from .request import Request

# Bytes of a run in an ensemble without its summaries: number, status, message, end time, steps,
# the final state and the first time of each violation, with eight bytes each.
_ROW = 8 * (5 + 18 + len(_core.VIOLATIONS))
# A timing measures this many steps, this many times, and stops after this many seconds.
_STEPS, _REPEATS, _PATIENCE = 2000, 5, 0.5


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Term(Result):
    """An optional part of the computation, whether it is computed, and why or why not."""

    name: str
    kept: bool
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Explanation(Result):
    """The size and the cost of the computation that a scene compiles to. `print` shows a report.

    Attributes:
        formulation: As of `simulate`, and so is `method`.
        fingers: "pid", "torque", "sampled" or "driven".
        simd: The processor instructions that the core uses.
        degrees: Number of velocities that the equations are solved for.
        states: Number of values that a step advances, including the works of the energy ledger.
        terms: The optional parts, computed or left out.
        segments: Number of intervals between the instants at which an input jumps or kinks.
        steps: Number of steps of a run; None if the error control chooses them.
        bytes_recorded: Bytes of a run's recorded arrays; None if the number of rows is unknown.
        bytes_in_ensemble: Bytes of a run's row in an `Ensemble`, without the varied values.
        seconds_per_step: Measured time of a step in a lone run, s; None if it was not measured.
    """

    formulation: Formulation
    method: Method
    fingers: str
    simd: str
    degrees: int
    states: int
    terms: tuple[Term, ...]
    segments: int
    steps: int | None
    bytes_recorded: int | None
    bytes_in_ensemble: int
    seconds_per_step: float | None

    @property
    def kept(self) -> tuple[str, ...]:
        """The names of the parts that are computed."""
        return tuple(term.name for term in self.terms if term.kept)

    @property
    def left_out(self) -> tuple[str, ...]:
        """The names of the parts that are not computed."""
        return tuple(term.name for term in self.terms if not term.kept)

    def __str__(self) -> str:
        steps = "steps chosen by the error control" if self.steps is None else f"{self.steps} steps"
        segments = "segment" if self.segments == 1 else "segments"
        lines = [
            f"{self.formulation}, {self.method}, {self.fingers} fingers, {self.simd}: "
            f"{self.degrees} velocities, {self.states} states",
            f"{steps} in {self.segments} {segments}",
        ]
        width = max(len(term.name) for term in self.terms)
        for title, kept in (("computed", True), ("left out", False)):
            lines.append(f"{title}:")
            lines += [f"  {t.name:{width}}  {t.reason}" for t in self.terms if t.kept == kept]
        if self.seconds_per_step is not None:
            lines.append(f"a step, measured time: {1e9 * self.seconds_per_step:.0f} ns")
        if self.bytes_recorded is not None:
            lines.append(f"recorded: {self.bytes_recorded} bytes")
        lines.append(f"in an ensemble: {self.bytes_in_ensemble} bytes a run")
        return "\n".join(lines)


def explain(
    scene: Scene,
    dt: float | None = None,
    method: Method = "rk4",
    formulation: Formulation = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: Recordable | Sequence[Recordable] = ("state",),
    every: int = 1,
    stop_on: Violation | Sequence[Violation] = STOP_ON,
    *,
    tolerance: float | None = None,
    times: ArrayLike | None = None,
    max_steps: int | None = None,
    summaries: str | Sequence[str] = (),
    measure: bool = True,
) -> Explanation:
    """Explains the computation that `simulate` or `monte_carlo` would do with these arguments.

    The arguments are those of `simulate`, and two more.

    Args:
        summaries: As in `monte_carlo`.
        measure: Whether to time some steps from the scene's start, for about half a second at most.
    """
    checks.instance("scene", scene, Scene)
    how = (dt, method, formulation, stabilization, record, every, stop_on)
    options = Options.checked(*how, tolerance, times, max_steps)
    wanted = names("summaries", summaries, ("final_state", *_core.SUMMARIES))
    computed = tuple(name for name in wanted if name != "final_state")
    measure = checks.boolean("measure", measure)
    outline = Request(scene, options).simulation(summaries=computed).outline()
    # "nullspace" integrates both shears beside its own coordinates.
    null_space, driven = options.formulation == "nullspace", scene.fingers == "driven"
    degrees = (5 if null_space else 9) - 2 * driven
    works = (7 if scene.contact == "unilateral" else 4) + (scene.motion is not None)
    ledger = "energy" in options.record or "energy_closure" in computed
    return Explanation(
        formulation=options.formulation,
        method=options.method,
        fingers=scene.law,
        simd=_core.simd_level(),
        degrees=degrees,
        states=2 * (degrees + null_space + 2 * parts.branches(scene) + (not driven))
        + works * ledger,
        terms=tuple(_terms(scene, options, computed, ledger)),
        segments=outline["segments"],
        steps=outline["steps"],
        bytes_recorded=outline["bytes"],
        bytes_in_ensemble=_ROW + 8 * len(computed),
        seconds_per_step=_measured(scene, options) if measure else None,
    )


# Measured: omitting a zero term gains less than the compiler's own variations of generated code.
_ZERO = "zero, but computed, because leaving it out saves no measurable time"


def _terms(scene: Scene, options: Options, summaries: Sequence[str], ledger: bool) -> list[Term]:
    driven = scene.fingers == "driven"
    pids = scene.control if isinstance(scene.control, tuple) else (scene.control,)
    integrates = any(isinstance(pid, Pid) and pid.ki for pid in pids)
    tips = scene.hand.tips
    viscous = any(tip.normal_viscosity or tip.tangential_viscosity for tip in tips)
    coupled = any(tip.tilt_coupling for tip in tips)
    unilateral = scene.contact == "unilateral"
    turns, law = "(39)" if scene.law == "pid" else WRITTEN[scene.law], "PID"
    if isinstance(scene.control, SampledController):
        periods = [f"{block.period:g} s" for _, block in scene.control.blocks()]
        two = " with two sets of gains" * any(own.switch for _, own in scene.control.blocks())
        turns, law = f"a sample every {' and every '.join(periods[::-1])}", f"controllers{two}"
    driver = "the schedule drives the fingers"
    kind = "" if scene.motion is None else scene.motion._call()[0]
    carried = f"{kind}: inertial forces and gravity along the hand's axes, and their work"
    events = "tips stick, slip, graze or are free; the events between them are located"
    moved, verb = ("coordinates", "moves") if any(parts.jaws(scene)) else ("angles", "turns")
    name = options.formulation
    # Name, whether it is computed, the reason if it is, and the reason if it is not.
    before = [
        (f"finger {moved} and {law}", not driven, f"{turns} {verb} the fingers", driver),
        ("integral state", not driven, "K_I is not zero" if integrates else _ZERO, driver),
        ("viscosity", True, "(44, 45)" if viscous else _ZERO, ""),
        ("tilt coupling", True, "kappa in (5)" if coupled else _ZERO, ""),
        ("gravity", True, "(16, 43)" if scene.gravity else _ZERO, ""),
        ("motion of the hand", scene.motion is not None, carried, "the hand is at rest"),
        ("contact modes", unilateral, events, "bilateral contact: both tips always stick"),
    ]
    if found := parts.others(scene):
        shares = parts.softened(scene)
        arcs = f"; arcs soften the tips to {shares[0]:.3g} and {shares[1]:.3g} of their force"
        words = ", ".join(found) + (arcs if min(shares) < 1.0 else "")
        misfits = [tip.law.misfit for tip in tips if isinstance(tip.law, parts.MeasuredLaw)]
        words += f"; the measured forces are met within {max(misfits):.2%}" if misfits else ""
        before.insert(0, ("other parts", True, words, ""))
    works = "four works are integrated"
    if unilateral:
        works = "six works are integrated, and the losses of impacts added up"
    drifts, ends = f"{name} does not correct its states", "each step ends on the constraints"
    recorded, nothing = ", ".join(options.record), "only the times and the last state are kept"
    after = [
        ("stabilisation", name == "csm", "(19, 20)", f"{name} has no gains"),
        ("projection", name == "projected", ends, drifts),
        ("energy ledger", ledger, works, "neither recorded nor needed by a summary"),
        ("summaries", bool(summaries), ", ".join(summaries), "none requested"),
        ("recording", bool(recorded), recorded, nothing),
        ("monitors", True, "every step is checked for violations", ""),
    ]
    return [
        Term(name=part, kept=kept, reason=reason if kept else otherwise)
        for part, kept, reason, otherwise in (*before, *_inputs(scene), *after)
    ]


def _inputs(scene: Scene) -> list[tuple[str, bool, str, str]]:
    """Lists schedule and disturbances, as the parts above, by what acts within the run."""
    begin = scene.start().time
    end = begin + scene.duration
    used = np.flatnonzero(_pieces(scene.schedule.compile(), begin, end).any(axis=(0, 1)))
    degree = int(used.max(initial=0))
    forces = sines = noises = impulses = 0
    for load in scene.loads():
        forces += sum(bool(_pieces(force, begin, end).any()) for force in load.forces)
        sines += sum(bool(first < end and last > begin) for first, last, *_ in load.sines)
        noises += sum(bool(row[4] < end and row[5] > begin) for row, _, _ in load.noises)
        impulses += sum(bool(begin <= time < end) for time, *_ in load.impulses)
    moving = f"targets move along polynomials of degree {degree}"
    still = "targets are constant between switches: no polynomial"
    counts = [
        ("forces", forces, "added up into one polynomial for each component"),
        ("sines", sines, "while one acts, every evaluation computes its sine"),
        ("noise", noises, "each sample has a segment"),
        ("impulses", impulses, "each is a jump of the velocities between two steps"),
    ]
    none = "none acts within the run"
    return [
        ("schedule", degree > 0, moving, still),
        *((name, count > 0, f"{count}: {how}", none) for name, count, how in counts),
    ]


def _pieces(piecewise: Piecewise, begin: float, end: float) -> Floats:
    """Returns the coefficients of the pieces that overlap the run."""
    breaks, coefficients = piecewise
    return coefficients[np.searchsorted(breaks, begin, "right") : np.searchsorted(breaks, end) + 1]


def _measured(scene: Scene, options: Options) -> float | None:
    """Measures the time of a step, s: the shortest of several runs over the first steps."""
    duration = scene.duration if options.dt is None else min(scene.duration, _STEPS * options.dt)
    try:
        short = Request(replace(scene, duration=duration), options)
        probe = short.with_(times=None, max_steps=_STEPS).simulation()
        shortest, spent = math.inf, 0.0
        for _ in range(_REPEATS):
            begun = time.perf_counter()
            result = probe.run()
            taken = time.perf_counter() - begun
            if result["status"] == "interrupted":
                raise KeyboardInterrupt
            steps = result["stats"]["steps"] + result["stats"]["rejected"]
            if steps == 0:
                return None
            shortest, spent = min(shortest, taken / steps), spent + taken
            if spent > _PATIENCE:
                break
    except ValueError:
        # The core refuses the shortened run if its steps would vanish in round-off.
        return None
    return shortest
