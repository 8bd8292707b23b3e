"""Names of observables: the columns of saved files, and the groups of `sp.linearize`."""

import csv
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from measured_motions import SCENE, motion
from softpinch.fitting.experiment import INDICES, columns


def test_each_column_is_that_of_the_saved_file(tmp_path: Path) -> None:
    run = motion()
    with run.save(tmp_path / "run.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    table = np.array(rows, dtype=float)
    assert len(INDICES) == 24
    for name, place in INDICES.items():
        saved = table[:, header.index(f"{name} [{place.unit}]")]
        np.testing.assert_array_equal(getattr(run, place.quantity)[:, place.column], saved, name)


@pytest.mark.parametrize("group", ["pose", "fingers", "compressions", "shears", "rates"])
def test_groups_have_the_outputs_of_linear_models(group: str) -> None:
    model = sp.linearize(SCENE, SCENE.start(), outputs=group)
    assert columns(group) == model.outputs
    assert tuple(INDICES[name].unit for name in columns(group)) == model.output_units


@pytest.mark.parametrize(("name", "error"), [("angle", ValueError), (3, TypeError)])
def test_unknown_names_are_refused(name: object, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"measured = .*must be one of"):
        columns(name)
