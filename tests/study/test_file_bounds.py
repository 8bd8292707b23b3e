"""Files from strangers cost bounded time and memory, and errors in them are one line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import softpinch as sp

MIB = 2**20
DEEP = 20_000
# Name of a file -> what it holds, and what the error says after the file's name.
SCENES: dict[str, tuple[str | bytes, str]] = {
    "arrays": (f"gravity = {'[' * DEEP}{']' * DEEP}", ""),
    "long value": (f'fingers = "{"a" * MIB}"', "Scene.fingers = 'aaaaa"),
    "twice": ("gravity = 1\ngravity = 2", "Cannot overwrite a value (at end"),
    "nan": ("gravity = nan", "Scene.gravity = NaN: must be finite"),
    "latin-1": ("# S\xfcd\ngravity = 1".encode("latin-1"), "byte 0xfc"),
}  # fmt: skip
VARY = '[vary]\n"schedule.angles" = {kind = "scipy", name = '
STUDIES = {
    "runs": (f"[study]\nruns = {10**22}", "runs = 10000000000000000000000: must be at most"),
    "group": (VARY + '"special_ortho_group", kwds = {dim = 20_000}}',
              "draws of special_ortho_group have shape (20000,), must have shape (1, 2)"),
    "kind": ("[vary]\ngravity = {kind = ['scipy']}", "Distribution.kind (in [vary].\"gravity\")"),
    "array elsewhere": ('[vary]\ngravity = {kind = "array", file = "/dev/zero", sha256 = "0"}',
                        "[vary].\"gravity\": file = '/dev/zero': must be in the folder"),
    "array above": ('[vary]\ngravity = {kind = "array", file = "../a.npy", sha256 = "0"}',
                    "[vary].\"gravity\": file = '../a.npy': must be in the folder"),
    "broadcast": (f"[vary]\ngravity = {{kind = 'uniform', low = {[0.0] * 10_000}, "
                  f"high = {[[1.0]] * 10_000}}}", "Uniform: shapes must broadcast to at most"),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with every file."""
    for name, (data, _) in {**SCENES, **STUDIES}.items():
        (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    with (tmp_path / "large").open("wb") as file:
        file.truncate(64 * MIB + 1)
    return tmp_path


# Runs the commands that it reads, with 4 GiB of memory, and writes what each said.
CHILD = """
import json, resource, sys
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
from typer.testing import CliRunner
from softpinch import cli
for command in json.load(sys.stdin):
    result = CliRunner().invoke(cli.app, command)
    print(json.dumps([result.exit_code, result.stderr, repr(result.exception)]), flush=True)
"""


def commands(given: list[list[str]]) -> list[tuple[int, str, str]]:
    done = subprocess.run(
        [sys.executable, "-c", CHILD], input=json.dumps(given), capture_output=True, text=True,
        timeout=120, check=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


@pytest.mark.skipif(sys.platform != "linux", reason="limits its own memory as Linux does")
def test_the_shell_says_it_in_one_line_in_bounded_time_and_memory(folder: Path) -> None:
    pytest.importorskip("typer")
    said = {folder / name: text for name, (_, text) in SCENES.items()}
    said[folder / "large"] = "has more than 64 MiB"
    said[folder / "nowhere"] = "No such file or directory"
    asked = [(["run", str(path)], path, text) for path, text in said.items()]
    also = ("large", "arrays", "latin-1", "nowhere")
    asked += [
        (["montecarlo", str(folder / name), "--out", str(folder / "out")], folder / name, text)
        for name, text in {
            **{name: said[folder / name] for name in also},
            **{name: text for name, (_, text) in STUDIES.items()},
        }.items()
    ]
    found = commands([command for command, _, _ in asked])
    for (command, path, text), (code, err, error) in zip(asked, found, strict=True):
        assert (code, error) == (2, "SystemExit(2)"), (command, error, err)
        assert err.startswith(f"error: {path}: ") and text in err, (command, err)
        assert err.count("\n") == 1 and err[:-1].isprintable() and len(err) < 2100, command
    assert not (folder / "out").exists()


def test_files_within_the_bounds_are_read(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbfduration = 2\r\n[grasped]\r\nmass = 1\r\n")
    assert sp.Scene.from_toml(path) == sp.Scene(duration=2, grasped=sp.GraspedObject(mass=1))
    many = sp.Schedule.sampled(range(20_000), [[0.1, 0.1]] * 20_000)
    scene = sp.Scene(schedule=many)
    path.write_text(scene.to_toml(), encoding="utf-8")
    assert sp.Scene.from_toml(path) == scene


@pytest.mark.skipif(sys.platform == "win32", reason="has no such files")
def test_the_shell_reads_standard_input(tmp_path: Path) -> None:
    pytest.importorskip("typer")
    command = [sys.executable, "-m", "softpinch", "run", "/dev/stdin", "--dt", "1e-3"]
    text = sp.Scene(duration=0.01).to_toml()
    done = subprocess.run(command, input=text, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("completed: ")
