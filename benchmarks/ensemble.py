"""Ensembles: RK4 steps a second, and runs a second at equal error, beside compiled peers.

make bench-ensemble
"""

import io
import warnings
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import softpinch as sp
from command import parser
from ensemble_work import Work, grasp, manipulation
from machine import clock, cores, describe
from null_space import Floats
from race import Entry, Found, cheapest
from softpinch import _core

if TYPE_CHECKING:
    from ensemble_peers import Peer

LEVELS = (1e-6, 1e-9)
# Of `--quick`: runs, probes, s. All are probes, so that peers compile once.
QUICK = (2, 2, 0.002)
DT = 1e-4
# What the steps of `DT` may be off: RK4 after 0.2 s is at 2e-9, at 0.002 s at 5e-7.
BOUND, BOUND_QUICK = 1e-8, 1e-6
OURS = [m for m in ("rk4", "dop853", "rosenbrock", "radau5") if m in _core.METHODS]


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes:
        rounds: Turns of everyone, of which the median counts.
        seconds: A participant that has computed so long is not repeated more than three times.
        every: Of the settings of a ladder one of so many is tried.
        search: Largest time of the search for one participant's setting, s.
        within: Who took more than this many times as long as the fastest of its side, ours or the
            peers, for the probes, is not timed on all runs.
        probes: Runs of each scene whose error is measured.
    """

    rounds: int
    seconds: float
    every: int
    search: float
    within: float
    probes: tuple[int, int] = (24, 8)


FULL = Effort(rounds=7, seconds=8.0, every=1, search=20.0, within=4.0)
SHORT = Effort(rounds=3, seconds=0.5, every=3, search=1.5, within=2.0, probes=(8, 4))
SHOWN = Effort(rounds=1, seconds=1.0, every=8, search=1.0, within=np.inf)


def our_run(work: Work, setting: tuple[str, str, str, float], threads: int = 1) -> Any:
    """An ensemble by (formulation, method, "dt" or "tolerance", value)."""
    formulation, method, name, value = setting
    step: dict[str, Any] = {name: value}
    return sp.monte_carlo(
        work.scene,
        runs=work.runs,
        vary=work.vary,
        method=method,
        formulation=formulation,
        summaries=("final_state",),
        threads=threads,
        progress=False,
        **step,
    )


def our_ends(ensemble: Any) -> Floats:
    """(runs, 18), NaN where a run did not get to its end."""
    completed = np.asarray(ensemble.status) == "completed"
    return np.where(completed[:, None], ensemble["final_state"], np.nan)


def _part(peer: "Peer", work: Work) -> Work:
    return work.only(range(0, work.runs, peer.share)) if peer.share > 1 else work


def _ours(formulation: str, threads: int) -> str:
    return f"ours, {formulation}, {threads} thread{'s' if threads > 1 else ''}"


def steps(effort: Effort) -> list[str]:
    """The same steps by everyone who takes steps, each checked before it is timed.

    Returns what the first line says of it.
    """
    from ensemble_peers import PEERS

    quick = effort is SHOWN
    work = grasp(*QUICK) if quick else grasp(probes=effort.probes[0])
    probes = work.only(work.probes)
    names: list[str] = []
    errors: list[float] = []
    works: list[Callable[[], object]] = []
    refused = []

    def enter(name: str, ends: Floats, run: Callable[[], object]) -> None:
        error = probes.truth.error(ends)
        if error > (BOUND_QUICK if quick else BOUND):
            refused.append(f"  {name:40s} WRONG, error {error:.0e}")
            return
        names.append(name)
        errors.append(error)
        works.append(run)

    for formulation in ("csm", "nullspace"):
        setting = (formulation, "rk4", "dt", DT)
        ends = our_ends(our_run(probes, setting))
        for threads in (1, 2):
            run = partial(our_run, work, setting, threads)
            enter(_ours(formulation, threads), ends, run)
    for name, peer in PEERS.items():
        if peer.setting == "dt" and (peer.races or effort is not SHORT):
            solve = peer.prepare(work)
            probing = solve if probes.runs == work.runs else peer.prepare(probes)
            enter(f"{name}, null space", probes.spread(probing(DT)), partial(solve, DT))
    count = work.runs * round(work.scene.duration / DT)
    print(f"{work.name}: {work.runs} runs, RK4, dt = {DT:g}, final states only")
    print(f"reference: {len(work.probes)} of them by {work.truth.method}")
    print(f"  {'':40s} {'error':>8s} {'million steps/s':>16s} {'quartiles':>15s} {'cores':>6s}")
    spent = clock(works, effort.rounds, budget=effort.seconds)
    for name, error, times, again in zip(names, errors, spent, works, strict=True):
        low, middle, high = np.quantile(count / times / 1e6, (0.25, 0.5, 0.75))
        rates = f"{middle:16.2f} {low:7.2f} {high:7.2f}"
        print(f"  {name:40s} {error:8.0e} {rates} {cores(again):6.2f}")
    print("\n".join([*refused, ""]))
    by_name = dict(zip(names, spent, strict=True))
    for formulation in ("csm", "nullspace"):
        one, two = (by_name.get(_ours(formulation, threads)) for threads in (1, 2))
        if one is not None and two is not None:
            ratio = np.median([a / b for a, b in zip(one, two, strict=False)])
            print(f"  ours, {formulation}: two threads are {ratio:.2f} times one")
    fastest = min((np.median(t) for name, t in by_name.items() if "ours" not in name), default=None)
    if fastest is None:
        return []
    ratios = [
        f"{formulation} {fastest / np.median(by_name[_ours(formulation, 1)]):.2f}"
        for formulation in ("csm", "nullspace")
        if _ours(formulation, 1) in by_name
    ]
    return [f"equal steps, ours to the best peer: {', '.join(ratios)}"]


@dataclass
class Racer:
    """A participant at equal error: searched on the probes, timed on all runs."""

    entry: Entry
    solve: Callable[[Any], object]
    runs: int
    ours: bool


def _racers(work: Work, probes: Work, effort: Effort) -> list[Racer]:
    from ensemble_peers import PEERS
    from peers import TOLERANCES

    steps = [16e-3 / 2 ** (k / 4) for k in range(0, 52, effort.every)]
    tolerances = TOLERANCES[:: effort.every]
    racers = []
    # Each on its own: on a few probes the fastest of all runs is not seen.
    for method in OURS:
        for formulation in _core.FORMULATIONS:
            for name, values in (("dt", steps), ("tolerance", tolerances)):
                if name == "dt" or method in _core.ADAPTIVE_METHODS:
                    ladder = [(formulation, method, name, value) for value in values]
                    run = partial(our_run, probes)
                    entry = Entry(f"ours, {method}", [ladder], run, our_ends)
                    racers.append(Racer(entry, partial(our_run, work), work.runs, True))
    for name, peer in PEERS.items():
        if peer.races:
            # One that is timed on a part is slow, and searched in larger strides, too.
            ladder = (steps if peer.setting == "dt" else tolerances)[:: 4 if peer.share > 1 else 1]
            starts = range(0, len(ladder) - 1, 4) if peer.orders else (0,)
            ladders = [ladder[k:] for k in starts]
            entry = Entry(name, ladders, peer.prepare(probes), probes.spread)
            part = _part(peer, work)
            racers.append(Racer(entry, peer.prepare(part), part.runs, False))
    return racers


def _setting(setting: Any) -> str:
    return (
        f"{setting[0]} {setting[2]} {setting[3]:.1e}"
        if isinstance(setting, tuple)
        else f"{setting:.1e}"
    )


def _table(
    work: Work, racers: Sequence[Racer], found: Sequence[Found], level: float, effort: Effort
) -> float:
    """Times those that got there, side by side, and prints them, the fastest first.

    Returns how many times ours is as fast as the best peer, nan without one.
    """
    there = [(r, f) for r, f in zip(racers, found, strict=True) if f.setting is not None]
    # On a few probes most of our time is the fixed cost of a call: ours are compared with ours.
    fastest = {
        ours: min((f.time for r, f in there if r.ours is ours), default=0.0)
        for ours in (True, False)
    }
    there = [(r, f) for r, f in there if f.time <= effort.within * fastest[r.ours]]
    runs = [partial(r.solve, f.setting) for r, f in there]
    spent = clock(runs, effort.rounds, budget=effort.seconds / 2)
    rated = [
        (r.runs / float(np.median(times)), r, f) for (r, f), times in zip(there, spent, strict=True)
    ]
    rated.sort(key=lambda row: -row[0])
    # Of ours each method at its best.
    first = {row[2].entry.name: row for row in reversed(rated)}
    rated = [row for row in rated if first[row[2].entry.name] is row]
    best = next((rate for rate, racer, _ in rated if racer.ours), np.nan)
    unit = work.scene.duration / DT / 1e6
    print(
        f"  error below {level:<20.0e} {'setting':>26s} {'error':>9s} {'runs/s':>10s} "
        f"{'M steps/s':>10s} {'ours to it':>11s} {'cores':>6s}"
    )
    for rate, racer, one in rated:
        busy = cores(partial(racer.solve, one.setting))
        print(
            f"  {one.entry.name:32s} {_setting(one.setting):>26s} {one.error:9.1e} {rate:10.1f} "
            f"{rate * unit:10.1f} {best / rate:11.2f} {busy:6.2f}"
        )
    for one in found:
        if one.setting is None and one.entry.name not in first:
            print(f"  {one.entry.name:32s} {one.failure}")
    peer = next((row for row in rated if not row[1].ours), None)
    if peer:
        print(f"  ours at its best: {best / peer[0]:.2f} times {peer[2].entry.name}")
    print(flush=True)
    return best / peer[0] if peer else np.nan


def error(effort: Effort) -> list[str]:
    """Runs a second, each at the loosest setting that meets the error on every probe.

    Returns what the first line says of it.
    """
    quick, ratios = effort is SHOWN, []
    in_grasp, in_manipulation = effort.probes
    scenes = (grasp(probes=in_grasp), manipulation(probes=in_manipulation))
    for work in (grasp(*QUICK),) if quick else scenes:
        probes = work.only(work.probes)
        print(f"{work.name}: {work.runs} runs; reference: {len(work.probes)} of them by ", end="")
        print(probes.truth.method, flush=True)
        racers = _racers(work, probes, effort)
        for level in LEVELS[:1] if quick else LEVELS:
            found = [cheapest(r.entry, probes.truth, level, effort.search) for r in racers]
            ratio = _table(work, racers, found, level, effort)
            ratios.append(f"{ratio:.2f} ({work.scene.duration:g} s at {level:.0e})")
    return [f"equal error, ours to the best peer: {', '.join(ratios)}"]


ABOUT = """\
All on one thread where it does not say two, float64, warm and compiled, in turns; medians. M
steps/s is what RK4 with dt = 1e-4 would need to be as fast. A setting counts if all probes are
below the error with it, and with the next tighter one. Cores is processor time by wall time:
where it is more than the threads, a library started its own; where less, the machine was busy.
"""


def main() -> None:
    parts = {"steps": steps, "error": error}
    made = parser(__doc__, list(parts))
    made.add_argument(
        "--short", action="store_true", help="fewer turns, settings, probes and peers"
    )
    given = made.parse_args()
    effort = SHOWN if given.quick else SHORT if given.short else FULL
    from ensemble_peers import COMPILERS, MISSING, compiler_version

    # Told by the table: what a step beyond stability gives is an error or a failure.
    warnings.simplefilter("ignore", sp.StabilityWarning)
    libraries = [name for name in ("numba", "heyoka", "jax") if name not in MISSING]
    print(describe(libraries=["scipy", *libraries], missing=MISSING))
    for name, path in COMPILERS.items():
        print(f"compiler   {name}: {compiler_version(path)}")
    # The tables wait for the summary, which comes first.
    with redirect_stdout(io.StringIO()) as tables:
        summary = [line for name in given.part or parts for line in parts[name](effort)]
    print("", *summary, f"\n{ABOUT}", tables.getvalue(), sep="\n")


if __name__ == "__main__":
    main()
