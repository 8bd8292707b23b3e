"""What a study leaves: tables, arrays and figures; and what it says on the screen."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..plot.style import save
from ..study import columns
from ..study.effects import sensitivity
from ..study.results import Ensemble, Results
from ..support.files import writing
from ..support.formats import FORMATS
from ..support.table import Table

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
# Figures, and tables with a row a run, have no more runs than this.
LARGEST = 100_000
# Failures of which capsules are written.
_CAPSULES = 10


def sample(study: Results) -> Ensemble:
    """All rows, or of a large study some, evenly among all: what figures are drawn of."""
    numbers = study._spread_out(LARGEST)
    return Ensemble(study._setup, study._sampling, study._some(numbers), requested=len(numbers))


def runs_table(ensemble: Results) -> Table:
    """A row for each run, a column for each number, exact."""
    found = columns.columns(ensemble.to_dict())
    headers = tuple(
        name if column.unit in ("", "1") else f"{name} [{column.unit}]"
        for name, column in found.items()
    )
    return Table(
        columns=headers,
        rows=tuple(zip(*(column.values.tolist() for column in found.values()), strict=True)),
    )


def summaries(study: Results) -> dict[str, str]:
    """The summaries, column by column -> unit."""
    result: dict[str, str] = {}
    entries = study._empty()
    for name in study._setup.summaries:
        found = columns.split(name, entries[name])
        result.update({key: column.unit for key, column in found.items()})
    return result


def scalars(study: Results) -> list[str]:
    """The summaries that are one number a run."""
    entries = study._empty()
    return [name for name in study._setup.summaries if entries[name].ndim == 1]


def summary_table(study: Results) -> Table:
    """Statistics of every summary over its finite values, and each status' probability.

    The interval is that of the mean, as if drawn independently: Wilson's for a probability.
    """
    rows: list[tuple[Any, ...]] = []
    happened = dict.fromkeys(["completed", *study.counts()])
    friction = study.scene.friction is not None or "friction" in study._setup.shapes
    for name in _core.VIOLATIONS:
        if (name != "slipping" or friction) and study.probability(name).happened:
            happened[name] = None
    for name in happened:
        estimate = study.probability(name)
        numbers = (estimate.value, estimate.low, estimate.high)
        rows.append((f"probability of {name}", "1", estimate.runs, *numbers, *[""] * 6))
    for name, unit in summaries(study).items():
        mean = study.mean(name)
        if not mean.runs:
            rows.append((name, unit, 0, *[""] * 9))
            continue
        reach = _REACH * mean.error
        interval = (mean.value, mean.value - reach, mean.value + reach)
        order = study.quantile(name, [0.05, 0.5, 0.95]).tolist()
        rows.append(
            (name, unit, mean.runs, *interval, mean.spread, mean.least, *order, mean.greatest)
        )
    return Table(columns=_SUMMARY, rows=tuple(rows))


def save_tables(study: Results, some: Ensemble, out: Path) -> list[Path]:
    """summary.csv, and where `some` are all runs, runs.csv and ensemble.npz."""
    files = [out / "summary.csv", out / "runs.csv", out / "ensemble.npz"]
    for file in files:
        # The study may be a stranger's, and a link must not lead what is written elsewhere.
        if file.is_symlink():
            file.unlink()
    summary_table(study).save(files[0])
    if some.runs < study.runs:
        for file in files[1:]:
            file.unlink(missing_ok=True)
        return files[:1]
    table = runs_table(some)
    with writing(files[1]), files[1].open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(table.columns)
        writer.writerows(table.rows)
    arrays: dict[str, Any] = dict(some.to_dict())
    # Objects would be pickled, and pickles are not loaded by default.
    arrays["message"] = some.message.astype(str)
    provenance = np.array(json.dumps(some.provenance()))
    with writing(files[2]):
        np.savez(files[2], provenance=provenance, **arrays)
    return files


def save_capsules(study: Results, out: Path) -> list[Path]:
    """The first few failures, each as a file that `softpinch run` replays."""
    files = []
    for capsule in study.failures()[:_CAPSULES]:
        files.append(out / "failures" / f"{capsule.run}.toml")
        for link in (files[-1].parent, files[-1]):
            if link.is_symlink():
                link.unlink()
        files[-1].parent.mkdir(exist_ok=True)
        with writing(files[-1]):
            files[-1].write_text(capsule.to_toml(), encoding="utf-8")
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
    from ..plot import ensemble_plot as draw

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


def lines(study: Results, seconds: float, earlier: int = 0) -> list[str]:
    """A finished study in a few lines; `seconds` are those of all but the earlier runs."""
    counts = ", ".join(f"{count} {name}" for name, count in study.counts().items())
    new = study.runs - earlier
    before = f", {earlier} of them before," if earlier else ""
    as_if = _as_if(study)
    behind = f", {as_if}" if as_if else ""
    result = [
        f"{study.runs} runs{before} in {seconds:.2f} s ({new / max(seconds, 1e-9):,.0f} "
        f"runs/s): {counts}",
        f"probability of completing: {study.probability('completed')}{behind}",
    ]
    found = scalars(study)
    if not found:
        return result
    width = max(map(len, found))
    known = summaries(study)
    header = f"{'':{width}}  {'mean ± standard error':<26} {'5 %':>11} {'95 %':>11}"
    result.append(f"{header}  (errors {as_if})" if as_if else header)
    for name in found:
        mean = study.mean(name)
        if not mean.runs:
            result.append(f"{name:{width}}  finite in no run")
            continue
        low, high = study.quantile(name, [0.05, 0.95])
        shown = f"{mean.value:.6g} ± {mean.error:.2g} {known[name]}"
        few = "" if mean.runs == study.runs else f"  ({mean.runs} runs)"
        result.append(f"{name:{width}}  {shown:<26} {low:>11.4g} {high:>11.4g}{few}")
    for name, each in (study.discretisation or {}).items():
        if np.ndim(each.bias) == 0:
            result.append(
                f"the step puts {name} off by {each.bias:.2g} ± {each.bias_error:.1g} "
                f"(sampling leaves {each.sampling_error:.2g}{behind})"
            )
    return result
