"""The columns of results as numbers, labels, tables for notebooks, DataFrames and Datasets."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from .. import _core
from ..scene import fields as units
from ..support import Bools, ShownTable, checks, require
from .estimates import Estimate
from .rows import Column

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

    from .results import Results

# Entries of the provenance that become separate attributes of a dataset.
_SEPARATE = ("softpinch", "numpy", "method", "formulation", "dt", "tolerance", "runs", "requested")
# The largest integer that every netCDF format supports.
_LARGEST_INTEGER = 2**31 - 1


def booleans(field: str, given: Any, runs: int) -> Bools:
    """Checks an array of booleans from the user, one for each run; `field` is its argument."""
    found = checks.read(field, given)
    if found.dtype != bool or found.shape != (runs,):
        given = f"{found.dtype} {found.shape}"
        raise ValueError(f"{field}: must be a name or booleans ({runs},), not {given}")
    return cast("Bools", found)


def event(results: Results, what: str | Bools) -> Bools:
    """Whether an event, by its name or as booleans, happened in each run (runs,)."""
    if isinstance(what, str):
        return results.happened(what)
    return booleans("what", what, results.runs)


def number(results: Results, name: str | Bools, field: str = "name") -> Column:
    """Returns a number for each run: a numeric column, or 1.0 and 0.0 for an event or booleans."""
    if not isinstance(name, str):
        return Column(booleans(field, name, results.runs).astype(np.float64), "1")
    if name in (*_core.STATUSES, *_core.VIOLATIONS):
        return Column(results.happened(name).astype(np.float64), "1")
    schema = results._spec.schema
    entry, _ = schema.locate(name, field)
    column = schema.entries[entry].split(results[entry])[name]
    return Column(column.values.astype(np.float64), column.unit)


def drawn_by_magnitude(results: Results, name: str) -> bool:
    """Whether a number was drawn by a distribution of its logarithm."""
    return any(
        name == path or name.startswith(f"{path}.")
        for paths, source in results._spec.draws.describe()["vary"].items()
        if source["kind"] in ("log_uniform", "log_normal")
        for path in paths.split(", ")
    )


def shown(column: Column) -> Column:
    """Converts a column to the unit that figures use."""
    unit, factor = units.DISPLAY_UNITS.get(column.unit, (column.unit, 1.0))
    return Column(column.values * factor, unit)


def probabilities(estimates: Mapping[str, Estimate]) -> ShownTable:
    """Event -> its share of the runs, with its interval."""
    rows = []
    for name, estimate in estimates.items():
        share, low, high = estimate.texts()
        rows.append((name, estimate.happened, share, f"{low} to {high}"))
    return ShownTable(("status", "runs", "share", "95 % interval"), rows)


def distributions(results: Results, units: Mapping[str, str]) -> ShownTable:
    """Mean, spread and range of the finite values of columns, name -> unit."""
    rows = []
    for name, unit in units.items():
        mean, median = results.mean(name), results.quantile(name, 0.5)
        label = name if unit == "1" else f"{name} [{unit}]"
        numbers = (mean.value, mean.spread, mean.least, median, mean.greatest, mean.left_out)
        rows.append((label, *numbers))
    columns_shown = ("", "mean", "spread", "least", "median", "greatest", "not finite")
    return ShownTable(columns_shown, rows)


def to_pandas(results: Results) -> DataFrame:
    """Converts results to a DataFrame; see `Results.to_pandas`."""
    pandas = require("pandas", extra="study", purpose="to_pandas")
    found = results._spec.schema.split(results.to_dict())
    run = found.pop("run")
    index = pandas.Index(run.values.astype(np.int64), name="run")
    values = {name: column.values for name, column in found.items()}
    frame: DataFrame = pandas.DataFrame(values, index=index)
    frame.attrs["units"] = {name: column.unit for name, column in found.items()}
    frame.attrs["provenance"] = results.provenance()
    return frame


def to_xarray(results: Results) -> Dataset:
    """Converts results to a Dataset; see `Results.to_xarray`."""
    xarray = require("xarray", extra="study", purpose="to_xarray")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    for name, values in results.to_dict().items():
        entry = results._spec.schema.entries[name]
        unit, dims = entry.unit, ["run"]
        for axis in entry.axes:
            own_index = f"{name}.index"
            if own_index in dims:
                own_index = f"{own_index}_{len(dims)}"
            dims.append(axis or own_index)
            if axis is not None:
                coordinates[axis] = (axis, list(units.AXES[axis]), {"units": ""})
        if not isinstance(unit, str):
            own = f"{dims[-1]}_unit" if name in units.RESULTS else f"{name}_unit"
            coordinates[own] = (dims[-1], list(unit), {"units": ""})
            unit = f"see {own}"
        if name == "run":
            coordinates[name] = ("run", values.astype(np.int64), {"units": unit})
        else:
            variables[name] = (dims, values, {"units": unit})
    provenance, seed = results.provenance(), results.seed
    attributes = {
        **{name: provenance[name] for name in _SEPARATE if provenance[name] is not None},
        "seed": seed if seed <= _LARGEST_INTEGER else str(seed),
        "interrupted": int(provenance["interrupted"]),
        "provenance": json.dumps(provenance),
    }
    result: Dataset = xarray.Dataset(variables, coordinates, attributes)
    return result
