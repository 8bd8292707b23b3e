"""The benchmarks run: every script explains itself and has a quick look that writes nothing."""

import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

pytest.importorskip("scipy")
pytest.importorskip("matplotlib")

ROOT = Path(__file__).parent.parent
SCRIPTS = sorted(
    path.name
    for path in (ROOT / "benchmarks").glob("*.py")
    if "__main__" in path.read_text("utf-8")
)
# Their quick look takes nearly as long as that of all others: JAX compiles, processes start,
# ladders of settings are searched.
LONG = ("integrators.py", "reference.py", "reports.py", "scale.py")
SHORT = tuple(script for script in SCRIPTS if script not in LONG)
# Each has a process of its own.
GROUPS = [SHORT[:8], SHORT[8:], pytest.param(LONG, marks=pytest.mark.slow)]

# Runs scripts with an option, and prints a line with its name before each. The clocks take one
# turn: no test depends on timings.
TOGETHER = """
import contextlib, runpy, sys
import rough_figures
rough_figures.use(True)
sys.path.insert(0, "benchmarks")
import machine

once, turns = machine.median_time, machine.clock
machine.median_time = lambda work, repeats, *rest, **named: once(work, 1, *rest, **named)
machine.clock = lambda works, rounds, *rest, **named: turns(works, 1, *rest, **named)
_, option, *scripts = sys.argv
for script in scripts:
    print("====", script, flush=True)
    sys.argv = [script, option]
    with contextlib.suppress(SystemExit) if option == "--help" else contextlib.nullcontext():
        runpy.run_path("benchmarks/" + script, run_name="__main__")
"""


def run(option: str, scripts: tuple[str, ...]) -> dict[str, str]:
    """What scripts print, by one process, which imports the libraries once.

    They must not fail, and write nothing.
    """
    # Peers' code need not be fast for a quick look: to compile it takes longer than to run it.
    quick = {"XLA_FLAGS": "--xla_backend_optimization_level=0", "NUMBA_DISABLE_JIT": "1"}
    env = {**os.environ, **quick}
    before = written()
    done = subprocess.run([sys.executable, "-c", TOGETHER, option, *scripts], cwd=ROOT, env=env,
                          capture_output=True, text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert written() == before
    texts = dict(part.split("\n", 1) for part in done.stdout.split("==== ")[1:])
    assert list(texts) == list(scripts)
    return texts


def written() -> dict[Path, bytes]:
    """The files that a measurement may write: documents with figures, and results."""
    files = [ROOT / "README.md"]
    for folder in ("docs", "results", "benchmarks"):
        files += [path for path in (ROOT / folder).rglob("*") if path.suffix != ".pyc"]
    return {path: path.read_bytes() for path in files if path.is_file()}


@cache
def explained() -> dict[str, str]:
    return run("--help", tuple(SCRIPTS))


@pytest.mark.parametrize("script", SCRIPTS)
def test_help_says_what_a_benchmark_measures_and_measures_nothing(script: str) -> None:
    text = explained()[script]
    assert text.startswith(f"usage: {script}")
    assert "--quick" in text
    purpose = (ROOT / "benchmarks" / script).read_text("utf-8").split('"""')[1].splitlines()[0]
    assert purpose in text
    assert "processor  " not in text


@pytest.mark.parametrize("scripts", GROUPS)
def test_a_quick_look_measures_everything_and_writes_nothing(scripts: tuple[str, ...]) -> None:
    for text in run("--quick", scripts).values():
        assert "processor  " in text
        # Peers that are not installed are left out in one line.
        lines = [line for line in text.splitlines() if "not installed" in line]
        assert len(lines) <= 1
        assert all(line.startswith("left out   ") for line in lines)


def test_parts_that_documents_name_are_parts() -> None:
    texts = [path.read_text("utf-8") for path in [ROOT / "README.md", *ROOT.glob("docs/*.md")]]
    commands = re.findall(r"python benchmarks/(\w+\.py)((?: [a-z]\w*)+)", "\n".join(texts))
    assert len(commands) >= 3
    for script, named in commands:
        parts = explained()[script].split("out of ")[1].split("\n\n")[0]
        assert set(named.split()) <= set(re.findall(r"\w+", parts))
