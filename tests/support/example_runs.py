"""Running a script of examples/, as README says it is run."""

import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"


def run_example(script: str, folder: Path, *options: str) -> str:
    """What a script prints. It must neither fail nor warn, and save its picture."""
    picture = folder / "picture.png"
    command = [sys.executable, "-W", "error", str(EXAMPLES / script), str(picture), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert picture.stat().st_size > 1000
    return done.stdout
