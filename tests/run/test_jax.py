"""The tests of the layer for JAX, `jax_layer.py`, in a process of their own.

JAX computes on threads, which do not survive a fork: tests of executors that fork would wait for
ever in a process that has used it.
"""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]


@pytest.mark.skipif(find_spec("jax") is None, reason="the extra jax is not installed")
def test_the_layer_for_jax() -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, Path(__file__).with_name("jax_layer.py")],
        cwd=TESTS.parent,
        env={**os.environ, "XLA_FLAGS": "--xla_backend_optimization_level=0"},  # compiles faster
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=250,
    )
    assert done.returncode == 0, done.stdout


def test_no_other_test_loads_jax() -> None:
    loads = re.compile(
        r"^\s*(import|from) (jax|softpinch\.jax)|^\w+ = pytest\.importorskip\(.jax", re.M
    )
    files = TESTS.rglob("test_*.py")
    assert not [file.name for file in files if loads.search(file.read_text(encoding="utf-8"))]
