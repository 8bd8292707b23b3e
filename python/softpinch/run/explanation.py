"""What a scene compiled to: states, terms kept and left out, bytes, and what a step costs.

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
from ..scene.hand import Pid
from ..scene.scene import Scene
from ..scene.schedule import Piecewise
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.result import Result
from .cost import Cost, cost
from .options import STOP_ON, Options, names
from .simulate import described

# What a run of an ensemble keeps beside its summaries: number, status, message, end, steps, the
# final state and the first times of violations, each in eight bytes.
_ROW = 8 * (5 + 18 + len(_core.VIOLATIONS))
# Steps that are timed, how often, and for how long at most, s.
_STEPS, _REPEATS, _PATIENCE = 2000, 5, 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Term(Result):
    """Something that a scene may or may not have.

    Attributes:
        name: What it is.
        kept: Whether it is computed.
        reason: Why, or why not.
    """

    name: str
    kept: bool
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation(Result):
    """What a scene compiled to. `print` it.

    Attributes:
        formulation: How the constraints are kept.
        method: How time is stepped.
        fingers: "pid" or "driven".
        simd: The instructions that the core uses.
        degrees: Velocities that the equations are solved for.
        states: Numbers that a step advances, the ledger's works among them.
        terms: What is kept and what is left out.
        segments: Stretches between the instants at which an input jumps or kinks.
        steps: Of a run; None where the error chooses them.
        operations: Name -> how many one evaluation of the equations has, with the inputs that hold
            at the start (constants folded, common terms once), multipliers and residuals included.
            Counted with angles below 45 degrees: the sine and cosine of a larger one take 22
            floating-point operations more. Polynomials that happen to be equal count one by one.
        flops_per_evaluation: Floating-point operations of these, a fused multiply-add as two.
        flops_per_step: Of a step with its monitors; None for methods that solve equations.
        latency_per_step: Cycles of a step's longest chain of operations, each waiting for the one
            before, on a current x86 core; None as above.
        bytes_recorded: Of the arrays of a run; None where the number of rows is not known.
        bytes_in_ensemble: Of a run's row in an `Ensemble`, beside what it varies.
        seconds_per_step: Measured here, a run alone; None where it was not.
    """

    formulation: str
    method: str
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
        """The names of those that are not."""
        return tuple(term.name for term in self.terms if not term.kept)

    def __str__(self) -> str:
        """As a short report."""
        steps = (
            "as many steps as the error asks for" if self.steps is None else f"{self.steps} steps"
        )
        stretches = "stretch" if self.segments == 1 else "stretches"
        lines = [
            f"{self.formulation}, {self.method}, {self.fingers} fingers, {self.simd}: "
            f"{self.degrees} velocities, {self.states} states",
            f"{steps} in {self.segments} {stretches}",
        ]
        width = max(len(term.name) for term in self.terms)
        for title, kept in (("computed", True), ("left out", False)):
            lines.append(f"{title}:")
            lines += [
                f"  {term.name:{width}}  {term.reason}" for term in self.terms if term.kept == kept
            ]
        lines.append(
            f"an evaluation at the start: {self.flops_per_evaluation} floating-point operations"
        )
        if self.flops_per_step is not None:
            lines.append(
                f"a step there: {self.flops_per_step} floating-point operations, the longest chain "
                f"{self.latency_per_step} cycles"
            )
        if self.seconds_per_step is not None:
            lines.append(f"a step, measured here: {1e9 * self.seconds_per_step:.0f} ns")
        if self.bytes_recorded is not None:
            lines.append(f"recorded: {self.bytes_recorded} bytes")
        lines.append(f"in an ensemble: {self.bytes_in_ensemble} bytes a run")
        return "\n".join(lines)


def explain(
    scene: Scene,
    dt: float | None = None,
    method: str = "rk4",
    formulation: str = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: str | Sequence[str] = ("state",),
    every: int = 1,
    stop_on: str | Sequence[str] = STOP_ON,
    *,
    tolerance: float | None = None,
    times: ArrayLike | None = None,
    max_steps: int | None = None,
    summaries: str | Sequence[str] = (),
    measure: bool = True,
) -> Explanation:
    """Says what a scene compiles to, with the arguments of `simulate` or of `monte_carlo`.

    Args:
        scene: What would be simulated.
        dt: As of `simulate`, as all up to `max_steps`.
        method: As of `simulate`.
        formulation: As of `simulate`.
        stabilization: As of `simulate`.
        record: As of `simulate`.
        every: As of `simulate`.
        stop_on: As of `simulate`.
        tolerance: As of `simulate`.
        times: As of `simulate`.
        max_steps: As of `simulate`.
        summaries: As of `monte_carlo`.
        measure: Whether some steps from the scene's start on are timed, for half a second at most.

    Raises:
        ValueError: As `simulate`.
        TypeError: As `simulate`.
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
    return Explanation(
        formulation=options.formulation,
        method=options.method,
        fingers=scene.fingers,
        simd=_core.simd_level(),
        degrees=counted.degrees,
        states=counted.states,
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
    """What the equations take with the inputs that hold at the start."""
    begin = scene.start().time
    compiled = [push.compile() for push in scene.disturbances]
    polynomials = [scene.schedule.compile(), *(force for one in compiled for force in one.forces)]
    at_once = math.nextafter(begin, math.inf)
    return cost(
        options.formulation,
        options.method,
        scene.fingers,
        ledger=_ledger(options, summaries),
        degree=max(_degree(polynomial, begin, at_once) for polynomial in polynomials),
        sines=sum(bool(first <= begin < last) for one in compiled for first, last, *_ in one.sines),
        friction=scene.friction is not None and math.isfinite(scene.friction),
    )


# What a term that is zero costs was measured: it is within what compilers move by themselves.
_ALL_THE_SAME = "zero, and computed all the same: leaving it out saves nothing measurable"


def _terms(scene: Scene, options: Options, summaries: Sequence[str]) -> list[Term]:
    """What there is, in the order in which a reader would ask."""
    driven = scene.fingers == "driven"
    pids = (scene.control,) if isinstance(scene.control, Pid) else scene.control
    tips = scene.hand.tip if isinstance(scene.hand.tip, tuple) else (scene.hand.tip,)
    viscous = any(tip.normal_viscosity or tip.tangential_viscosity for tip in tips)
    coupled = any(tip.tilt_coupling for tip in tips)

    def present(name: str, there: bool, reason: str) -> Term:
        return Term(name=name, kept=True, reason=reason if there else _ALL_THE_SAME)

    def optional(name: str, there: bool, reason: str, otherwise: str) -> Term:
        return Term(name=name, kept=there, reason=reason if there else otherwise)

    elsewhere = "the schedule has the fingers"
    terms = [optional("finger angles and PID", not driven, "(39) turns the fingers", elsewhere)]
    if driven:
        terms.append(Term(name="integral state", kept=False, reason=elsewhere))
    else:
        terms.append(present("integral state", any(pid.ki for pid in pids), "K_I is not zero"))
    terms += [
        present("viscosity", viscous, "(44, 45)"),
        present("tilt coupling", coupled, "kappa in (5)"),
        present("gravity", scene.gravity != 0.0, "(16, 43)"),
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
            "four works are integrated",
            "nobody asked for it",
        ),
        optional("summaries", bool(summaries), ", ".join(summaries), "nobody asked for any"),
        optional(
            "recording",
            bool(options.record),
            ", ".join(options.record),
            "only the times and the last state are kept",
        ),
        Term(name="monitors", kept=True, reason="every step, with what stops the run"),
    ]
    return terms


def _inputs(scene: Scene) -> list[Term]:
    """Schedule and disturbances, as far as they act within the run."""
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
        "sines": "a sine in every evaluation while one acts",
        "noise": "a stretch for each sample",
        "impulses": "a jump of the velocities each, between two steps",
    }
    moving = f"moves, a polynomial of degree {degree} while it does"
    return [
        Term(
            name="schedule",
            kept=degree > 0,
            reason=moving if degree else "constant between its steps: no polynomial",
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
    """The coefficients of the pieces that a run meets."""
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
    """How long a step of the run takes, s: the shortest of some runs over its first steps."""
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
        # A run so much shorter is refused where its steps would be lost in round-off.
        return None
    return shortest
