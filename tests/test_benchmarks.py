"""The benchmarks run: every script explains itself and has a quick look that writes nothing."""

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


def run(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "benchmarks" / script), *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)


@cache
def quick(script: str) -> subprocess.CompletedProcess[str]:
    return run(script, "--quick")


def written() -> dict[Path, bytes]:
    """The files that a measurement may write: documents with figures, and results."""
    files = [ROOT / "README.md"]
    for folder in ("docs", "results", "benchmarks"):
        files += [path for path in (ROOT / folder).rglob("*") if path.suffix != ".pyc"]
    return {path: path.read_bytes() for path in files if path.is_file()}


@cache
def explained(script: str) -> subprocess.CompletedProcess[str]:
    return run(script, "--help")


@pytest.mark.parametrize("script", SCRIPTS)
def test_help_says_what_a_benchmark_measures_and_measures_nothing(script: str) -> None:
    before = written()
    done = explained(script)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"usage: {script}")
    assert "--quick" in done.stdout
    purpose = (ROOT / "benchmarks" / script).read_text("utf-8").split('"""')[1].splitlines()[0]
    assert purpose in done.stdout
    assert "processor  " not in done.stdout
    assert written() == before


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_quick_look_measures_everything_and_writes_nothing(script: str) -> None:
    before = written()
    done = quick(script)
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
        parts = explained(script).stdout.split("out of ")[1].split("\n\n")[0]
        assert set(named.split()) <= set(re.findall(r"\w+", parts))
