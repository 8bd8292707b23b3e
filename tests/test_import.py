"""`import softpinch` loads nothing but the standard library, NumPy and itself."""

import importlib
import subprocess
import sys

import pytest

import softpinch as sp

# Modules that are slow to import, and that nothing needs before something is computed.
SLOW = {
    *("asyncio", "concurrent.futures", "difflib", "hashlib"),
    *("multiprocessing", "statistics", "tomllib"),
}
# Modules that users reach as attributes; some need an extra as a whole.
MODULES = ("gym", "jax", "plot", "reference", "strategies", "stress")
WITH_EXTRAS = {"gym", "jax", "strategies"}
SIMULATE = "softpinch.simulate(softpinch.Scene(duration=0.01), record=('state', 'energy')).check()"


def loaded(program: str) -> set[str]:
    """The modules that a program loads beyond NumPy's own, in an interpreter of its own."""
    measured = (
        "import sys, numpy; before = set(sys.modules)\n"
        f"{program}\n"
        "print(*sorted(set(sys.modules) - before))"
    )
    done = subprocess.run(
        [sys.executable, "-c", measured], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


@pytest.mark.parametrize("work", ["", SIMULATE], ids=["import", "simulate"])
def test_softpinch_needs_numpy_only(work: str) -> None:
    packages = {module.partition(".")[0] for module in loaded(f"import softpinch\n{work}")}
    assert "softpinch" in packages
    assert packages - {"softpinch", "numpy"} <= sys.stdlib_module_names


def test_what_a_scene_does_not_need_waits_until_it_is_asked_for() -> None:
    modules = loaded("import softpinch")
    rooms = {module.split(".")[1] for module in modules if module.startswith("softpinch.")}
    assert rooms == {"_core", "paper", "run", "scene", "support"}
    assert not modules & SLOW
    assert "softpinch.study.results" in loaded("import softpinch; softpinch.monte_carlo")


def test_dir_shows_public_names_only() -> None:
    assert set(dir(sp)) == {*sp.__all__, *MODULES}
    assert len(set(sp.__all__)) == len(sp.__all__) > 80
    assert all(hasattr(sp, name) for name in dir(sp))
    for room in ("accuracy", "analysis", "fitting", "simulator", "store", "study"):
        assert set(sp._LAZY[room]) == set(importlib.import_module(f"softpinch.{room}").__all__)


def test_every_public_name_needs_numpy_only() -> None:
    names = ", ".join(sorted(set(dir(sp)) - WITH_EXTRAS))
    packages = {module.partition(".")[0] for module in loaded(f"from softpinch import {names}")}
    assert packages - {"softpinch", "numpy"} <= sys.stdlib_module_names
