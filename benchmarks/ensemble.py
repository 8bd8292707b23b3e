"""Ensembles: RK4 steps a second, and runs a second at equal error, beside compiled peers.

make bench-ensemble
"""

import argparse
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np

import softpinch as sp
from ensemble_peers import COMPILER, MISSING, PEERS, TAYLOR, Peer
from ensemble_work import Work, grasp, manipulation
from machine import clock, describe
from null_space import Floats
from peers import TOLERANCES
from race import Entry, Found, cheapest
from softpinch import _core

THERE = hasattr(sp, "monte_carlo")
LEVELS = (1e-6, 1e-9)
DT = 1e-4
# What the steps of `DT` may be off: RK4 in 0.2 s is at 2e-9.
BOUND = 1e-8
OURS = [m for m in ("rk4", "dop853", "rosenbrock", "radau5") if m in _core.METHODS]
LIBRARIES = [name for name in ("numba", "heyoka", "jax") if name not in MISSING]


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


def _part(peer: Peer, work: Work) -> Work:
    return work.only(range(0, work.runs, peer.share)) if peer.share > 1 else work


def steps(quick: bool) -> None:
    """The same steps by everyone who takes steps, each checked before it is timed."""
    work = grasp(256, 8) if quick else grasp()
    probes = work.only(work.probes)
    names: list[str] = []
    works: list[Callable[[], object]] = []
    refused = []

    def enter(name: str, ends: Floats, run: Callable[[], object]) -> None:
        error = probes.truth.error(ends)
        if error > BOUND:
            refused.append(f"  {name:40s} WRONG, error {error:.0e}")
            return
        names.append(f"{name:40s} {error:8.0e}")
        works.append(run)

    for formulation in ("csm", "nullspace") if THERE else ():
        setting = (formulation, "rk4", "dt", DT)
        ends = our_ends(our_run(probes, setting))
        for threads in (1, 2):
            name = f"ours, {formulation}, {threads} thread{'s' if threads > 1 else ''}"
            enter(name, ends, partial(our_run, work, setting, threads))
    for name, peer in PEERS.items():
        if peer.setting == "dt":
            ends = probes.spread(peer.prepare(probes)(DT))
            enter(f"{name}, null space", ends, partial(peer.prepare(work), DT))
    count = work.runs * round(work.scene.duration / DT)
    print(f"{work.name}: {work.runs} runs, RK4, dt = {DT:g}, final states only")
    print(f"reference: {len(work.probes)} of them by {work.truth.method}")
    print(f"  {'':40s} {'error':>8s} {'million steps/s':>16s} {'quartiles':>15s}")
    spent = clock(works, 3 if quick else 11, budget=20.0)
    for name, times in zip(names, spent, strict=True):
        low, middle, high = np.quantile(count / times / 1e6, (0.25, 0.5, 0.75))
        print(f"  {name} {middle:16.2f} {low:7.2f} {high:7.2f}")
    print("\n".join([*refused, ""]))
    for k in (0, 2) if THERE else ():
        ratio = np.median([a / b for a, b in zip(spent[k], spent[k + 1], strict=False)])
        print(f"  {names[k].split(', 1')[0].strip()}: two threads are {ratio:.2f} times one")


@dataclass
class Racer:
    """Who takes part at equal error: searched on the probes, timed on all runs."""

    entry: Entry
    solve: Callable[[Any], object]
    runs: int
    ours: bool


def _racers(work: Work, probes: Work, quick: bool) -> list[Racer]:
    every = 2 if quick else 1
    steps = [16e-3 / 2 ** (k / 4) for k in range(0, 52, every)]
    tolerances = TOLERANCES[::every]
    racers = []
    # Each on its own: on a few probes the fastest of all runs is not seen.
    for method in OURS if THERE else ():
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
            # Taylor's order goes with the tolerance: a tighter one than needed may be faster.
            starts = range(0, len(ladder) - 1, 4) if name == TAYLOR else (0,)
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


def _table(work: Work, racers: Sequence[Racer], found: Sequence[Found], level: float) -> None:
    """Times those that got there, side by side, and prints them, the fastest first."""
    there = [(r, f) for r, f in zip(racers, found, strict=True) if f.setting is not None]
    spent = clock([partial(r.solve, f.setting) for r, f in there], 11, budget=10.0)
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
        f"{'M steps/s':>10s} {'ours to it':>11s}"
    )
    for rate, _, one in rated:
        print(
            f"  {one.entry.name:32s} {_setting(one.setting):>26s} {one.error:9.1e} {rate:10.1f} "
            f"{rate * unit:10.1f} {best / rate:11.2f}"
        )
    for one in found:
        if one.setting is None and one.entry.name not in first:
            print(f"  {one.entry.name:32s} {one.failure}")
    peer = next((row for row in rated if not row[1].ours), None)
    if THERE and peer:
        print(f"  ours at its best: {best / peer[0]:.2f} times {peer[2].entry.name}")
    print(flush=True)


def error(quick: bool) -> None:
    """Runs a second, each at the loosest setting that meets the error on every probe."""
    works = (grasp(256, 8), manipulation(16, 2)) if quick else (grasp(), manipulation())
    for work in works:
        probes = work.only(work.probes)
        print(f"{work.name}: {work.runs} runs; reference: {len(work.probes)} of them by ", end="")
        print(probes.truth.method, flush=True)
        racers = _racers(work, probes, quick)
        for level in LEVELS:
            found = [cheapest(r.entry, probes.truth, level, 120.0) for r in racers]
            _table(work, racers, found, level)


ABOUT = """\
All on one thread where it does not say two, float64, warm and compiled, in turns; medians. M
steps/s is what RK4 with dt = 1e-4 would need to be as fast. A setting counts if all probes are
below the error with it, and with the next tighter one. Leave the other cores alone: heyoka's
peers were seen to lose half their speed to a busy neighbour where the others lost little.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parts = {"steps": steps, "error": error}
    parser.add_argument("part", nargs="*", choices=[*parts, []], help="all, if none is said")
    parser.add_argument("--quick", action="store_true", help="fewer runs and settings")
    given = parser.parse_args()
    # Told by the table: what a step beyond stability gives is an error or a failure.
    warnings.simplefilter("ignore", sp.StabilityWarning)
    print(describe())
    for name in ("scipy", *LIBRARIES):
        print(f"           {name} {version(name)}")
    if COMPILER is not None:
        print(f"           {COMPILER}")
    for name, reason in MISSING.items():
        print(f"left out   {name}: {reason}")
    if not THERE:
        print("left out   ours: this softpinch has no monte_carlo")
    print(f"\n{ABOUT}")
    for name in given.part or parts:
        parts[name](given.quick)


if __name__ == "__main__":
    main()
