"""Running a script of examples/, as README says it is run."""

import subprocess
import sys
from pathlib import Path

import rough_figures

EXAMPLES = Path(__file__).parents[2] / "examples"
# An example's step and a longer one for tests, which need not compute its thousands of runs with
# its accuracy.
STEPS = {"04_a_study_that_is_kept.py": ("dt=2e-4", "dt=1e-3")}


def run_example(script: str, folder: Path, *options: str) -> str:
    """The output of a script, which must neither fail nor warn, and save its picture."""
    picture = folder / "picture.png"
    file = EXAMPLES / script
    if script in STEPS:
        of_example, of_test = STEPS[script]
        text = file.read_text(encoding="utf-8")
        assert of_example in text
        file = folder / script
        file.write_text(text.replace(of_example, of_test), encoding="utf-8")
    rough = rough_figures.__file__
    command = [sys.executable, "-W", "error", rough, str(file), str(picture), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert picture.stat().st_size > 1000
    return done.stdout
