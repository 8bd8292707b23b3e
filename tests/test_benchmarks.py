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
import rough_figures

ROOT = Path(__file__).parent.parent
SCRIPTS = sorted(
    path.name
    for path in (ROOT / "benchmarks").glob("*.py")
    if "__main__" in path.read_text("utf-8")
)


# Prints the help of scripts, each after a line of its own.
EXPLAIN = """
import contextlib, runpy, sys
sys.path.insert(0, "benchmarks")
for script in sys.argv[1:]:
    print("====", script)
    sys.argv = [script, "--help"]
    with contextlib.suppress(SystemExit):
        runpy.run_path("benchmarks/" + script, run_name="__main__")
"""


def run(*command: str) -> subprocess.CompletedProcess[str]:
    # Peers' code that is compiled for a quick look need not be fast.
    env = {**os.environ, "XLA_FLAGS": "--xla_backend_optimization_level=0"}
    return subprocess.run([sys.executable, *command], cwd=ROOT, env=env, capture_output=True,
                          text=True, timeout=300)  # fmt: skip


def written() -> dict[Path, bytes]:
    """The files that a measurement may write: documents with figures, and results."""
    files = [ROOT / "README.md"]
    for folder in ("docs", "results", "benchmarks"):
        files += [path for path in (ROOT / folder).rglob("*") if path.suffix != ".pyc"]
    return {path: path.read_bytes() for path in files if path.is_file()}


@cache
def explained() -> dict[str, str]:
    """The help of each script, by one process, which imports the libraries once."""
    before = written()
    done = run("-c", EXPLAIN, *SCRIPTS)
    assert (done.returncode, done.stderr) == (0, "")
    assert written() == before
    texts = [part.split("\n", 1) for part in done.stdout.split("==== ")[1:]]
    return {script: text for script, text in texts}


@pytest.mark.parametrize("script", SCRIPTS)
def test_help_says_what_a_benchmark_measures_and_measures_nothing(script: str) -> None:
    text = explained()[script]
    assert text.startswith(f"usage: {script}")
    assert "--quick" in text
    purpose = (ROOT / "benchmarks" / script).read_text("utf-8").split('"""')[1].splitlines()[0]
    assert purpose in text
    assert "processor  " not in text


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_quick_look_measures_everything_and_writes_nothing(script: str) -> None:
    before = written()
    done = run(rough_figures.__file__, f"benchmarks/{script}", "--quick")
    assert done.returncode == 0, done.stderr
    assert "processor  " in done.stdout
    assert written() == before
    # Peers that are not installed are left out in one line.
    lines = [line for line in done.stdout.splitlines() if "not installed" in line]
    assert len(lines) <= 1
    assert all(line.startswith("left out   ") for line in lines)


def test_parts_that_documents_name_are_parts() -> None:
    texts = [path.read_text("utf-8") for path in [ROOT / "README.md", *ROOT.glob("docs/*.md")]]
    commands = re.findall(r"python benchmarks/(\w+\.py)((?: [a-z]\w*)+)", "\n".join(texts))
    assert len(commands) >= 3
    for script, named in commands:
        parts = explained()[script].split("out of ")[1].split("\n\n")[0]
        assert set(named.split()) <= set(re.findall(r"\w+", parts))
