"""The paper's operations and disturbances with tips that only push, and may slip.

The paper's contact is bilateral: its tips pull where they have to, and never slip. The runs here
have unilateral contact and faces of finite height. All words follow from the runs.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..run import measures as m
from ..run.contact import ContactMode
from ..run.run import Run
from .experiment import Runs
from .finding import BANDS, Finding, observation


def spells(run: Run, mode: ContactMode, begin: float, end: float) -> list[float]:
    """The durations, s, of a mode of either tip, each cut to [begin, end], in the order of time."""
    found = [
        (max(first, begin), min(last, end))
        for side in (0, 1)
        for first, last, which in m.contact_spans(run, side)
        if which is mode
    ]
    return [last - first for first, last in sorted(found) if last > first]


def survived(run: Run) -> list[bool]:
    """True for each operation at whose end both tips touch the object and it is at rest."""
    rests = [bool((ranges <= BANDS).all()) for ranges in m.drift(run)]
    opened = run.violation_intervals.get("opened", np.empty((0, 2)))
    # An opening at a switch belongs to the operation that begins.
    free = [((opened[:, 0] < end) & (opened[:, 1] >= end)).any() for _, end in m.operations(run)]
    return [bool(calm and not opens) for calm, opens in zip(rests, free, strict=True)]


def case_survived(run: Run) -> bool:
    """True if a disturbed grasp holds, and its object comes to rest."""
    return run.holds and bool((m.drift_since(run) <= BANDS).all())


def which_survive(real: Mapping[float, Run], cases: Mapping[str, Mapping[float, Run]]) -> Finding:
    """The operations and disturbances that hold with each friction."""
    kept = {mu: survived(run) for mu, run in real.items()}
    count = len(next(iter(kept.values())))
    rows = {f"operation {k + 1}": {mu: kept[mu][k] for mu in kept} for k in range(count)}
    rows |= {
        f"({case})": {mu: case_survived(run) for mu, run in runs.items()}
        for case, runs in cases.items()
    }
    # Frictions in words -> the operations and disturbances that hold with them.
    named: dict[str, list[str]] = {}
    for name, row in rows.items():
        every = ", ".join(f"{mu:g}" for mu in row)
        yes = ", ".join(f"{mu:g}" for mu, kept in row.items() if kept)
        how = f"with mu = {yes} only, of {every}" if yes else f"with no mu of {every}"
        of_some = named.setdefault(f"with every mu of {every}" if yes == every else how, [])
        # The word stands once before the numbers of several operations.
        of_some.append(name.removeprefix("operation ") if of_some else name)
    return observation(
        "which of the paper's operations and disturbances a real hand would survive: its tips "
        "push and never pull, and stick only as far as friction allows",
        f"operations and disturbances, of {len(rows)}, that are survived with every mu tried",
        float(sum(all(row.values()) for row in rows.values())),
        "; ".join(f"survived {how}: {', '.join(names)}" for how, names in named.items()),
    )


def operations(paper: Run, real: Mapping[float, Run]) -> Finding:
    """The openings of tips in the eight operations, and where the object ends."""
    opened: dict[int, list[float]] = {}
    for run in real.values():
        for k, piece in enumerate(m.operations(run)):
            if times := spells(run, ContactMode.FREE, *piece):
                opened.setdefault(k + 1, []).extend(times)
    every = [time for times in opened.values() for time in times]
    openings = "no tip opens"
    if every:
        numbers = ", ".join(map(str, sorted(opened)))
        openings = (
            f"tips open for {1e3 * min(every):.2g} to {1e3 * max(every):.2g} ms in operations "
            f"{numbers}"
        )
    lower = {
        mu: 1e3 * float(m.settled(paper)[-1, 1] - m.settled(run)[-1, 1]) for mu, run in real.items()
    }
    ends = ", ".join(
        f"{_end(run) if np.isnan(lower[mu]) else f'{lower[mu]:.1f} mm'} (mu = {mu:g})"
        for mu, run in real.items()
    )
    slips = [1e3 * sum(spells(run, ContactMode.SLIP, *run.t[[0, -1]])) for run in real.values()]
    return observation(
        "how far down the object works its way between the tips of a real hand in the operations",
        "how much lower than in the paper's model it ends, with the friction that is worst, mm",
        float(np.max(list(lower.values()))),
        f"{openings}; they slip for {max(slips):.2g} ms in all with the friction that lets them "
        f"slip most, for {min(slips):.2g} ms with the one that does least. The object ends lower "
        f"than in the paper's model by: {ends}",
    )


def _end(run: Run) -> str:
    """The end of a run that did not hold, in words."""
    if not run.success:
        return f"{run.status} at {run.t[-1]:.4f} s"
    return "not held, a tip is free at the end" if not run.holds else "not at rest at the end"


def find(runs: Runs) -> tuple[Finding, ...]:
    """The operations and disturbances of a real hand, from the runs with unilateral contact."""
    return (which_survive(runs.real, runs.real_cases), operations(runs.operations, runs.real))
