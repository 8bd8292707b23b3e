"""Running scripts: those of examples/, as README says they are run, and those of documents."""

import contextlib
import io
import re
import runpy
import subprocess
import sys
import warnings
from collections.abc import Mapping
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
# What an example says and what it says in tests, which need not compute its thousands of runs with
# its accuracy.
CHANGES = {"04_a_study_that_is_kept.py": {"dt=2e-4": "dt=1e-3", "RUNS = 8000": "RUNS = 4000"}}


def run(script: Path, folder: Path, *arguments: str, apart: bool = False) -> str:
    """What a script prints, which must neither fail nor warn, in a folder.

    In this process, which has imported most libraries before, if not `apart`. JAX starts threads,
    and processes that a script starts import it by its name: such scripts are run apart, too.
    """
    if apart or re.search(r"__main__|import jax", script.read_text(encoding="utf-8")):
        command = [sys.executable, "-W", "error", str(script), *arguments]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
        assert (done.returncode, done.stderr) == (0, ""), done.stderr
        return done.stdout
    printed, said = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("error")
        patch.setattr(sys, "argv", [str(script), *arguments])
        patch.chdir(folder)
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
            runpy.run_path(str(script), run_name="__main__")
    assert said.getvalue() == ""
    return printed.getvalue()


def run_example(
    script: str, folder: Path, *options: str, changes: Mapping[str, str] | None = None
) -> str:
    """The output of an example, which must neither fail nor warn, and save its picture."""
    picture = folder / "picture.png"
    file = EXAMPLES / script
    if changes := changes or CHANGES.get(script):
        text = file.read_text(encoding="utf-8")
        for of_example, of_test in changes.items():
            assert of_example in text
            text = text.replace(of_example, of_test)
        file = folder / script
        file.write_text(text, encoding="utf-8")
    printed = run(file, folder, str(picture), *options)
    assert picture.stat().st_size > 1000
    return printed
