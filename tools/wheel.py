"""Builds wheel and sdist, and tries each in an environment that has nothing else: `make wheel`."""

import subprocess
import sys
import tempfile
import venv
from pathlib import Path

TRIAL = """
import sys
import numpy as np
import softpinch as sp
run = sp.simulate(sp.Scene(duration=0.1))
assert run.success, run.message
extras = {"scipy", "matplotlib", "typer", "hypothesis"} & set(sys.modules)
assert not extras, f"the import needs NumPy only, not {extras}"
print("softpinch", sp.__version__, run.status, np.rad2deg(run.q[-1, 3:5]).round(3))
"""


def run(*command: str | Path) -> None:
    """Runs a command and stops where it fails."""
    subprocess.run([str(part) for part in command], check=True)


def main(maturin: str, out: str) -> None:
    """Builds into `out` with `maturin` and installs each result alone."""
    folder = Path(out)
    for old in [*folder.glob("softpinch-*.whl"), *folder.glob("softpinch-*.tar.gz")]:
        old.unlink()
    run(maturin, "build", "--release", "--locked", "--out", folder)
    run(maturin, "sdist", "--out", folder)
    for package in [*folder.glob("softpinch-*.whl"), *folder.glob("softpinch-*.tar.gz")]:
        with tempfile.TemporaryDirectory() as empty:
            venv.create(empty, with_pip=True)
            python = Path(empty) / "bin" / "python"
            run(
                python,
                "-m",
                "pip",
                "install",
                "--quiet",
                "--disable-pip-version-check",
                package.resolve(),
            )
            subprocess.run([python, "-c", TRIAL], check=True, cwd=empty)
            print(f"{package.name}: {package.stat().st_size / 1e6:.2f} MB, installs and runs alone")


if __name__ == "__main__":
    main(*sys.argv[1:])
