"""The one table of fields: docs/symbols.md has its symbols, units and defaults."""

import re
from pathlib import Path
from typing import Any

import pytest

import softpinch as sp
from softpinch import _core
from softpinch.scene.disturbance import DISTURBANCES
from softpinch.scene.fields import PARAMETERS, QUANTITIES, SYMBOLS, units
from softpinch.scene.motion import MOTIONS
from softpinch.scene.parts import PAPERS
from softpinch.scene.paths import locate

PAGE = (Path(__file__).parents[2] / "docs" / "symbols.md").read_text("utf-8")
# What the page says of defaults that are no numbers.
WORDS = {"M": None, "no end": None, "not limited": None}
# Arguments of `simulate`: unit and default.
NUMERICS: dict[str, tuple[str, Any]] = {
    "dt": ("s", 1e-4),
    "stabilization.alpha": ("1/s", sp.Stabilization().alpha),
    "stabilization.beta": ("1/s", sp.Stabilization().beta),
}


def test_the_page_has_symbol_unit_and_default_of_every_parameter() -> None:
    rows = re.findall(
        r"^\|(?: \$(.+?)\$)? \| .*? \| (.*?) \| `([\w.]+)` \| (.*?) \|$", PAGE, re.MULTILINE
    )
    symbols, paths = {}, set()
    for symbol, unit, path, default in rows:
        written = WORDS[default] if default in WORDS else float(default)
        if path in NUMERICS:
            assert (unit, written) == NUMERICS[path]
            continue
        assert (unit, written) == (units(path, ()), locate(sp.Scene(), path)[0]), path
        paths.add(path)
        if symbol:
            symbols[symbol.replace("\\", "")] = path
    assert symbols == SYMBOLS
    of_right = {path for path in _core.PARAMETERS[:PAPERS] if "left" not in path}
    shared = {re.sub(r"(control|hand\.tip|friction)\.right", r"\1", path) for path in of_right}
    assert paths == shared | {"duration"}


def test_the_page_has_the_unit_of_every_recorded_quantity() -> None:
    """The rows of "State of the system" that name columns of `q`, `multipliers` and residuals."""
    table = PAGE.partition("## State of the system")[2].partition("## Parameters")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if "`" in line]
    written = {
        (name, int(k)): row[2]
        for row in rows
        for name, k in re.findall(r"`(\w+)\[(\d)\]`", row[-1])
    }
    assert written == {
        (name, k): unit
        for name in ("q", "multipliers", "residuals")
        for k, unit in enumerate(QUANTITIES[name].units)
    }


# Owner of a path -> the records that it may be.
OWNERS: dict[str, list[Any]] = {
    "hand.right": [sp.Finger, sp.Jaw, sp.Parallelogram],
    "hand.tip.law": [sp.PowerLaw, sp.MeasuredLaw],
    "hand.tip.relaxation": [sp.Maxwell],
    "grasped.right": [sp.Face, sp.Arc],
    "hand.tip": [sp.Fingertip],
    "grasped": [sp.GraspedObject],
    "control": [sp.Pid, sp.SampledController],
    "control.switch": [sp.GainSwitch],
    "schedule": [sp.Schedule],
    "disturbances": [*DISTURBANCES.values()],
    "motion": [*MOTIONS.values()],
    "initial": [sp.State],
    "": [sp.Scene],
}


@pytest.mark.parametrize("path", [field.path for field in PARAMETERS])
def test_every_field_of_the_table_is_a_field_of_a_record(path: str) -> None:
    owner, _, name = path.rpartition(".")
    assert any(name in record.__dataclass_fields__ for record in OWNERS[owner])


def test_fields_of_one_name_have_one_unit() -> None:
    """The columns of a study are looked up by the name of their field."""
    for field in PARAMETERS:
        shape = (9,) if isinstance(field.unit, tuple) else ()
        assert units(field.path, shape) == field.unit
