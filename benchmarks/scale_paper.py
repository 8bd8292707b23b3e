"""Estimate for 1e9 runs of disturbance (ii) from measured times: nothing here is run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from scale_driver import Driver
from softpinch.study.sources import BLOCK

RUNS = 10**9


class Rates(NamedTuple):
    """Measurements on the machine at hand, with disturbance (ii)."""

    # Runs a second of one worker.
    rate: float
    # What two workers did of twice one.
    share: float
    driver: Driver
    # Bytes of the store, a run.
    size: float


def project(of: Rates, clusters: Sequence[int], price: float) -> list[str]:
    """Formula, assumptions and results, line by line."""
    core = 1 / (of.rate * of.share)
    before = RUNS / BLOCK * of.driver.before
    during = RUNS / BLOCK * of.driver.during
    lines = [
        "1e9 runs of disturbance (ii), on paper",
        f"  measured   {of.rate:.0f} runs a second a worker; two workers do "
        f"{100 * of.share:.0f} % of twice one: {1e3 * core:.3f} core-ms a run",
        f"             the driver {1e3 * of.driver.before:.2f} ms a block of {BLOCK} before the "
        f"first run, {1e3 * of.driver.during:.2f} ms during the study",
        f"             {of.size:.0f} bytes a run in the store: {of.size * RUNS / 1e12:.3f} TB",
        f"  assumed    {price} $ a core-hour, the reader's to replace (--price); cores like these, "
        "one worker each;",
        "             more workers scale as two do, until the driver feeds no more; one more core "
        "for the driver",
        f"  computing  1e9 x {1e3 * core:.3f} ms = {RUNS * core / 3600:.0f} core-hours",
        f"  wall time  = {_time(before)} (drawing and checking all) + "
        f"max(computing / N, {_time(during)} (the driver))",
        f"  {'N cores':>9s} {'wall time':>12s} {'$':>8s}",
    ]
    for cores in clusters:
        wall = before + max(RUNS * core / cores, during)
        lines.append(f"  {cores:9d} {_time(wall):>12s} {(cores + 1) * wall / 3600 * price:8.2f}")
    return lines


def _time(seconds: float) -> str:
    for unit, name in ((86400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 2 * unit:
            return f"{seconds / unit:.1f} {name}"
    return f"{seconds:.0f} s"
