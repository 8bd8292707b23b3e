"""A race of solvers to an error: the search for each solver's setting, and the times."""

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import null_space
import softpinch as sp
from machine import clock, median_time
from null_space import Floats
from softpinch import _core, reference
from softpinch.run.options import Options
from softpinch.run.request import Request

if TYPE_CHECKING:
    from peers import Peer

_LAST_ONLY = 10**9


@dataclass(frozen=True)
class Case:
    """A scene to race on."""

    name: str
    scene: sp.Scene
    stabilization: sp.Stabilization = field(default_factory=sp.Stabilization)
    formulations: Sequence[str] = _core.FORMULATIONS


class Truth:
    """The end of a case's run by softpinch.reference, and what is known of its error.

    Raises:
        RuntimeError: The motion runs away.
    """

    def __init__(self, case: Case) -> None:
        run = reference.confirmed(case.scene, [case.scene.start().time + case.scene.duration])
        assert run.own_error is not None
        self.method = run.method
        self.own_error = max(run.own_error["q"], run.own_error["p"])
        self.parts = [(getattr(run, name)[-1], run.scales[name]) for name in ("q", "p")]

    def error(self, end: tuple[Floats, Floats]) -> float:
        """Error of q and p at the end, each component against its largest size along the run.

        The largest of all; inf where something is not finite.
        """
        parts = zip(end, self.parts, strict=True)
        worst = max(float((np.abs(a - b) / scale).max()) for a, (b, scale) in parts)
        return worst if math.isfinite(worst) else math.inf


@dataclass(frozen=True)
class Entry:
    """One who takes part: `solve(setting)` is timed, `ends` reads (q, p) from what it returns."""

    name: str
    ladders: Sequence[Sequence[Any]]
    solve: Callable[[Any], Any]
    ends: Callable[[Any], tuple[Floats, Floats]]
    # The bare core call of a setting, for ours.
    core: Callable[[Any], Callable[[], object]] | None = None


@dataclass
class Found:
    """An entry's cheapest setting below a level, or why there is none."""

    entry: Entry
    setting: Any = None
    error: float = math.inf
    failure: str = ""
    time: float = math.nan
    core_time: float = math.nan


def peer_entries(case: Case, stiff_only: bool = False, stride: int = 1) -> list[Entry]:
    from peers import PEERS

    c = null_space.parameters(case.scene)
    chosen = {n: p for n, p in PEERS.items() if p.for_stiff or not stiff_only}
    return [
        Entry(
            name,
            [ladder[::stride] for ladder in peer.ladders],
            peer.prepare(case.scene),
            partial(_read, peer, c),
        )
        for name, peer in chosen.items()
    ]


def _read(peer: "Peer", c: Floats, state: Any) -> tuple[Floats, Floats]:
    return peer.ends(state, c)


def our_entries(
    case: Case,
    methods: Sequence[str] = _core.METHODS,
    formulations: Sequence[str] | None = None,
    stride: int = 1,
) -> list[Entry]:
    """Each pair with a fixed step and, where the method can, with a tolerance.

    `stride` tries every so many of the settings.
    """
    steps = [("dt", case.scene.duration / int(20 * 2 ** (k / 4))) for k in range(68)]
    tolerances = [("tolerance", 10.0 ** (-k / 4)) for k in range(4, 57)]
    entries = []
    for formulation in formulations or case.formulations:
        for method in methods:
            run = partial(our_run, case, formulation, method)
            for ladder in (steps, tolerances):
                if ladder is tolerances and method not in _core.ADAPTIVE_METHODS:
                    continue
                name = f"{formulation} {method}, {ladder[0][0]}"
                core = partial(bare, case, formulation, method)
                entries.append(Entry(name, [ladder[::stride]], run, _completed, core))
    return entries


def _options(case: Case, setting: tuple[str, float]) -> dict[str, Any]:
    return {
        "stabilization": case.stabilization,
        "every": _LAST_ONLY,
        "stop_on": (),
        setting[0]: setting[1],
    }


def our_run(case: Case, formulation: str, method: str, setting: tuple[str, float]) -> sp.Run:
    pair = {"method": method, "formulation": formulation}
    return sp.simulate(case.scene, **pair, **_options(case, setting))


def bare(
    case: Case, formulation: str, method: str, setting: tuple[str, float]
) -> Callable[[], object]:
    """The core's part of `our_run`: its arguments are checked and handed over before."""
    pair = {"method": method, "formulation": formulation}
    given = {"record": ("state",), **pair, **_options(case, setting)}
    return Request(case.scene, Options.checked(**given)).simulation().run


def _completed(run: sp.Run) -> tuple[Floats, Floats]:
    nothing = np.full(9, np.nan)
    return (run.q[-1], run.p[-1]) if run.status == "completed" else (nothing, nothing)


def cheapest(entry: Entry, truth: Truth, level: float, budget: float = 20.0) -> Found:
    """The loosest setting of each ladder below the level, and of these the fastest.

    One counts only if the next tighter one is below the level too: else it met it by chance.
    """
    best, reached = Found(entry), math.inf
    # What compiles at its first call does so before the budget runs.
    with contextlib.suppress(TypeError, ValueError, ArithmeticError):
        entry.solve(entry.ladders[0][0])
    begin = time.perf_counter()
    for ladder in entry.ladders:
        before: tuple[Any, float] | None = None
        for setting in ladder:
            if time.perf_counter() - begin > budget:
                best.failure = f"over the budget of {budget:g} s, best error {reached:.0e}"
                break
            try:
                error = truth.error(entry.ends(entry.solve(setting)))
            except (TypeError, ValueError, ArithmeticError) as reason:
                best.failure = f"{type(reason).__name__}: {reason}"[:60]
                break
            reached = min(reached, error)
            if before is not None and error <= level:
                _keep_faster(best, *before)
                break
            before = (setting, error) if error <= level else None
    if best.setting is None and not best.failure:
        best.failure = "WRONG" if reached > 1e-3 else "does not get there"
        best.failure += f", best error {reached:.0e}"
    return best


def _keep_faster(best: Found, setting: Any, error: float) -> None:
    spent = median_time(partial(best.entry.solve, setting), 5)
    if best.setting is None or spent < best.time:
        best.setting, best.error, best.time = setting, error, spent


def timed(found: Sequence[Found], rounds: int = 101) -> None:
    """Fills in the times of those that have a setting, all side by side."""
    there = [one for one in found if one.setting is not None]
    works: list[Callable[[], object]] = [partial(one.entry.solve, one.setting) for one in there]
    ours = [one for one in there if one.entry.core is not None]
    works += [one.entry.core(one.setting) for one in ours if one.entry.core is not None]
    medians = [float(np.median(times)) for times in clock(works, rounds)]
    for one, median in zip(there, medians, strict=False):
        one.time = median
    for one, median in zip(ours, medians[len(there) :], strict=True):
        one.core_time = median
