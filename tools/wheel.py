"""Builds wheel and sdist, and tries each in an environment that has nothing else: `make wheel`.

The wheel is tried with each extra alone, too; with `plot` that is the first figure. The printed
time goes from `pip install` to the end of the trial.
"""

import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

ALONE = """
import numpy as np
import softpinch as sp
scene = sp.Scene(duration=0.1)
run = sp.simulate(scene)
assert run.success, run.message
print("softpinch", sp.__version__, run.status, np.rad2deg(run.q[-1, 3:5]).round(3))
"""
# What each extra is for, with nothing installed beside it.
WITH = {
    "plot": "sp.plot.save(sp.plot.run(run), 'run.png')",
    "cli": """
import pathlib, subprocess, sysconfig
pathlib.Path("scene.toml").write_text(scene.to_toml())
command = pathlib.Path(sysconfig.get_path("scripts")) / "softpinch"
subprocess.run([command, "run", "scene.toml", "--out", "run.csv", "--plot", "run.png"], check=True)
""",
    "study": """
vary = {"grasped.mass": sp.Normal(0.1, 0.01)}
ensemble = sp.monte_carlo(scene, 16, vary=vary, sampler="sobol", progress=False)
ensemble.to_pandas().to_parquet("runs.parquet")
assert ensemble.to_xarray().sizes["run"] == 16
sp.reference.solve(scene)
""",
    "dask": "import distributed",
    "testing": "from softpinch import strategies; strategies.scenes().validate()",
}


def run(*command: str | Path, cwd: str | None = None) -> None:
    """Runs a command and stops where it fails."""
    subprocess.run([str(part) for part in command], check=True, cwd=cwd)


def try_out(package: Path, extra: str = "") -> None:
    """Installs a package, with one extra or none, into an empty environment and uses it there."""
    with tempfile.TemporaryDirectory() as empty:
        venv.create(empty, with_pip=True)
        python = Path(empty) / "bin" / "python"
        begin = time.perf_counter()
        asked = f"{package.resolve()}[{extra}]" if extra else package.resolve()
        run(python, *["-m", "pip", "install", "--quiet", "--disable-pip-version-check"], asked)
        # -I: whatever PYTHONPATH names is no part of the trial.
        run(python, "-I", "-c", ALONE + WITH.get(extra, ""), cwd=empty)
        took = time.perf_counter() - begin
    what = f"with the extra {extra} alone" if extra else "alone"
    size = package.stat().st_size / 1e6
    print(f"{package.name}: {size:.2f} MB, installs and runs {what} in {took:.1f} s")


def main(maturin: str, out: str) -> None:
    """Builds into `out` with `maturin` and tries the results."""
    folder = Path(out)
    for old in [*folder.glob("softpinch-*.whl"), *folder.glob("softpinch-*.tar.gz")]:
        old.unlink()
    run(maturin, "build", "--release", "--locked", "--out", folder)
    run(maturin, "sdist", "--out", folder)
    for package in [*folder.glob("softpinch-*.whl"), *folder.glob("softpinch-*.tar.gz")]:
        try_out(package)
    for wheel in folder.glob("softpinch-*.whl"):
        for extra in WITH:
            try_out(wheel, extra)


if __name__ == "__main__":
    main(*sys.argv[1:])
