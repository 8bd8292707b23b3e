"""Arrays that a study was given: told apart by their numbers, and damage to them is named."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from stores import resume, tiny

pytestmark = pytest.mark.usefixtures("small_parts")


def of_arrays(store: Path, mass: Any, kp: Any, turned: bool = False) -> sp.Study:
    vary = {"grasped.mass": mass, "control.kp": kp}
    if turned:
        vary = dict(reversed(vary.items()))
    return tiny(store, None, vary=vary)  # type: ignore[arg-type,no-any-return]


def test_other_arrays_are_refused_and_the_same_in_another_order_are_not(tmp_path: Path) -> None:
    mass = np.linspace(0.09, 0.11, 100)
    of_arrays(tmp_path, mass, 1e3 * mass)
    changed = mass.copy()
    changed[7] = np.nextafter(changed[7], 1.0)
    with pytest.raises(ValueError, match=r"vary\.grasped\.mass\.sha256 is '.*' there, and ") as e:
        of_arrays(tmp_path, changed, 1e3 * mass)
    assert "control" not in str(e.value)
    with pytest.raises(ValueError, match=r"vary\.grasped\.mass\.shape is \[100\] there, and \[99"):
        of_arrays(tmp_path, mass[:-1], 1e3 * mass[:-1])
    study = of_arrays(tmp_path, mass.tolist(), 1e3 * mass, turned=True)
    assert study.complete
    np.testing.assert_array_equal(study["grasped.mass"], mass)


def test_an_array_of_a_study_that_never_began_is_not_taken(tmp_path: Path) -> None:
    mass = np.linspace(0.09, 0.11, 100)
    of_arrays(tmp_path / "other", 2 * mass, 1e3 * mass)
    # Killed after the arrays, before the manifest.
    shutil.copytree(tmp_path / "other" / "arrays", tmp_path / "ours" / "arrays")
    of_arrays(tmp_path / "ours", mass, 1e3 * mass)
    resume(tmp_path / "ours")


def flip_the_last_bit(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (flip_the_last_bit, r"has been altered: its checksum differs"),
        (lambda path: np.save(path, np.arange(7)), "has been altered: its shape or type is not"),
        (lambda path: path.write_bytes(b""), "is damaged: "),
        (lambda path: path.write_bytes(b"nonsense"), "is damaged: "),
        (
            lambda path: path.write_bytes(b"PK\x03\x04 no archive"),
            "is damaged: it is not a NumPy file",
        ),
        (lambda path: np.save(path, np.float64(1.0)), "has been altered: its shape or type is not"),
        (lambda path: np.save(path, np.array([{}]), allow_pickle=True), "is damaged: "),
        (Path.unlink, "is missing"),
        (lambda path: (path.unlink(), path.mkdir()), "is not a file"),
    ],
)
def test_an_array_that_is_damaged_is_named(damage: Any, words: str, tmp_path: Path) -> None:
    mass = np.linspace(0.09, 0.11, 100)
    of_arrays(tmp_path, mass, 1e3 * mass)
    file = next((tmp_path / "arrays").iterdir())
    damage(file)
    study = sp.Study.open(tmp_path)
    np.testing.assert_array_equal(study["grasped.mass"], mass)
    for ask in (study.resume, study.verify):
        with pytest.raises(sp.StoreError, match=f"^{file}: {words}[^\n]*, which writes it again$"):
            ask()
    if file.is_dir():
        return
    of_arrays(tmp_path, mass, 1e3 * mass)
    sp.Study.open(tmp_path).verify()
