"""Formulations and methods: cost of a step, and the time to an error beside compiled peers.

make bench-integrators; the part `manipulation`, of some minutes, is run by name only.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softpinch as sp
from command import parser
from machine import clock, describe
from race import (
    Case,
    Entry,
    Found,
    Truth,
    bare,
    cheapest,
    our_entries,
    peer_entries,
    timed,
)
from softpinch import _core

IMPLICIT = [m for m in _core.METHODS if m not in ("rk4", "dop853")]


@dataclass(frozen=True)
class Effort:
    """The extent of a measurement.

    Attributes:
        stride: Every so many of the settings are tried.
        rounds: How often each is timed.
        search: Share of the seconds that the search for a setting may take.
        length: Share of the scenes' durations.
        levels: Errors to get below.
        hard: How many of the hard scenes.
        slow_to_compile: Whether peers that compile for tens of seconds take part: diffrax.
    """

    stride: int = 1
    rounds: int = 101
    search: float = 1.0
    length: float = 1.0
    levels: Sequence[float] = (1e-6, 1e-9)
    hard: int | None = None
    slow_to_compile: bool = True


QUICK = Effort(
    stride=8, rounds=1, search=0.01, length=0.05, levels=(1e-6,), hard=1, slow_to_compile=False
)


def _scene(**changes: Any) -> sp.Scene:
    """0.2 s from point contact to 6 degrees; `changes` by record: tip, body, control, inertia."""
    inertia = changes.get("inertia", sp.Finger().inertia)
    finger = sp.Finger(inertia=inertia)
    return sp.Scene(
        hand=sp.Hand(right=finger, left=finger, tip=sp.Fingertip(**changes.get("tip", {}))),
        grasped=sp.GraspedObject(**changes.get("body", {})),
        control=sp.Pid(**changes.get("control", {})),
        duration=0.2,
    )


_CLOSING = "0.2 s from point contact to 6 degrees: "
RUN = Case(
    _CLOSING + "c_n = c_t = 20, I_i = 2e-4, K_P, K_D, K_I = 50, 0.5, 500, E = 0.2 MPa",
    _scene(
        tip={"normal_viscosity": 20, "tangential_viscosity": 20, "youngs_modulus": 0.2e6},
        control={"kp": 50, "kd": 0.5, "ki": 500},
        inertia=2e-4,
    ),
)
STIFF = Case(
    _CLOSING + "c_n = c_t = 1e4 with M = m_n = m_t = 1 g, I and the rest as defaults",
    _scene(
        tip={"normal_viscosity": 1e4, "tangential_viscosity": 1e4},
        body={"mass": 1e-3},
    ),
)
MANIPULATION = Case("the paper's manipulation, 8 s, eight switches", sp.paper.manipulation())
HARD = (
    Case(_CLOSING + "E = 10 GPa", _scene(tip={"youngs_modulus": 10e9})),
    Case(_CLOSING + "M = m_n = m_t = 1 g", _scene(body={"mass": 1e-3})),
    Case(_CLOSING + "K_P = 1e4, K_D = 20", _scene(control={"kp": 1e4, "kd": 20.0})),
    Case(
        _CLOSING + "alpha = beta = 1e5, csm, the rest as defaults",
        _scene(),
        stabilization=sp.Stabilization(alpha=1e5, beta=1e5),
        formulations=("csm",),
    ),
)


def step_costs(effort: Effort) -> None:
    """Every pair at one fixed step, in turns, by the bare core call."""
    from evaluations import evaluation_times

    dt, pairs = 1e-4, [(f, m) for f in _core.FORMULATIONS for m in _core.METHODS]
    steps = round(RUN.scene.duration / dt)
    works = [bare(RUN, *pair, ("dt", dt)) for pair in pairs]
    spent = dict(zip(pairs, clock(works, effort.rounds), strict=True))
    unit = float(np.median(spent["nullspace", "rk4"])) / 4
    print(
        f"One step of {dt:g} s: us, and in right-hand sides of nullspace "
        f"(median of {effort.rounds} runs)"
    )
    print(" " * 20 + "".join(f"{f:>18s}" for f in _core.FORMULATIONS))
    for method in _core.METHODS:
        medians = [float(np.median(spent[f, method])) for f in _core.FORMULATIONS]
        cells = (f"{1e6 * m / steps:10.3f} {m / unit:7.1f}" for m in medians)
        print(f"  {method:18s}" + "".join(cells))
    both = zip(spent["nullspace", "rk4"], spent["csm", "rk4"], strict=False)
    ratio = np.median([n / c for n, c in both])
    print(f"  nullspace + rk4 takes {ratio:.2f} of the time of csm + rk4, round by round\n")
    print("One evaluation of the peers' right-hand sides, ns, in their own compiled code")
    for name, took in evaluation_times(RUN.scene).items():
        print(f"  {name:60s} {1e9 * took:9.0f}")
    print(f"  {'ours, nullspace (a quarter of a step of rk4)':60s} {1e9 * unit / steps:9.0f}\n")


def _row(one: Found, best: float) -> str:
    """A line of a race's table; ours have the bare core call too."""
    if one.setting is None:
        return f"  {one.entry.name:32s} {one.failure}"
    setting = one.setting
    if isinstance(setting, tuple):
        # (rtol, atol), or the name and value of ours.
        shown = " ".join(f"{v:.1e}" for v in setting if not isinstance(v, str))
    else:
        shown = f"{setting}" if isinstance(setting, int) else f"{setting:.1e}"
    core = f"{1e3 * one.core_time:10.4f}" if one.entry.core else " " * 10
    return (
        f"  {one.entry.name:32s} {shown:>17s} {one.error:9.1e} {1e3 * one.time:10.4f} "
        f"{core} {one.time / best:9.2f}"
    )


def _best(found: Sequence[Found], ours: bool) -> Found | None:
    there = [one for one in found if one.setting is not None]
    mine = [one for one in there if (one.entry.core is not None) == ours]
    return min(mine, key=lambda one: one.time, default=None)


def race(
    truth: Truth, entries: Sequence[Entry], level: float, effort: Effort, budget: float = 20.0
) -> list[Found]:
    """Searches, for `budget` s each, times and prints, the quickest first."""
    found = [cheapest(entry, truth, level, effort.search * budget) for entry in entries]
    timed(found, effort.rounds)
    best, peer = _best(found, True), _best(found, False)
    print(
        f"  error below {level:<20.0e} {'setting':>17s} {'error':>9s} {'ms':>10s} "
        f"{'core, ms':>10s} {'to ours':>9s}"
    )
    for one in sorted(found, key=lambda one: (one.setting is None, one.time)):
        print(_row(one, best.time if best else np.nan))
    if best and peer:
        ratio = peer.time / best.time
        print(f"  {best.entry.name}: {ratio:.2f} times as fast as {peer.entry.name}")
    print(flush=True)
    return found


def _shortened(case: Case, effort: Effort) -> Case:
    if effort.length == 1.0:
        return case
    duration = effort.length * case.scene.duration
    name = f"{case.name}; only {duration:g} s of it"
    return replace(case, name=name, scene=replace(case.scene, duration=duration))


def _truth(case: Case) -> Truth | None:
    print(case.name)
    try:
        truth = Truth(case)
    except RuntimeError as reason:
        print(f"  no reference: {reason}\n")
        return None
    print(f"  reference: {truth.method}, which differs by {truth.own_error:.0e}", flush=True)
    return truth


def lone_run(effort: Effort) -> None:
    _everyone(RUN, effort.levels, effort)


def manipulation(effort: Effort) -> None:
    _everyone(MANIPULATION, effort.levels[:1], effort)


def _peers(case: Case, effort: Effort, stiff_only: bool = False) -> list[Entry]:
    peers = peer_entries(case, stiff_only, effort.stride)
    return [peer for peer in peers if effort.slow_to_compile or "diffrax" not in peer.name]


def _everyone(case: Case, levels: Sequence[float], effort: Effort) -> None:
    case = _shortened(case, effort)
    truth = _truth(case)
    if truth is not None:
        ours = our_entries(case, stride=effort.stride)
        entries = [*ours, *_peers(case, effort)]
        for level in levels:
            race(truth, entries, level, effort)


def _survivor(case: Case, truth: Truth) -> Found:
    """nullspace + rk4 at about the largest dt that completes with an error below one."""
    entry = next(iter(our_entries(case, ("rk4",), ("nullspace",))))
    fails, good = 1, 0
    while good - fails > good // 100 or 0 == good < fails < 2**24:
        n = 2 * fails if good == 0 else (good + fails) // 2
        end = entry.ends(entry.solve(("dt", case.scene.duration / n)))
        if truth.error(end) < 1.0:
            good = n
        else:
            fails = n
    setting = ("dt", case.scene.duration / good)
    error = truth.error(entry.ends(entry.solve(setting)))
    return Found(replace(entry, name="nullspace rk4, largest dt"), setting, error)


def stiff(effort: Effort) -> None:
    case = _shortened(STIFF, effort)
    truth = _truth(case)
    if truth is None:
        return
    ours = our_entries(case, IMPLICIT, stride=effort.stride)
    entries = [*ours, *_peers(case, effort, stiff_only=True)]
    found = race(truth, entries, effort.levels[0], effort, 60.0)
    best, rk4 = _best(found, True), _survivor(case, truth)
    timed([rk4], min(7, effort.rounds))
    print(f"{_row(rk4, best.time if best else np.nan)}\n")


def hard(effort: Effort) -> None:
    print("Other hard scenes: which of ours wins; 5 s to search for each\n")
    for case in (_shortened(case, effort) for case in HARD[: effort.hard]):
        truth = _truth(case)
        if truth is not None:
            entries = our_entries(case, stride=effort.stride)
            race(truth, entries, effort.levels[0], effort, 5.0)


ABOUT = """\
Races: who has the end of the run (q and p, each component against its largest size along the run)
below an error, at the loosest setting such that the next tighter one is below it, too. Settings are
dt; tolerance; rtol, with atol that times each state's size; rtol and one atol for all; or steps.
Times are medians, side by side, warm and compiled: of ours by `sp.simulate(scene, every=10**9)`,
and of the core call in it; of peers without reading q and p from their state.
"""


def main() -> None:
    parts = {"steps": step_costs, "run": lone_run, "stiff": stiff, "hard": hard}
    by_name_only = {"manipulation": manipulation}
    given = parser(__doc__, [*parts, *by_name_only]).parse_args()
    from peers import LIBRARIES, MISSING

    # Told by the table: what a step beyond stability gives is an error or a failure.
    warnings.simplefilter("ignore", sp.StabilityWarning)
    if given.quick:
        MISSING["diffrax"] = "compiles for longer than a quick look lasts"
    print(describe(libraries=["scipy", *LIBRARIES], missing=MISSING))
    print(f"\n{ABOUT}")
    for name in given.part or parts:
        (parts | by_name_only)[name](QUICK if given.quick else Effort())


if __name__ == "__main__":
    main()
