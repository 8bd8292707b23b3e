"""Breaks the core on purpose, one place at a time, and asks that the tests notice: `make mutants`.

With a word behind it, `python tools/mutants.py WORD` tries those whose file or test has the word.

A test that cannot fail shows nothing. Each mutant is built beside the tree, never in it.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from mutant_table import CARGO, MUTANTS, Mutant

ROOT = Path(__file__).resolve().parent.parent

# A mutant whose tests take longer has a loop without an end: they take seconds, a build a minute.
MOST_SECONDS = 600


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
    python = {**os.environ, "PYTHONPATH": str(work / "python")}
    options = ["--release", "--locked", "--quiet", "--package"]
    try:
        if mutant.test == CARGO:
            test = ["cargo", "test", *options, "softpinch", "--lib"]
        else:
            build = ["cargo", "build", *options, "softpinch-module"]
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
