"""Breaks the core on purpose, one place at a time, and asks that the tests notice: `make mutants`.

With a word behind it, `python tools/mutants.py WORD` tries those whose file or test has the word.

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

# A mutant whose tests take longer has a loop without an end: they take seconds, a build a minute.
MOST_SECONDS = 600

# In the place of a test's name: the core's own tests.
CARGO = "cargo test"


@dataclass(frozen=True)
class Mutant:
    """One change of one place, and the tests (pytest's -k) that should turn red."""

    file: str
    right: str
    wrong: str
    test: str


MUTANTS = (
    Mutant(
        "model/energy.rs",
        "tilt: area * (R::constant(2.0 / 3.0)",
        "tilt: R::constant(1.01) * area * (R::constant(2.0 / 3.0)",
        "energy",
    ),
    Mutant(
        "model/energy.rs",
        "normal: stiff_t.mul_add(",
        "normal: R::constant(1.01) * stiff_t.mul_add(",
        "energy",
    ),
    Mutant(
        "model/energy.rs",
        "tangential: stiff_n * d_n",
        "tangential: R::constant(1.01) * stiff_n * d_n",
        "energy",
    ),
    Mutant(
        "model/energy.rs",
        "normal: stiff_t.mul_add(",
        "normal: R::constant(1.000001) * stiff_t.mul_add(",
        "terms",
    ),
    Mutant("model/forces.rs", "normal + tangential,", "normal,", "energy"),
    Mutant(
        "model/forces.rs",
        "(self.torque[0] + self.finger_gravity[0])",
        "(self.torque[0] - self.finger_gravity[0])",
        "terms",
    ),
    Mutant("model/geometry.rs", "swept = (u + signed", "swept = (u - signed", "terms"),
    Mutant(
        "model/geometry.rs",
        "(self.sx - (side.radius - d_n)) - side.face",
        "(self.sx - (side.radius - d_n)) - side.face * R::constant(1.0000001)",
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
    Mutant("method/rk4.rs", "R::constant(1.0 / 3.0) * h", "R::constant(0.3334) * h", "convergence"),
    Mutant("method/rk4.rs", "drive.at(tau + half)", "drive.at(tau)", "convergence"),
    Mutant(
        "formulation/constrained.rs",
        "mixed: -(h * (k * inverse))",
        "mixed: h * k * inverse",
        "terms or trajectories",
    ),
    Mutant(
        "formulation/projected.rs",
        "let q = corrected_position(plant, &left_q, [0; 2]);",
        "let q = left_q;",
        "formulations",
    ),
    Mutant("method/dop853/tableau.rs", "0.2413651341592667", "0.2413651441592667", CARGO),
    Mutant(
        "stepping/grid.rs",
        "inputs.next_breakpoint(from)",
        "inputs.next_breakpoint(self.end)",
        "convergence",
    ),
    Mutant(
        "model/inputs.rs",
        "Some(&origin) if origin != anchor",
        "Some(&origin) if origin > anchor",
        "trajectories",
    ),
    Mutant("model/control.rs", "self.ki.neg_mul_add(memory", "self.ki.mul_add(memory", "terms"),
    Mutant(
        "number/linear.rs",
        "let x2 = y2 / d2;",
        "let x2 = y2 / d2 * R::constant(1.0000001);",
        "terms",
    ),
    Mutant("number/trigonometry.rs", "8.333_333_333_322_49e-3", "8.333_333_334_322_49e-3", CARGO),
    Mutant(
        "number/trigonometry.rs",
        "z.mul_add(r, -(x * y)))",
        "z.mul_add(r, -(x * y)) + c(1e-15) * z)",
        CARGO,
    ),
    Mutant(
        "number/trigonometry.rs",
        "x - (z * x).neg_mul_add(in_pairs(&S, z), R::zero())",
        "(z * x).mul_add(in_pairs(&S, z), x)",
        CARGO,
    ),
    Mutant(
        "stepping/instant.rs",
        "{ sound } else { each_finite(now, closure) }",
        "{ sound } else { sound }",
        CARGO,
    ),
    Mutant(
        "number/trigonometry.rs", "const SMALL: f64 = 0.785;", "const SMALL: f64 = 0.786;", CARGO
    ),
    Mutant(
        "stepping/monitor.rs", "normal.less(R::zero())", "normal.less(R::constant(-1e9))", "extreme"
    ),
    Mutant(
        "stepping/record.rs",
        "self.q.push(instant.q);",
        "self.q.push(instant.p);",
        "recording or symmetry",
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "if first == 0 && run",
        "if first == 0 && start > run.scene.initial.time && run",
        "impulse",
    ),
    Mutant(
        "number/dual.rs",
        "(self.chain(sin, cos), self.chain(cos, -sin))",
        "(self.chain(sin, cos), self.chain(cos, sin))",
        CARGO,
    ),
    Mutant("formulation/tangent.rs", "E::STATES.wrapping_sub(first)", "W", CARGO),
    Mutant(
        "method/linearize.rs",
        "delayed[i][k] = rate[r].mul_add(rows[r][k], delayed[i][k]);",
        "",
        CARGO,
    ),
    Mutant("number/linear.rs", "column.swap(k, *exchanged);", "", CARGO),
    Mutant(
        "method/newton.rs",
        "const FIXED: f64 = 1e-17;",
        "const FIXED: f64 = 1e-6;",
        "convergence",
    ),
    Mutant(
        "method/newton.rs",
        "self.reusable = rate <= REUSE_RATE;",
        "self.reusable = false;",
        "methods",
    ),
    Mutant(
        "method/implicit_midpoint.rs",
        "next[n] = 2.0f64.mul_add(z[n], step.y[n]);",
        "next[n] = 2.000001f64.mul_add(z[n], step.y[n]);",
        "convergence",
    ),
    Mutant("method/radau5.rs", "0.250_213_122_965_333_3", "0.250_213_123_965_333_3", CARGO),
    Mutant(
        "method/radau5.rs",
        "z[n] = step.h * works[n];",
        "z[n] = 1.01 * step.h * works[n];",
        "convergence",
    ),
    Mutant("method/rosenbrock.rs", "-0.189532918363016", "-0.189532928363016", CARGO),
    Mutant(
        "method/rosenbrock.rs",
        "E::of(share.mul_add(by_time[n], load[n]))",
        "E::of(load[n])",
        "convergence",
    ),
    Mutant(
        "method/dop853.rs",
        "R::constant(2.0).mul_add(change, -h * (last[n] + first[n]))",
        "R::constant(2.0).mul_add(change, -h * last[n])",
        CARGO,
    ),
    Mutant(
        "method/step_control.rs",
        "let allowed = errors.at_most(c(1.0));",
        "let allowed = errors.at_most(c(1e3));",
        CARGO,
    ),
    Mutant(
        "stepping/inside_step.rs",
        "system.correct(&lanes.batch.drive, since, &mut between);",
        "",
        "methods",
    ),
    Mutant(
        "stepping/sizes.rs",
        "self.largest[n] = R::select(larger, y[n].abs(), self.largest[n]);",
        "",
        "methods",
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "(self.in_use, self.taken_at) = (Some(point), Some(point));",
        "(self.in_use, self.taken_at) = (Some(point), Some([f64::NAN; 21]));",
        "recording",
    ),
    Mutant(
        "stepping/grid.rs", "first: step, start: time", "first: step + 1, start: time", "recording"
    ),
    Mutant(
        "model/noise.rs",
        "0x9E37_79B9_7F4A_7C15",
        "0x9E37_79B9_7F4A_7C17",
        CARGO,
    ),
    Mutant(
        "model/noise.rs",
        "(radius * cos, radius * sin)",
        "(radius * cos, radius * cos)",
        "noise",
    ),
    Mutant(
        "model/noise.rs",
        "if self.start <= t && t < self.end {",
        "if self.start <= t {",
        "noise",
    ),
    Mutant(
        "model/drive.rs",
        "wave.active &= !(1 << lane);",
        "",
        "ensemble",
    ),
    Mutant(
        "model/drive.rs",
        "self.degree = self.degrees.into_iter().max().unwrap_or(0);",
        "self.degree = own.degree;",
        "ensemble",
    ),
    Mutant(
        "stepping/summary.rs",
        ".min_in(instant.q[D_N + 1], seen)",
        "",
        "ensemble",
    ),
    Mutant(
        "stepping/summary.rs",
        "let seen = seen & self.after.at_most(instant.t);",
        "let seen = seen & self.after.less(instant.t);",
        "ensemble",
    ),
    Mutant(
        "number/linear.rs",
        "*earlier &= !larger;",
        "",
        CARGO,
    ),
    Mutant(
        "stepping/equal.rs",
        "lanes.batch.active & !(lanes.impulses_applied | lanes.held);",
        "lanes.batch.active & !lanes.held;",
        "ensemble",
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "run.place.arrival += 1;",
        "",
        "impulse",
    ),
    Mutant(
        "stepping/adaptive.rs",
        "let watching = accepted & !lanes.entering;",
        "let watching = accepted;",
        "ensemble",
    ),
    Mutant(
        "stepping/adaptive.rs",
        "here.sizes.note(size, arrived, accepted, 0);",
        "here.sizes.note(size, arrived, R::ALL, 0);",
        "ensemble",
    ),
    Mutant(
        "method/step_control.rs",
        "z.mul_add(c(1.0 / 9.0), c(1.0 / 7.0))",
        "z.mul_add(c(1.0 / 9.0), c(1.0 / 6.0))",
        CARGO,
    ),
    Mutant("method/stability.rs", "|| rate.re > 0.0 {", "{", CARGO),
    Mutant("method/stability.rs", "growth > 1.0 + ROUND_OFF", "growth > 1.1", CARGO),
    Mutant("stepping/grid.rs", "h: self.h / f64::from(refine)", "h: self.h", CARGO),
    Mutant(
        "analysis/modes.rs",
        "0.0, &system.begin(motion))",
        "0.0, &system.begin(&Motion::typical_magnitudes(parameters)))",
        "stability",
    ),
    Mutant(
        "stepping/adaptive.rs",
        "most.at_most(lanes.places.attempts)",
        "most.at_most(lanes.places.steps)",
        "max_steps",
    ),
    Mutant(
        "stepping/adaptive.rs",
        "most.at_most(lanes.places.attempts)",
        "most.less(lanes.places.attempts)",
        "max_steps",
    ),
    Mutant(
        "formulation/constrained.rs",
        "driven[k] = b[k] + share[k];",
        "driven[k] = b[k];",
        "driven",
    ),
    Mutant(
        "formulation/csm.rs",
        "+ self.plant.driving_work(&geometry, &constraint_impulse, &p);",
        ";",
        "driven",
    ),
    Mutant(
        "model/forces.rs",
        "self.masses[FINGER].mul_add(acceleration[0], -others[0])",
        "-others[0]",
        "driven",
    ),
    Mutant("model/drive.rs", "(first, second + second)", "(first, second)", "driven"),
    Mutant(
        "model/inputs.rs", "SMOOTH * (size + other.abs())", "1e9 * (size + other.abs())", "driven"
    ),
    Mutant("model/start.rs", "off > CONSISTENCY * size", "off > 1e9 * size", "driven"),
    Mutant("model/motion.rs", "if pid.ki == 0.0 {", "if pid.ki < 0.0 {", "leaving_out"),
    Mutant("tests/operations.rs", "(size.degrees, size.all(),", "(size.states, size.all(),", CARGO),
)


def require_there(source: str, mutant: Mutant) -> None:
    """Refuses a mutant of code that is no longer there, before any other is tried."""
    if source.count(mutant.right) != 1:
        raise SystemExit(
            f"{mutant.file}: {mutant.right!r} stands there {source.count(mutant.right)} times"
        )


def survives(mutant: Mutant, work: Path) -> bool:
    """Whether the tests pass in spite of the mutant."""
    source = work / "rust" / "softpinch" / "src" / mutant.file
    original = source.read_text()
    require_there(original, mutant)
    source.write_text(original.replace(mutant.right, mutant.wrong))
    # Sooner built than fast: the bits are the same.
    quick = {"LTO": "off", "OPT_LEVEL": "1", "CODEGEN_UNITS": "16"}
    cargo = {
        **os.environ,
        "CARGO_TARGET_DIR": str(work / "target"),
        "RUSTFLAGS": "-Awarnings",
        **{f"CARGO_PROFILE_RELEASE_{name}": value for name, value in quick.items()},
    }
    python = {**os.environ, "PYTHONPATH": str(work / "python"), "CI": "true"}
    options = ["--release", "--locked", "--quiet", "--package"]
    try:
        if mutant.test == CARGO:
            test = ["cargo", "test", *options, "softpinch", "--lib"]
        else:
            build = ["cargo", "build", *options, "softpinch-py"]
            subprocess.run(build, cwd=work, env=cargo, check=True)
            built = work / "target" / "release" / "lib_core.so"
            shutil.copy(built, work / "python" / "softpinch" / "_core.abi3.so")
            test = [sys.executable, "-m", "pytest", "-x", "-q", "-k", mutant.test]
        environment = cargo if mutant.test == CARGO else python
        try:
            done = subprocess.run(
                test,
                cwd=work,
                env=environment,
                capture_output=True,
                text=True,
                timeout=MOST_SECONDS,
            )
        except subprocess.TimeoutExpired:  # a loop without an end is seen, too
            return False
        if done.returncode not in (0, 1, 101):
            raise SystemExit(done.stdout + done.stderr)
        return done.returncode == 0
    finally:
        source.write_text(original)


def main(word: str = "") -> None:
    """Tries every mutant that has the word and fails where one survives."""
    chosen = [mutant for mutant in MUTANTS if word in mutant.file or word in mutant.test]
    for mutant in MUTANTS:
        require_there((ROOT / "rust" / "softpinch" / "src" / mutant.file).read_text(), mutant)
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
        for mutant in chosen:
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
        raise SystemExit(f"{len(alive)} of {len(chosen)} mutants survive")
    print(f"all {len(chosen)} mutants are caught")


if __name__ == "__main__":
    main(*sys.argv[1:])
