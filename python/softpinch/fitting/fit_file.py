"""The files of `softpinch fit`: what to fit, in TOML, and what was measured, in CSV.

scene = "pinch.toml"            # or paper = "ii", or the tables of a scene file, as in a study

[fit]                           # arguments of `sp.fit`; all are optional
dt = 2e-4
loss = "soft_l1"
measured = ["theta", "y"]       # the columns of the data to use; all of them by default
noise = {theta = 1e-4}

[vary]                          # path in quotes = bounds
"hand.tip.youngs_modulus" = [1e5, 1e6]
"control.kp" = "unbounded"

[start]                         # path in quotes = where to start; the scene's values by default
"hand.tip.youngs_modulus" = 3e5
"""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..run.options import GAINS, NUMERICS, in_place
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..study.study_file import naming, scene_of
from ..support import checks, toml
from ..support.arrays import Floats
from .experiment import GROUPS, INDICES, NAMES, columns

_TOP = ("scene", "paper", "fit", "vary", "start")
# Entries of [fit] that are arguments of `sp.fit` by these names.
_SETTINGS = ("measured", "noise", "loss", "multistart", "seed", *NUMERICS)
_FREE = "unbounded"
# A column with one of these names has the times.
_TIME = "t"


def read(path: Path, **changes: Any) -> tuple[Scene, tuple[str, ...] | None, dict[str, Any]]:
    """Reads scene, observables (None is all columns) and arguments of `sp.fit`, with `changes`."""
    path = checks.path("path", path)
    data = toml.read(path)
    with naming(path):
        if "study" in data:
            raise ValueError("is a study of many runs: compute it with softpinch montecarlo")
        checks.refuse_unknown("fit file", data, _TOP, "")
        own = data.get("fit", {})
        checks.refuse_unknown("[fit]", own, _SETTINGS, "")
        scene = scene_of(data, path.parent)
        settings = {**own, **in_place(**changes)}
        names = settings.pop("measured", None)
        measured = None if names is None else checks.names("[fit].measured", names, NAMES)
        gains = {name: settings.pop(name) for name in GAINS if name in settings}
        settings["stabilization"] = Stabilization(**gains)
        settings["vary"] = _bounds(data.get("vary", {}))
        start = data.get("start", {})
        checks.refuse_unknown("[start]", start, settings["vary"], "")
        settings["start"] = start
        return scene, measured, settings


def _bounds(data: object) -> dict[str, Any]:
    if not isinstance(data, Mapping) or not data:
        example = '"hand.tip.youngs_modulus" = [1e5, 1e6]'
        raise ValueError(f"[vary]: must have a path in quotes and its bounds, such as {example}")
    found = {}
    for path, value in data.items():
        if isinstance(value, Mapping):
            # TOML reads a dotted path without quotes as nested tables.
            rule = f'must be one path in quotes, and bounds [low, high] or "{_FREE}"'
            raise ValueError(f"[vary].{path}: {rule}")
        if isinstance(value, str):
            checks.choice(f'[vary]."{path}"', value, (_FREE,))
        found[path] = None if isinstance(value, str) else value
    return found


def read_data(path: Path, wanted: tuple[str, ...] | None) -> tuple[Floats, dict[str, Floats]]:
    """Reads what was measured: times (n,), s, and observable -> values (n,) or (n, k).

    The first line names the columns, with or without units, as `Run.save` writes them. An empty
    entry is NaN. Without `wanted` all columns are returned, which must be observables.
    """
    path = checks.path("path", path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [(number, row) for number, row in enumerate(csv.reader(file), 1) if row]
        if len(rows) < 2:
            raise ValueError("must have a line of names and lines of numbers")
        head = rows[0][1]
        if len(head) == 1 and (";" in head[0] or "\t" in head[0]):
            raise ValueError("columns must be separated by commas, and numbers have decimal points")
        if all(text.partition("[")[0].strip() != _TIME for text in head):
            raise ValueError('has no column "t [s]"')
        names = [_column(text, wanted is None) for text in head]
        for name in names:
            if name and names.count(name) > 1:
                raise ValueError(f'has the column "{name}" more than once')
        for number, row in rows[1:]:
            if len(row) != len(names):
                rule = f"must have one for each of the {len(names)} names"
                raise ValueError(f"line {number} has {len(row)} entries: {rule}")
        every = {
            name: np.array([_number(row[k], number, name) for number, row in rows[1:]])
            for k, name in enumerate(names)
            if name
        }
        times, found = every.pop(_TIME), {}
        for name in every if wanted is None else wanted:
            own = columns(name)
            for column in own:
                if column not in every:
                    raise ValueError(f'has no column "{column}", which "{name}" needs')
            table = np.column_stack([every[column] for column in own])
            found[name] = table[:, 0] if len(own) == 1 else table
        return times, found
    except (ValueError, csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from None


def _column(text: str, all_wanted: bool) -> str:
    """Returns the name of a column without its unit; "" for one that is no observable."""
    name, _, unit = text.strip().removesuffix("]").partition("[")
    name, unit = name.strip(), unit.strip()
    known = GROUPS.get(name, (name,))
    if len(known) == 1:
        name = known[0]
    if name != _TIME and name not in INDICES:
        if all_wanted:
            rule = f"which is no observable{checks.hint(name, INDICES)}"
            advice = "name the columns to use in [fit] as measured = [...]"
            raise ValueError(f"has the column {checks.shown(name)}, {rule}; {advice}")
        return ""
    right = "s" if name == _TIME else INDICES[name].unit
    if unit and unit != right:
        raise ValueError(f'column "{name}": unit = {checks.shown(unit)}: must be "{right}"')
    return name


def _number(text: str, line: int, name: str) -> float:
    if not text.strip():
        return math.nan
    try:
        return float(text)
    except ValueError:
        where = f'line {line}, column "{name}"'
        raise ValueError(f"{where}: {checks.shown(text)}: must be a number, or empty") from None
