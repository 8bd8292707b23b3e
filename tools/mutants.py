"""Breaks the core on purpose, one place at a time, and asks that the tests notice: `make mutants`.

A test that cannot fail shows nothing. Each mutant is built beside the tree, never in it.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Mutant:
    """One change of one place, and the test file that should turn red."""

    file: str
    right: str
    wrong: str
    test: str


MUTANTS = (
    Mutant(
        "energy.rs",
        "tilt: self.stiffness * tilt",
        "tilt: self.stiffness * tilt * R::constant(1.01)",
        "energy",
    ),
    Mutant(
        "energy.rs",
        "normal: self.stiffness * normal",
        "normal: self.stiffness * normal * R::constant(1.01)",
        "energy",
    ),
    Mutant(
        "energy.rs",
        "tangential: self.stiffness * tangential",
        "tangential: self.stiffness * tangential * R::constant(1.01)",
        "energy",
    ),
    Mutant(
        "energy.rs",
        "normal: self.stiffness * normal",
        "normal: self.stiffness * normal * R::constant(1.000001)",
        "terms",
    ),
    Mutant("dynamics.rs", "normal + tangential,", "normal,", "energy"),
    Mutant(
        "dynamics.rs",
        "self.torque[i] + self.finger_gravity[i]",
        "self.torque[i] - self.finger_gravity[i]",
        "terms",
    ),
    Mutant("geometry.rs", "swept = (u + signed", "swept = (u - signed", "terms"),
    Mutant(
        "geometry.rs",
        "(sx - thickness) - side.face",
        "(sx - thickness) - side.face * R::constant(1.0000001)",
        "terms",
    ),
    Mutant(
        "formulation/csm.rs",
        "two_alpha: R::constant(2.0 * alpha)",
        "two_alpha: R::constant(1.9 * alpha)",
        "stabilization",
    ),
    Mutant(
        "formulation/csm.rs",
        "beta: R::constant(beta)",
        "beta: R::constant(1.01 * beta)",
        "stabilization",
    ),
    Mutant("formulation/csm.rs", "half.mul_add(change[k], p[k])", "change[k] + p[k]", "energy"),
    Mutant(
        "integrator/rk4.rs", "R::constant(1.0 / 3.0) * h", "R::constant(0.3334) * h", "convergence"
    ),
    Mutant("integrator/rk4.rs", "drive.at(tau + half)", "drive.at(tau)", "convergence"),
    Mutant("grid.rs", "points.extend(inputs.breakpoints(start, end));", "", "convergence"),
    Mutant(
        "inputs.rs",
        "Some(&origin) if origin != anchor",
        "Some(&origin) if origin > anchor",
        "trajectories",
    ),
    Mutant("control.rs", "self.ki.neg_mul_add(memory", "self.ki.mul_add(memory", "terms"),
    Mutant(
        "linear.rs", "let x3 = t3.dot2(s22, -t2, s32)", "let x3 = t3.dot2(s22, t2, s32)", "terms"
    ),
    Mutant("trigonometry.rs", "8.333_333_333_322_49e-3", "8.333_333_334_322_49e-3", "terms"),
    Mutant("trigonometry.rs", "let half = 0.5 * z;", "let half = 0.5 * z + 1e-15 * z;", "terms"),
    Mutant(
        "real.rs",
        "f64::mul_add(self, a, b)",
        'if cfg!(target_feature = "avx512f") { self * a + b } else { f64::mul_add(self, a, b) }',
        "recording",
    ),
    Mutant("monitor.rs", "press < 0.0", "press < -1e9", "extreme or reproduce"),
    Mutant(
        "record.rs", "self.q.push(instant.q);", "self.q.push(instant.p);", "recording or symmetry"
    ),
    Mutant("simulate.rs", "(number > 0 || segment.first == 0)", "number > 0", "impulse"),
    Mutant("grid.rs", "self.first = step;", "self.first = step + 1;", "recording"),
)


def survives(mutant: Mutant, work: Path) -> bool:
    """Whether the tests pass in spite of the mutant."""
    source = work / "rust" / "softpinch" / "src" / mutant.file
    original = source.read_text()
    if original.count(mutant.right) != 1:
        raise SystemExit(
            f"{mutant.file}: {mutant.right!r} stands there {original.count(mutant.right)} times"
        )
    source.write_text(original.replace(mutant.right, mutant.wrong))
    try:
        build = ["cargo", "build", "--release", "--locked", "--quiet", "--package", "softpinch-py"]
        environment = {
            **os.environ,
            "CARGO_TARGET_DIR": str(work / "target"),
            "RUSTFLAGS": "-Awarnings",
        }
        subprocess.run(build, cwd=work, env=environment, check=True)
        shutil.copy(
            work / "target" / "release" / "lib_core.so",
            work / "python" / "softpinch" / "_core.abi3.so",
        )
        test = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "-k",
            mutant.test,
            "--no-header",
            "-p",
            "no:cacheprovider",
        ]
        environment = {**os.environ, "PYTHONPATH": str(work / "python"), "CI": "true"}
        done = subprocess.run(
            test, cwd=work, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode not in (0, 1):
            raise SystemExit(done.stdout + done.stderr)
        return done.returncode == 0
    finally:
        source.write_text(original)


def main() -> None:
    """Tries every mutant and fails where one survives."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    alive = []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for name in listed:
            (work / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, work / name)
        for mutant in MUTANTS:
            survived = survives(mutant, work)
            print(
                "SURVIVES" if survived else "caught  ",
                mutant.file,
                "|",
                mutant.wrong or f"without {mutant.right}",
                "|",
                mutant.test,
                flush=True,
            )
            if survived:
                alive.append(mutant)
    if alive:
        raise SystemExit(f"{len(alive)} of {len(MUTANTS)} mutants survive")
    print(f"all {len(MUTANTS)} mutants are caught")


if __name__ == "__main__":
    main()
