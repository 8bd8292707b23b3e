"""`softpinch work-precision` and `softpinch advise`."""

from pathlib import Path

import pytest

import softpinch as sp
from cli_calls import call
from softpinch import stress
from softpinch.accuracy import precision
from softpinch.run.request import Request


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(sp.Scene(duration=0.03).to_toml(), encoding="utf-8")
    return path


def test_work_precision_leaves_a_table_and_a_figure(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, text, err = call(
        *("work-precision", scene, "--out", out, "--methods", "rk4,dop853"),
        *("--formulations", "nullspace", "--dt", 1e-4, 1e-3, 3),
    )
    assert (code, err) == (0, "")
    assert "confirmed by" in text
    assert "error along the run below 1e-06, the quickest first" in text
    assert sorted(path.name for path in out.iterdir()) == [
        "work_precision.csv",
        "work_precision.png",
    ]


def test_the_error_at_the_end_comes_with_the_one_along_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def by_steps(request: Request, repeats: int) -> list[float]:
        """In place of the clock, which a busy machine delays."""
        return [1e-7 / float(request.options.dt or 1.0)] * repeats

    monkeypatch.setattr(precision, "cpu_times", by_steps)
    path = tmp_path / "scene.toml"
    path.write_text(sp.Scene(duration=0.6).to_toml(), encoding="utf-8")
    code, text, err = call(
        *("work-precision", path, "--out", tmp_path, "--methods", "rk4", "--where", "end"),
        *("--formulations", "nullspace", "--dt", 6e-4, 1.2e-3, 2),
    )
    assert (code, err) == (0, "")
    best = text[text.index("error at the end below 1e-06, the quickest first") :].splitlines()[1]
    assert "1.20e-03" in best
    assert float(best.rsplit(" ", 1)[1]) > 1e-2 and "error along the run" in best
    assert "the motion has settled: 2 of 2 settings have an error along the run more" in text


def test_advise_prints_formulation_and_method(scene: Path) -> None:
    code, text, err = call("advise", scene, "--tolerance", 1e-5)
    assert (code, err) == (0, "")
    assert text.startswith('take formulation="')
    assert "(whole scene)" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("work-precision", "--methods", "euler"), "euler"),
        (("work-precision", "--where", "middle"), "--where = 'middle': must be one of"),
        (("work-precision", "--formulations", "nullspace", "--alpha", "3"), "has no gains"),
        (("advise", "--tolerance", "0"), "tolerance = 0.0"),
    ],
)
def test_bad_input_is_one_line(scene: Path, words: tuple[str, ...], message: str) -> None:
    code, text, err = call(words[0], scene, *words[1:])
    assert (code, text) == (2, "")
    assert message in err
    assert err.startswith("error: ") and err.count("\n") == 1


def test_a_lost_grasp_has_no_reference(tmp_path: Path) -> None:
    lost = tmp_path / "lost.toml"
    text = stress.CASES["thrown_out"].scene.to_toml().replace("duration = 0.1", "duration = 1.0")
    lost.write_text(text, encoding="utf-8")
    code, text, err = call("work-precision", lost, "--methods", "rk4", "--out", tmp_path / "o")
    assert code == 1
    assert "no reference" in err
