"""Paths, generators and folders that are none: the error names the argument, before any work."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch import plot
from softpinch.accuracy.measurements import WorkPrecision
from softpinch.accuracy.stability_maps import StabilityMap
from softpinch.reproduce import reproduce
from softpinch.run.run import Run
from softpinch.study.sampling import Plan

SCENE = sp.Scene(duration=2e-3)


def store(path: Any) -> Any:
    return sp.monte_carlo(SCENE, 2, store=path, dt=1e-3, progress=False)


# A path is looked at before the object that is saved.
TAKERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "monte_carlo": (store, "store"),
    "Study.open": (sp.Study.open, "path"),
    "reproduce": (reproduce, "out"),
    "Run.save": (lambda path: Run.save(None, path), "path"),  # type: ignore[arg-type]
    "StabilityMap.save": (lambda path: StabilityMap.save(None, path), "path"),  # type: ignore[arg-type]
    "WorkPrecision.save": (lambda path: WorkPrecision.save(None, path), "path"),  # type: ignore[arg-type]
    "plot.save": (lambda path: plot.save(None, path), "path"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("taker", TAKERS)
def test_what_is_no_path_is_named(
    taker: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    take, name = TAKERS[taker]
    wrong: list[tuple[Any, type[Exception]]] = [
        ("\ud800", ValueError), ("a\0b", ValueError), (Path("\ud800.csv"), ValueError),
        (5, TypeError), (b"a.csv", TypeError), (["a"], TypeError), (10**5000, TypeError),
    ]  # fmt: skip
    # To keep runs in memory, and the folder that one is in.
    wrong += [] if taker == "monte_carlo" else [(None, TypeError)]
    wrong += [] if taker == "Study.open" else [("", ValueError)]
    for value, kind in wrong:
        with pytest.raises(kind) as error:
            take(value)
        assert type(error.value) is kind
        assert str(error.value).startswith(f"{name} ") and ": must be " in str(error.value)
    assert not list(tmp_path.iterdir())


def test_a_study_does_not_begin_among_other_files(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    for name in ("thesis.tex", "data", "study.toml"):
        folder = tmp_path / f"has {name}"
        folder.mkdir()
        (folder / name).mkdir() if name == "data" else (folder / name).write_text("precious")
        with pytest.raises(
            sp.StoreError, match=rf"not a study: it contains {name}; give a new folder"
        ):
            store(folder)
        assert [entry.name for entry in folder.iterdir()] == [name]
    # What a killed beginning left and what a desktop leaves are no matter.
    for name in (".DS_Store", "lock"):
        folder = tmp_path / f"with {name}"
        folder.mkdir()
        (folder / name).touch()
        assert store(folder).complete
        # It has become a study, and whatever is put beside it later is no matter either.
        (folder / "notes.txt").touch()
        assert store(folder).complete
    with pytest.raises(sp.StoreError):
        store(tmp_path / "with lock" / "notes.txt")


@pytest.mark.parametrize(
    "distribution",
    [sp.Normal(0, 1), sp.Uniform(0, 1), sp.LogNormal(1, 1), sp.Choice([1.0]), sp.LogUniform(1, 2)],
    ids=lambda each: type(each).__name__,
)
def test_samples_come_from_a_generator(distribution: sp.Distribution) -> None:
    rng = np.random.default_rng(1)
    for wrong in (None, 5, np.random, np.random.RandomState(1), np.random.default_rng):
        with pytest.raises(TypeError, match=r"^rng = .*: must be a Generator$"):
            distribution.sample(wrong, 3)  # type: ignore[arg-type]
    for n, error in ((2.0, TypeError), (None, TypeError), (True, TypeError), (-1, ValueError),
                     (2**63, ValueError), (10**5000, ValueError)):  # fmt: skip
        with pytest.raises(error, match=r"^n = .*: must be "):
            distribution.sample(rng, n)  # type: ignore[arg-type]
    assert distribution.sample(rng, np.int64(3)).shape == (3,)
    with pytest.raises(ValueError, match=r"^u is ragged"):
        distribution.ppf([[0.1], [0.1, 0.2]])  # type: ignore[list-item]


def test_parameters_broadcast_to_what_fits_in_memory() -> None:
    low, high = np.zeros(10_000), np.ones((10_000, 1))
    with pytest.raises(ValueError, match=r"^Uniform: shapes must broadcast to at most 4194304 "):
        sp.Uniform(low, high)


def test_more_runs_than_any_memory_holds_are_refused() -> None:
    vary = {"gravity": sp.Normal(9.8, 0.1)}
    for runs, sampler, message in (
        (10**22, "random", r"^runs = 10{22}: must be at most 4611686018427387904$"),
        (2**62, "random", r"^runs = 4611686018427387904: must be at most 1099511627776 in memory"),
        (2**62, "latin_hypercube", "^runs = 4611686018427387904: must be at most"),
    ):
        with pytest.raises(ValueError, match=message):
            sp.monte_carlo(SCENE, runs, vary=vary, sampler=sampler, progress=False)
    many = Plan(vary, 2**60, 0, "latin_hypercube", shapes={"gravity": ()})
    with pytest.raises(ValueError, match=rf"^runs = {2**60}: too many for a Latin hypercube"):
        many.draw(0)


@pytest.mark.parametrize("path", [np.zeros(3), np.zeros((2, 2)), [""], np.array(["a", "b"])])
def test_no_array_is_the_path_of_a_study(path: Any) -> None:
    with pytest.raises(TypeError, match=r"^path = .*: must be the path of a folder"):
        sp.Study.open(path)


@pytest.mark.parametrize("made", [sp.Scene, sp.Capsule])
def test_a_text_that_is_no_toml_is_named(made: Any) -> None:
    with pytest.raises(ValueError, match=r"^source: Expected '='"):
        made.from_toml("csm")
