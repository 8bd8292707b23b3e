"""Ensembles as pandas DataFrames and xarray Datasets. Needs the extra `study`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..scene import units
from ..support.extras import require
from .columns import Schema

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

# Entries of the provenance that become separate attributes of a dataset.
_ATTRIBUTES = (
    "softpinch",
    "numpy",
    "method",
    "formulation",
    "dt",
    "tolerance",
    "runs",
    "requested",
)
# The largest integer that every netCDF format supports.
_LARGEST_INTEGER = 2**31 - 1


def to_pandas(
    schema: Schema, entries: Mapping[str, NDArray[Any]], provenance: dict[str, Any]
) -> DataFrame:
    """Converts entries to a DataFrame with a row for each run and a column for each number.

    The index is the run's number. `attrs["units"]` maps every column to its unit ("1" for numbers
    without a unit, "" for text), and `attrs["provenance"]` is the provenance.

    Args:
        schema: The schema of the entries.
        entries: The result of `Results.to_dict`.
        provenance: `Results.provenance()`.

    Raises:
        ImportError: pandas is not installed.
    """
    pandas = require("pandas", extra="study", purpose="to_pandas")
    found = schema.split(entries)
    run = found.pop("run")
    index = pandas.Index(run.values.astype(np.int64), name="run")
    frame: DataFrame = pandas.DataFrame(
        {name: column.values for name, column in found.items()}, index=index
    )
    frame.attrs["units"] = {name: column.unit for name, column in found.items()}
    frame.attrs["provenance"] = provenance
    return frame


def to_xarray(
    schema: Schema, entries: Mapping[str, NDArray[Any]], provenance: dict[str, Any]
) -> Dataset:
    """Converts entries to a Dataset with a variable for each entry, over the dimension `run`.

    An axis of `AXES` is a dimension with labels; the others of an entry are "<entry>.index",
    "<entry>.index_2" and so on. Every variable has `attrs["units"]`. If the numbers of an entry
    have different units, an extra coordinate has the units, such as `state_unit` for the axis
    `state`. The attributes of the dataset are numbers and text that every netCDF format supports;
    `provenance` is JSON.

    Args:
        schema: The schema of the entries.
        entries: The result of `Results.to_dict`.
        provenance: `Results.provenance()`.

    Raises:
        ImportError: xarray is not installed.
    """
    xarray = require("xarray", extra="study", purpose="to_xarray")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    for name, values in entries.items():
        unit = schema.entries[name].unit
        dims = ["run"]
        for axis in schema.entries[name].axes:
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
    result: Dataset = xarray.Dataset(variables, coordinates, _attributes(provenance))
    return result


def _attributes(provenance: dict[str, Any]) -> dict[str, int | float | str]:
    facts = {name: provenance[name] for name in _ATTRIBUTES if provenance[name] is not None}
    seed = provenance["seed"]
    return {
        **facts,
        "seed": seed if seed <= _LARGEST_INTEGER else str(seed),
        "interrupted": int(provenance["interrupted"]),
        "provenance": json.dumps(provenance),
    }
