"""`softpinch run` of a capsule: as in the study, or how it differs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest

import ensembles
import softpinch as sp
from failing import KINDS, study
from softpinch import _core

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
from cli_calls import call
from softpinch.cli import commands

Write: TypeAlias = Callable[[sp.Capsule], Path]


@pytest.fixture
def file(tmp_path: Path) -> Write:
    """Writes a capsule."""

    def write(capsule: sp.Capsule) -> Path:
        path = tmp_path / "capsule.toml"
        path.write_text(capsule.to_toml(), encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("kind", ["noise", "state", "driven", "pairs", "too many steps"])
def test_the_shell_runs_a_capsule_as_in_the_study(kind: str, file: Write) -> None:
    capsule = study(kind).failures()[2]
    code, out, err = call("run", file(capsule))
    assert (code, err) == (1, "")
    every = 1 if "tolerance" in KINDS[kind][2] else 10
    run = study(kind).replay(2, every=every)
    how = f"run 2 {capsule.status} at t = {capsule.time!r} s"
    assert out.splitlines() == [*commands.summary(run), f"as in the study: {how}"]


def test_recording_does_not_change_the_run_of_a_capsule(file: Write, tmp_path: Path) -> None:
    capsule = ensembles.pushed().failures()[0]
    run = capsule.replay("state", every=3)
    code, out, err = call(
        "run", file(capsule), "--record", "state", "--every", 3, "--estimate-error", "--dt", 5e-4,
        "--out", tmp_path / "run.npz", "--plot", tmp_path / "run.svg",
    )  # fmt: skip
    assert (code, err) == (1, "")
    assert out.splitlines()[-1].startswith("as in the study: run 0 separated at t = ")
    assert any("estimated error" in line for line in out.splitlines())
    assert (tmp_path / "run.svg").stat().st_size > 1000
    with np.load(tmp_path / "run.npz") as saved:
        assert saved["q"].tobytes() == run.q.tobytes()


@pytest.mark.parametrize(
    ("kind", "options", "changed"),
    [
        ("mass", {"dt": 1e-3}, {}),
        ("mass", {"method": "dop853", "tolerance": 1e-5}, {"dt": None}),
        ("state", {"alpha": 500.0}, {"stabilization": sp.Stabilization(500.0, 700.0)}),
        ("too many steps", {"dt": 1e-3}, {"tolerance": None, "max_steps": None}),
    ],
    ids=str,
)
def test_options_replace_the_settings_of_a_capsule(
    kind: str, options: dict[str, Any], changed: dict[str, Any], file: Write
) -> None:
    capsule = study(kind).failures()[0]
    given = [text for name, value in options.items()
             for text in (f"--{name.replace('_', '-')}", value)]  # fmt: skip
    code, out, err = call("run", file(capsule), *given, "--every", 1)
    options = {name: value for name, value in options.items() if name not in ("alpha", "beta")}
    how = capsule.options.numerics() | options | changed
    run = sp.simulate(capsule.scene, **how, record=_core.RECORDABLE)
    assert (code, err) == (0 if run.success else 1, "")
    assert out.splitlines()[:-1] == commands.summary(run)
    ended = f"run 0 {capsule.status} at t = {capsule.time!r} s"
    assert out.splitlines()[-1] == f"other settings than in the study, where {ended}"


def test_a_run_that_differs_from_the_study_is_said_with_both(file: Write) -> None:
    capsule = study("mass").failures()[0]
    ended = f"separated at t = {capsule.time!r} s"
    code, out, _ = call("run", file(replace(capsule, status="crushed", time=0.01)))
    assert code == 1
    assert (
        out.splitlines()[-1]
        == f"differs from the study: run 0 crushed at t = 0.01 s there, {ended} here"
    )
    older = replace(capsule, results_version=capsule.results_version - 1)
    _, out, err = call("run", file(older))
    assert err == ""
    assert out.splitlines()[-2].startswith(
        f"the study's bits are those of results version {_core.RESULTS_VERSION - 1}, th"
    )
    assert out.splitlines()[-1] == f"as in the study: run 0 {ended}"


@pytest.mark.parametrize("text", ["[study]\nruns = 3", 'paper = "ii"', '[vary]\n"gravity" = [9.8]'])
def test_a_study_is_sent_to_its_own_command(text: str, tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    code, out, err = call("run", path)
    assert (code, out) == (2, "")
    assert err == f"error: {path}: is a study of many runs: compute it with softpinch montecarlo\n"
