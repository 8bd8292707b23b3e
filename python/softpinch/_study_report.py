"""What a study leaves: tables, arrays and figures; and what it says on the screen."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from . import _columns, _core
from ._columns import Column
from ._report import Table
from ._style import save
from .effects import sensitivity
from .results import Results
from .reproduce import FORMATS

_SUMMARY = (
    "name",
    "unit",
    "runs",
    "mean",
    "low (95 %)",
    "high (95 %)",
    "std",
    "min",
    "5 %",
    "50 %",
    "95 %",
    "max",
)
# Two-sided, 95 %.
_REACH = 1.959963984540054


def runs_table(ensemble: Results) -> Table:
    """A row for each run, a column for each number, exact."""
    found = _columns.columns(ensemble)
    headers = tuple(
        name if column.unit in ("", "1") else f"{name} [{column.unit}]"
        for name, column in found.items()
    )
    return Table(
        columns=headers,
        rows=tuple(zip(*(column.values.tolist() for column in found.values()), strict=True)),
    )


def summaries(ensemble: Results) -> dict[str, Column]:
    """The summaries, column by column."""
    result: dict[str, Column] = {}
    for name, values in ensemble.summaries.items():
        result.update(_columns.split(name, values))
    return result


def scalars(ensemble: Results) -> list[str]:
    """The summaries that are one number a run."""
    return [name for name, values in ensemble.summaries.items() if values.ndim == 1]


def summary_table(ensemble: Results) -> Table:
    """Statistics of every summary over its finite values, and each status' probability.

    The interval is that of the mean, as if drawn independently: Wilson's for a probability.
    """
    rows: list[tuple[Any, ...]] = []
    statuses = dict.fromkeys(["completed", *ensemble.counts()])
    seen = [name for name, times in ensemble.violations.items() if np.isfinite(times).any()]
    for name in (*statuses, *(name for name in seen if name not in statuses)):
        estimate = ensemble.probability(name)
        numbers = (estimate.value, estimate.low, estimate.high)
        rows.append((f"probability of {name}", "1", estimate.runs, *numbers, *[""] * 6))
    for name, column in summaries(ensemble).items():
        values = column.values[_columns.finite(column.values)]
        if not len(values):
            rows.append((name, column.unit, 0, *[""] * 9))
            continue
        mean, error = mean_and_error(values)
        spread = float(values.std(ddof=1)) if len(values) > 1 else math.nan
        reach = _REACH * error
        order = np.quantile(values, [0.0, 0.05, 0.5, 0.95, 1.0]).tolist()
        rows.append(
            (name, column.unit, len(values), mean, mean - reach, mean + reach, spread, *order)
        )
    return Table(columns=_SUMMARY, rows=tuple(rows))


def mean_and_error(values: np.ndarray[Any, Any]) -> tuple[float, float]:
    """Mean and its standard error; NaN where there are too few."""
    if not len(values):
        return math.nan, math.nan
    error = values.std(ddof=1) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return float(values.mean()), float(error)


def save_tables(ensemble: Results, out: Path) -> list[Path]:
    """runs.csv, summary.csv and ensemble.npz."""
    files = [out / "runs.csv", out / "summary.csv", out / "ensemble.npz"]
    table = runs_table(ensemble)
    with files[0].open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table.columns)
        writer.writerows(table.rows)
    summary_table(ensemble).save(files[1])
    arrays: dict[str, Any] = dict(ensemble.to_dict())
    # Objects would be pickled, and pickles are not loaded by default.
    arrays["message"] = ensemble.message.astype(str)
    provenance = np.array(json.dumps(ensemble.provenance()))
    np.savez(files[2], provenance=provenance, **arrays)
    return files


def save_figures(ensemble: Results, out: Path, format: str) -> list[Path]:
    """A histogram of each summary of one number, and what there is to see of failures.

    Figures that an earlier study has left there go: they would pass for this one's.
    """
    names = ["failure_times", "success_map", *(f"histogram_{name}" for name in _core.SUMMARIES)]
    names += [f"importance_{name}" for name in ("completed", *_core.SUMMARIES)]
    for name in names:
        for suffix in FORMATS:
            (out / f"{name}.{suffix}").unlink(missing_ok=True)
    return [save(figure, out / f"{name}.{format}") for name, figure in _figures(ensemble)]


def _figures(ensemble: Results) -> Iterator[tuple[str, Any]]:
    from . import ensemble_plot as draw

    for name in scalars(ensemble):
        yield f"histogram_{name}", draw.histogram(ensemble, name)
    yield "failure_times", draw.failure_times(ensemble)
    if not ensemble.parameters:
        return
    completed = float(ensemble.probability("completed"))
    if 0.0 < completed < 1.0:
        found = sensitivity(ensemble, "completed")
        yield "importance_completed", draw.importance(ensemble, "completed", found)
        if len(found) > 1:
            x, y, *_ = found
            yield "success_map", draw.success_map(ensemble, x, y)
    for name in scalars(ensemble)[:1]:
        yield f"importance_{name}", draw.importance(ensemble, name)


def _as_if(ensemble: Results) -> str:
    """What must be said of errors of points that are not independent."""
    return "" if ensemble.sampler == "random" else "as if drawn independently"


def lines(ensemble: Results, seconds: float) -> list[str]:
    """A finished study in a few lines."""
    counts = ", ".join(f"{count} {name}" for name, count in ensemble.counts().items())
    as_if = _as_if(ensemble)
    behind = f", {as_if}" if as_if else ""
    result = [
        f"{ensemble.runs} runs in {seconds:.2f} s ({ensemble.runs / max(seconds, 1e-9):,.0f} "
        f"runs/s): {counts}",
        f"probability of completing: {ensemble.probability('completed')}{behind}",
    ]
    found = {name: ensemble[name] for name in scalars(ensemble)}
    if not found:
        return result
    width = max(map(len, found))
    known = summaries(ensemble)
    header = f"{'':{width}}  {'mean ± standard error':<26} {'5 %':>11} {'95 %':>11}"
    result.append(f"{header}  (errors {as_if})" if as_if else header)
    for name, values in found.items():
        kept = values[_columns.finite(values)]
        if not len(kept):
            result.append(f"{name:{width}}  finite in no run")
            continue
        mean, error = mean_and_error(kept)
        low, high = np.quantile(kept, [0.05, 0.95])
        shown = f"{mean:.6g} ± {error:.2g} {known[name].unit}"
        few = "" if len(kept) == ensemble.runs else f"  ({len(kept)} runs)"
        result.append(f"{name:{width}}  {shown:<26} {low:>11.4g} {high:>11.4g}{few}")
    for name, each in (ensemble.discretisation or {}).items():
        if np.ndim(each.bias) == 0:
            result.append(
                f"the step puts {name} off by {each.bias:.2g} ± {each.bias_error:.1g} "
                f"(sampling leaves {each.sampling_error:.2g}{behind})"
            )
    return result
