"""What a file from a stranger may cost: bounded time and memory, and one line that says where."""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

import softpinch as sp
from softpinch.study import study_file

MIB = 2**20
DEEP = 20_000
# Name of a file -> what it holds, and what the error says after the file's name.
SCENES: dict[str, tuple[str | bytes, str]] = {
    "arrays": (f"gravity = {'[' * DEEP}{']' * DEEP}", "line 1 (gravity = [[["),
    "arrays of 101": (f"gravity = {'[' * 101}{']' * 101}", "gravity"),
    "arrays on lines": ("duration = 1\ngravity = [\n" + "[\n" * DEEP, "line 2 (gravity = [)"),
    "inline tables": ("duration = 1\nhand = " + "{a = " * DEEP, "line 2 (hand = {a = {a"),
    "tables": (f"[hand{'.a' * 101}]\nb = 1", "line 1 ([hand.a.a"),
    "dotted": (f"[hand]\n{'.'.join('a' * DEEP)} = 1", "line 2 (a.a.a.a"),
    "quoted": ("[hand]\n" + ".".join(['"a"'] * DEEP) + " = 1", 'line 2 ("a"."a"'),
    "both": (f"[hand{'.a' * 60}]\n{'.'.join('b' * 60)} = 1", "hand.a.a.a.a ...: is nested deeper"),
    "text": ('text = "[[[["\n# [[[[\n' + "gravity = " + "[" * DEEP, "line 3 (gravity = [[["),
    "decimal": (f"duration = 1\ngravity = {'9' * 5000}", "line 2 (gravity = 999"),
    "hexadecimal": (f"[grasped]\nmass = 0x{'f' * 5000}", "grasped.mass: an integer has over 1000"),
    "thousands": (f"[grasped]\nmass = {'9' * 1200}", "grasped.mass: an integer has over 1000"),
    "in an array": (f"[schedule]\ntimes = [0, {'9' * 1200}]", "schedule.times.1: an integer has"),
    "hundreds": (f"[grasped]\nmass = {'9' * 500}", "GraspedObject.mass = 999"),
    "long name": (f"{'a' * MIB} = 1", "Scene.aaaaaa"),
    "long value": (f'fingers = "{"a" * MIB}"', "Scene.fingers = 'aaaaa"),
    "control characters": ('"a\\u001b[2J\\nb" = 1', "Scene.'a\\x1b[2J\\nb': unknown name"),
    "twice": ("gravity = 1\ngravity = 2", "Cannot overwrite a value (at end"),
    "table twice": ("[hand]\n[grasped]\n[hand]", "Cannot declare ('hand',) twice"),
    "nan": ("gravity = nan", "Scene.gravity = NaN: must be finite"),
    "inf": ("[hand.tip]\nradius = inf", "Fingertip.radius = inf: must be finite"),
    "date": ("gravity = 1979-05-27", "Scene.gravity = datetime.date(1979, 5, 27): must be"),
    "latin-1": ("# S\xfcd\ngravity = 1".encode("latin-1"), "line 1: is not UTF-8 text, byte 0xfc"),
    "utf-16": ("gravity = 1".encode("utf-16"), "line 1: is not UTF-8 text, byte 0xff"),
    "zeros": (bytes(1000), "Invalid statement (at line 1, column 1)"),
}  # fmt: skip
VARY = '[vary]\n"schedule.angles" = {kind = "scipy", name = '
STUDIES = {
    "runs": (f"[study]\nruns = {10**22}", "[study].runs = 10000000000000000000000: must be at"),
    "seed": (f"[study]\nseed = {10**22}", "[study].seed = 10000000000000000000000: must be"),
    "group": (VARY + '"special_ortho_group", kwds = {dim = 20_000}}',
              '[vary]."schedule.angles": special_ortho_group.dim = 20000: must be at most 1024'),
    "nested": (f"[study]\nruns = {'[' * DEEP}", "line 2 (runs = [[["),
    "kind": ("[vary]\ngravity = {kind = ['scipy']}", "Distribution.kind (in [vary].\"gravity\")"),
    "numbers": (f"[vary]\ngravity = [1, {'9' * 500}]", '[vary]."gravity" = [1, 999'),
    "array elsewhere": ('[vary]\ngravity = {kind = "array", file = "/dev/zero", sha256 = "0"}',
                        "[vary].\"gravity\": file = '/dev/zero': must be in the folder"),
    "array without a sum": ('[vary]\ngravity = {kind = "array", file = "a.npy"}',
                            '[vary]."gravity": sha256 is missing'),
    "array above": ('[vary]\ngravity = {kind = "array", file = "../a.npy", sha256 = "0"}',
                    "[vary].\"gravity\": file = '../a.npy': must be in the folder"),
    "endless scene": ('scene = "/dev/zero"', "scene: /dev/zero: has more than 64 MiB"),
    "no path": ('scene = "a\\u0000b"', "scene = 'a\\x00b': must be a table, or the name"),
    "broadcast": (f"[vary]\ngravity = {{kind = 'uniform', low = {[0.0] * 10_000}, "
                  f"high = {[[1.0]] * 10_000}}}", "Uniform: shapes must broadcast to at most"),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with every file."""
    for name, (data, _) in {**SCENES, **STUDIES}.items():
        (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    capsule = '[capsule]\nrun = 9999999999999999999999\nmessage = "'
    (tmp_path / "capsule").write_text(f'{capsule}{"[" * DEEP}"\n[simulate]\nx = {"[" * DEEP}')
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
    (folder / "dir").mkdir()
    os.mkfifo(folder / "pipe")
    said = {folder / name: text for name, (_, text) in SCENES.items()}
    said[folder / "large"] = "has more than 64 MiB"
    said[folder / "capsule"] = "line 5 (x = [[["
    said[folder / "dir"] = "Is a directory"
    said[folder / "pipe"] = "is a pipe that nothing was written into"
    said[folder / "nowhere"] = "No such file or directory"
    said[Path("/dev/zero")] = "has more than 64 MiB"
    asked = [(["run", str(path)], path, text) for path, text in said.items()]
    also = ("large", "pipe", "dir", "arrays", "decimal", "latin-1", "twice", "nowhere")
    asked += [
        (["montecarlo", str(folder / name), "--out", str(folder / "out")], folder / name, text)
        for name, text in {
            **{name: said[folder / name] for name in also},
            **{name: text for name, (_, text) in STUDIES.items()},
        }.items()
    ]
    asked += [(["montecarlo", "/dev/zero"], Path("/dev/zero"), "has more than 64 MiB")]
    found = commands([command for command, _, _ in asked])
    for (command, path, text), (code, err, error) in zip(asked, found, strict=True):
        assert (code, error) == (2, "SystemExit(2)"), (command, error, err)
        assert err.startswith(f"error: {path}: ") and text in err, (command, err)
        assert err.count("\n") == 1 and err[:-1].isprintable() and len(err) < 2100, command
    assert not (folder / "out").exists()


@pytest.mark.parametrize("name", SCENES)
def test_from_python_it_is_a_value_error_or_a_type_error(name: str, tmp_path: Path) -> None:
    data, text = SCENES[name]
    path = tmp_path / "scene.toml"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    with pytest.raises((ValueError, TypeError)) as error:
        sp.Scene.from_toml(path)
    assert text in str(error.value) and "\n" not in str(error.value)
    assert len(str(error.value)) < 1000
    if isinstance(data, str):
        with pytest.raises((ValueError, TypeError)) as error:
            sp.Scene.from_toml(data)
        assert text in str(error.value)


@pytest.mark.parametrize("read", [sp.Scene.from_toml, sp.Capsule.from_toml, study_file.read])
def test_endless_and_silent_files_end(read: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^/dev/zero: has more than 64 MiB$"):
        read(Path("/dev/zero"))
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(ValueError, match=r"pipe: is a pipe that nothing was written into$"):
        read(pipe)
    with pytest.raises(IsADirectoryError, match=str(tmp_path)):
        read(tmp_path)
    for odd, kind in ((None, TypeError), (5, TypeError), (b"", TypeError), (["a"], TypeError),
                      (Path("\ud800"), ValueError), (Path("a\0b"), ValueError)):  # fmt: skip
        with pytest.raises(kind, match=r"^(source|path) = .*: must be "):
            read(odd)


def test_text_has_the_same_bounds() -> None:
    with pytest.raises(ValueError, match=r"^source: has more than 64 MiB$"):
        sp.Scene.from_toml(" " * (64 * MIB + 1))
    with pytest.raises(ValueError, match="an integer has over 1000 digits"):
        sp.Capsule.from_toml("gravity = " + "9" * 5000)


def test_what_is_within_the_bounds_is_read(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbfduration = 2\r\n[grasped]\r\nmass = 1\r\n")
    assert sp.Scene.from_toml(path) == sp.Scene(duration=2, grasped=sp.GraspedObject(mass=1))
    # A name in quotes, a comment or text may have as many dots as it likes.
    dots = ".".join("a" * 1000)
    for text in (f"# {dots}\n", f'text = "{dots}"', f"'{dots}' = 1"):
        if text[0] == "#":
            assert sp.Scene.from_toml(f"{text}gravity = 3") == sp.Scene(gravity=3)
        else:
            with pytest.raises(ValueError, match="unknown name"):
                sp.Scene.from_toml(text)
    many = sp.Schedule.sampled(range(20_000), [[0.1, 0.1]] * 20_000)
    scene = sp.Scene(schedule=many)
    path.write_text(scene.to_toml(), encoding="utf-8")
    assert sp.Scene.from_toml(path) == scene


def test_a_pipe_that_is_written_into_late_is_read(tmp_path: Path) -> None:
    read, write = os.pipe()

    def late() -> None:
        time.sleep(0.2)
        os.write(write, b"duration = 2\n")
        time.sleep(0.1)
        os.write(write, b"gravity = 3\n")
        os.close(write)

    writer = threading.Thread(target=late)
    writer.start()
    try:
        assert sp.Scene.from_toml(Path(f"/dev/fd/{read}")) == sp.Scene(duration=2, gravity=3)
    finally:
        writer.join()
        os.close(read)


@pytest.mark.skipif(sys.platform == "win32", reason="has no such files")
def test_the_shell_reads_standard_input(tmp_path: Path) -> None:
    pytest.importorskip("typer")
    command = [sys.executable, "-m", "softpinch", "run", "/dev/stdin", "--dt", "1e-3"]
    text = sp.Scene(duration=0.01).to_toml()
    done = subprocess.run(command, input=text, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("completed: ")
