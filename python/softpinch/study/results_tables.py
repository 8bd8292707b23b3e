"""Tables of results for notebooks: shares of the statuses, and the distribution of each number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from ..support.display import ShownTable
from .columns import Column
from .estimates import Estimate


def status_counts(parts: Iterable[NDArray[np.str_]]) -> dict[str, int]:
    """Status -> the number of runs with it, the most frequent first, then by name.

    Args:
        parts: Status of each run, for some runs at a time.
    """
    total: Counter[str] = Counter()
    for part in parts:
        _count(total, part)
    return _by_frequency(total)


def _count(total: Counter[str], statuses: NDArray[np.str_]) -> None:
    found, counts = np.unique(statuses, return_counts=True)
    total.update({str(name): int(n) for name, n in zip(found, counts, strict=True)})


def _by_frequency(total: Counter[str]) -> dict[str, int]:
    return dict(sorted(total.items(), key=lambda item: (-item[1], item[0])))


def statuses(parts: Iterable[tuple[NDArray[np.str_], NDArray[np.bool_]]]) -> ShownTable:
    """The shares of the statuses and of the runs that held, with Wilson's interval.

    Args:
        parts: Status of each run, and whether it held, for some runs at a time.
    """
    # Both columns in one pass, so that a study on disk is read once.
    total, held = Counter[str](), 0
    for status, holds in parts:
        _count(total, status)
        held += int(np.count_nonzero(holds))
    rows = []
    for name, count in [*_by_frequency(total).items(), ("holds", held)]:
        share = Estimate.counted(count, total.total())
        rows.append((name, count, share.value, f"{share.low:.5g} to {share.high:.5g}"))
    return ShownTable(("status", "runs", "share", "95 % interval"), rows)


def distributions(columns: Mapping[str, Column]) -> ShownTable:
    """Mean, spread and range of the finite values of each column."""
    rows = []
    for name, (values, unit) in columns.items():
        known = values[np.isfinite(values)]
        if known.size:
            spread = known.std(ddof=1) if known.size > 1 else np.nan
            numbers = (known.mean(), spread, known.min(), np.median(known), known.max())
        else:
            numbers = (np.nan,) * 5
        label = name if unit == "1" else f"{name} [{unit}]"
        rows.append((label, *numbers, len(values) - known.size))
    columns_shown = ("", "mean", "spread", "least", "median", "greatest", "not finite")
    return ShownTable(columns_shown, rows)
