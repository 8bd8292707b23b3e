"""`explain`: the size of a scene's equations, the computed terms, memory, and the cost of a step.

docs/what-a-scene-pays.md has the measurements behind the choices.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..scene.control import WRITTEN, Pid
from ..scene.piecewise import Piecewise
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.choices import Formulation, Method, Recordable, Violation
from ..support.result import Result
from .cost import Cost, cost
from .options import STOP_ON, Options, names
from .simulate import described

# Bytes of a run in an ensemble without its summaries: number, status, message, end time, steps, the
# final state and the first time of each violation, with eight bytes each.
_ROW = 8 * (5 + 18 + len(_core.VIOLATIONS))
# Friction, impacts and relaxation, which unilateral contact adds to the energy ledger.
_CONTACT_WORKS = 3
# A timing measures this many steps, this many times, and stops after this many seconds.
_STEPS, _REPEATS, _PATIENCE = 2000, 5, 0.5


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Term(Result):
    """An optional part of the computation.

    Attributes:
        name: The name of the part.
        kept: Whether it is computed.
        reason: The reason why it is computed or not.
    """

    name: str
    kept: bool
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Explanation(Result):
    """The size and the cost of the computation that a scene compiles to. `print` shows a report.

    Attributes:
        formulation: How the constraints are enforced.
        method: The integration method.
        fingers: "pid", "torque" or "driven".
        simd: The processor instructions that the core uses.
        degrees: Number of velocities that the equations are solved for.
        states: Number of values that a step advances, including the works of the energy ledger. In
            unilateral contact friction, impacts and relaxation join the four of bilateral contact.
        terms: The optional parts, computed or left out.
        segments: Number of intervals between the instants at which an input jumps or kinks.
        steps: Number of steps of a run; None if the error control chooses them.
        operations: Kind of operation -> its number in one evaluation of the equations, including
            multipliers and residuals, with the inputs that hold at the start. Constants are folded
            and common terms are counted once, but equal polynomials are counted separately. Angles
            are taken below 45 degrees; the sine and cosine of a larger angle need 22 more
            floating-point operations. In unilateral contact these are the operations of the
            bilateral equations, and so are `flops_per_evaluation`, `flops_per_step` and
            `latency_per_step`: a solve without symmetry for the multipliers, the choice of modes,
            events and the steps that are repeated to locate them are not counted.
            `seconds_per_step` includes them all.
        flops_per_evaluation: Floating-point operations of one evaluation; a fused multiply-add
            counts as two.
        flops_per_step: Floating-point operations of a step, including its monitors; None for
            methods that solve equations.
        latency_per_step: Cycles of a step's longest chain of dependent operations on a current x86
            core; None for methods that solve equations.
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
    operations: Mapping[str, int]
    flops_per_evaluation: int
    flops_per_step: int | None
    latency_per_step: int | None
    bytes_recorded: int | None
    bytes_in_ensemble: int
    seconds_per_step: float | None

    @property
    def kept(self) -> tuple[str, ...]:
        """The names of the terms that are computed."""
        return tuple(term.name for term in self.terms if term.kept)

    @property
    def left_out(self) -> tuple[str, ...]:
        """The names of the terms that are not computed."""
        return tuple(term.name for term in self.terms if not term.kept)

    def __str__(self) -> str:
        """Returns a short report."""
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
            lines += [
                f"  {term.name:{width}}  {term.reason}" for term in self.terms if term.kept == kept
            ]
        counted = ", without those of modes and events" if "contact modes" in self.kept else ""
        lines.append(
            f"an evaluation at the start: {self.flops_per_evaluation} floating-point operations"
            f"{counted}"
        )
        if self.flops_per_step is not None:
            lines.append(
                f"a step there: {self.flops_per_step} floating-point operations, the longest chain "
                f"of dependent operations {self.latency_per_step} cycles"
            )
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

    Args:
        scene: The scene.
        dt: As in `simulate`.
        method: As in `simulate`.
        formulation: As in `simulate`.
        stabilization: As in `simulate`.
        record: As in `simulate`.
        every: As in `simulate`.
        stop_on: As in `simulate`.
        tolerance: As in `simulate`.
        times: As in `simulate`.
        max_steps: As in `simulate`.
        summaries: As in `monte_carlo`.
        measure: Whether to time some steps from the scene's start, for about half a second at most.

    Raises:
        ValueError: As in `simulate`.
        TypeError: As in `simulate`.
    """
    checks.instance("scene", scene, Scene)
    options = Options.checked(
        dt=dt,
        method=method,
        formulation=formulation,
        stabilization=stabilization,
        record=record,
        every=every,
        stop_on=stop_on,
        tolerance=tolerance,
        times=times,
        max_steps=max_steps,
    )
    wanted = names("summaries", summaries, ("final_state", *_core.SUMMARIES))
    computed = tuple(name for name in wanted if name != "final_state")
    measure = checks.boolean("measure", measure)
    outline = described(scene, options, summaries=computed).outline()
    counted = _counted(scene, options, computed)
    flops, latency = counted.step or (None, None)
    unilateral, ledger = scene.contact == "unilateral", _ledger(options, computed)
    return Explanation(
        formulation=options.formulation,
        method=options.method,
        fingers=scene.law,
        simd=_core.simd_level(),
        degrees=counted.degrees,
        states=counted.states + (_CONTACT_WORKS if unilateral and ledger else 0),
        terms=tuple(_terms(scene, options, computed)),
        segments=outline["segments"],
        steps=outline["steps"],
        operations=counted.operations,
        flops_per_evaluation=counted.flops,
        flops_per_step=flops,
        latency_per_step=latency,
        bytes_recorded=outline["bytes"],
        bytes_in_ensemble=_ROW + 8 * len(computed),
        seconds_per_step=_measured(scene, options) if measure else None,
    )


def _ledger(options: Options, summaries: Sequence[str]) -> bool:
    return "energy" in options.record or "energy_closure" in summaries


def _counted(scene: Scene, options: Options, summaries: Sequence[str]) -> Cost:
    """Looks up the cost of the equations with the inputs that hold at the start."""
    begin = scene.start().time
    compiled = [push.compile() for push in scene.disturbances]
    polynomials = [scene.schedule.compile(), *(force for one in compiled for force in one.forces)]
    at_once = math.nextafter(begin, math.inf)
    return cost(
        options.formulation,
        options.method,
        "torque" if scene.law == "sampled" else scene.law,
        ledger=_ledger(options, summaries),
        degree=max(_degree(polynomial, begin, at_once) for polynomial in polynomials),
        sines=sum(bool(first <= begin < last) for one in compiled for first, last, *_ in one.sines),
        friction=bool(np.isfinite(scene.parameters()[-2:]).any()),
    )


# Measured: omitting a zero term gains less than the compiler's own variations of generated code.
_ZERO_BUT_COMPUTED = "zero, but computed, because leaving it out saves no measurable time"


def _terms(scene: Scene, options: Options, summaries: Sequence[str]) -> list[Term]:
    """Lists the optional parts of the computation, the physics first."""
    driven = scene.fingers == "driven"
    control = scene.control
    tips = scene.hand.tips
    viscous = any(tip.normal_viscosity or tip.tangential_viscosity for tip in tips)
    coupled = any(tip.tilt_coupling for tip in tips)

    def present(name: str, there: bool, reason: str) -> Term:
        return Term(name=name, kept=True, reason=reason if there else _ZERO_BUT_COMPUTED)

    def optional(name: str, there: bool, reason: str, otherwise: str) -> Term:
        return Term(name=name, kept=there, reason=reason if there else otherwise)

    elsewhere = "the schedule drives the fingers"
    pids = control if isinstance(control, tuple) else (control,)
    integrates = any(isinstance(pid, Pid) and pid.ki for pid in pids)
    turns = "(39)" if scene.law == "pid" else WRITTEN[scene.law]
    terms = [optional("finger angles and PID", not driven, f"{turns} turns the fingers", elsewhere)]
    if driven:
        terms.append(Term(name="integral state", kept=False, reason=elsewhere))
    else:
        terms.append(present("integral state", integrates, "K_I is not zero"))
    terms += [
        present("viscosity", viscous, "(44, 45)"),
        present("tilt coupling", coupled, "kappa in (5)"),
        present("gravity", scene.gravity != 0.0, "(16, 43)"),
        optional(
            "contact modes",
            scene.contact == "unilateral",
            "tips stick, slip, graze or are free; the events between them are located",
            "bilateral contact: both tips always stick",
        ),
        *_inputs(scene),
        optional(
            "stabilisation",
            options.formulation == "csm",
            "(19, 20)",
            f"{options.formulation} has no gains",
        ),
        optional(
            "projection",
            options.formulation == "projected",
            "each step ends on the constraints",
            f"{options.formulation} does not correct its states",
        ),
    ]
    terms += [
        optional(
            "energy ledger",
            _ledger(options, summaries),
            "four works are integrated"
            if scene.contact == "bilateral"
            else "six works are integrated, and the losses of impacts added up",
            "neither recorded nor needed by a summary",
        ),
        optional("summaries", bool(summaries), ", ".join(summaries), "none requested"),
        optional(
            "recording",
            bool(options.record),
            ", ".join(options.record),
            "only the times and the last state are kept",
        ),
        Term(name="monitors", kept=True, reason="every step is checked for violations"),
    ]
    return terms


def _inputs(scene: Scene) -> list[Term]:
    """Lists schedule and disturbances, and whether they act within the run."""
    begin = scene.start().time
    end = begin + scene.duration
    degree = _degree(scene.schedule.compile(), begin, end)
    compiled = [push.compile() for push in scene.disturbances]
    counts = {
        "forces": sum(_acts(force, begin, end) for one in compiled for force in one.forces),
        "sines": sum(
            bool(first < end and last > begin) for one in compiled for first, last, *_ in one.sines
        ),
        "noise": sum(
            bool(row[4] < end and row[5] > begin) for one in compiled for row, _, _ in one.noises
        ),
        "impulses": sum(bool(begin <= time < end) for one in compiled for time, *_ in one.impulses),
    }
    how = {
        "forces": "added up into one polynomial for each component",
        "sines": "while one acts, every evaluation computes its sine",
        "noise": "each sample has a segment",
        "impulses": "each is a jump of the velocities between two steps",
    }
    moving = f"targets move along polynomials of degree {degree}"
    return [
        Term(
            name="schedule",
            kept=degree > 0,
            reason=moving if degree else "targets are constant between switches: no polynomial",
        ),
        *(
            Term(
                name=name,
                kept=count > 0,
                reason=f"{count}: {how[name]}" if count else "none acts within the run",
            )
            for name, count in counts.items()
        ),
    ]


def _pieces(piecewise: Piecewise, begin: float, end: float) -> Floats:
    """Returns the coefficients of the pieces that overlap the run."""
    breaks, coefficients = piecewise
    first = int(np.searchsorted(breaks, begin, side="right"))
    last = int(np.searchsorted(breaks, end, side="left"))
    return coefficients[first : last + 1]


def _acts(force: Piecewise, begin: float, end: float) -> bool:
    return bool(np.any(_pieces(force, begin, end)))


def _degree(piecewise: Piecewise, begin: float, end: float) -> int:
    used = np.flatnonzero(np.any(_pieces(piecewise, begin, end) != 0.0, axis=(0, 1)))
    return int(used[-1]) if used.size else 0


def _measured(scene: Scene, options: Options) -> float | None:
    """Measures the time of a step, s: the shortest of several runs over the first steps."""
    duration = scene.duration
    if options.dt is not None:
        duration = min(duration, _STEPS * options.dt)
    try:
        probe = described(
            replace(scene, duration=duration), replace(options, times=None, max_steps=_STEPS)
        )
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
