"""Without an extra, all else works, and what needs it says which in one line."""

import ast
import importlib
import re
import sys
import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

import softpinch as sp
from conftest import Hide
from ensembles import calm, pushed
from softpinch import paper, plot, reference
from softpinch.__main__ import main
from softpinch.reproduce import reproduce

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "python" / "softpinch"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {
    extra: {re.split(r"[\[<>=]", requirement)[0] for requirement in requirements}
    for extra, requirements in PROJECT["optional-dependencies"].items()
}
SCENE = sp.Scene(duration=0.02)


def one_line(extra: str, purpose: str = ".+") -> str:
    return rf"^softpinch's extra {extra} is needed for {purpose}: pip install '\.\[{extra}\]' in a "


@cache
def run() -> sp.Run:
    return sp.simulate(SCENE, record=("state", "multipliers", "residuals", "energy"))


def fitted() -> sp.Fit:
    data = {"y": run().q[::20, 1] + 1e-5}
    return sp.fit(SCENE, run().t[::20], data, {"gravity": (0.0, 20.0)}, noise=1e-5)


def linear() -> sp.LinearModel:
    return sp.linearize(SCENE, SCENE.start())


OTHERS: list[tuple[str, str, Callable[[], object]]] = [
    ("cli", "tomli_w", SCENE.to_toml),
    ("cli", "tomli_w", lambda: pushed().failures()[0].to_toml()),
    ("control", "control", lambda: linear().to_control()),
    ("gym", "gymnasium", lambda: importlib.import_module("softpinch.gym")),
    ("jax", "jax", lambda: importlib.import_module("softpinch.jax")),
    ("plot", "matplotlib", lambda: reproduce(Path("nowhere"))),
    ("plot", "matplotlib", lambda: plot.motion(run())),
    ("study", "scipy", fitted),
    ("study", "pandas", lambda: calm().to_pandas()),
    ("study", "xarray", lambda: calm().to_xarray()),
    ("study", "scipy", lambda: reference.solve(SCENE)),
    ("study", "scipy", lambda: linear().to_scipy()),
    ("study", "scipy", lambda: sp.work_precision(SCENE, progress=False)),
    ("study", "scipy", lambda: sp.monte_carlo(SCENE, 2, sampler="sobol", progress=False,
                                              vary={"grasped.mass": sp.Uniform(0.1, 0.2)})),
    ("study", "pyarrow", lambda: sp.monte_carlo(SCENE, 2, store="nowhere", progress=False)),
    ("study", "tomli_w", lambda: sp.monte_carlo(SCENE, 2, store="nowhere", progress=False)),
    ("study", "pyarrow", lambda: sp.Study.open("nowhere")),
    ("testing", "hypothesis", lambda: importlib.import_module("softpinch.strategies")),
]  # fmt: skip


@pytest.mark.parametrize(("extra", "module", "use"), OTHERS)
def test_what_needs_a_module_names_the_extra_that_brings_it(
    extra: str,
    module: str,
    use: Callable[[], object],
    without: Hide,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for room in ("strategies", "gym", "jax"):
        monkeypatch.delitem(sys.modules, f"softpinch.{room}", raising=False)
    without(module)
    with pytest.raises(ImportError, match=one_line(extra)) as raised:
        use()
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("extra", "module", "arguments"),
    [
        ("plot", "matplotlib", ["run", "{scene}", "--plot", "{out}/run.png"]),
        ("study", "scipy", ["fit", "{fit}", "{data}", "--out", "{out}"]),
        ("cli", "tomli_w", ["fit", "{fit}", "{data}", "--out", "{out}"]),
        ("study", "pyarrow", ["montecarlo", "{study}", "--out", "{out}"]),
        ("dask", "dask", ["montecarlo", "{study}", "--out", "{out}", "--dask", "tcp://x"]),
    ],
)
def test_a_command_names_the_extra_in_one_line(
    extra: str,
    module: str,
    arguments: list[str],
    without: Hide,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    examples = ROOT / "examples"
    data = tmp_path_factory.mktemp("data") / "motion.csv"
    data.write_text("t,x,y,theta\n0.1,0.0,0.074,0.0\n", encoding="utf-8")
    places = {
        "scene": examples / "scenes" / "pinch.toml",
        "study": examples / "studies" / "disturbance_ii.toml",
        "fit": examples / "studies" / "fit.toml",
        "data": data,
        "out": tmp_path,
    }
    monkeypatch.setattr(sys, "argv", ["softpinch", *(part.format(**places) for part in arguments)])
    without(module)
    with pytest.raises(SystemExit) as ended:
        main()
    out, err = capsys.readouterr()
    assert ended.value.code == 1
    assert out == ""
    assert re.match(one_line(extra), err) and err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def parsed() -> Iterator[ast.AST]:
    """Every piece of the package's source."""
    for file in PACKAGE.rglob("*.py"):
        yield from ast.walk(ast.parse(file.read_text(encoding="utf-8")))


def distribution(module: str) -> str:
    return module.partition(".")[0].replace("_", "-")


def test_extras_bring_what_is_asked_of_them() -> None:
    asked = 0
    for node in parsed():
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("require"):
            extra = {word.arg: word.value for word in node.keywords}["extra"]
            assert isinstance(extra, ast.Constant)
            # `__main__` asks for several, one after the other.
            if isinstance(node.args[0], ast.Constant):
                assert distribution(node.args[0].value) in EXTRAS[extra.value]
                asked += 1
    assert asked > 10


def test_all_that_is_imported_is_declared() -> None:
    known = {*sys.stdlib_module_names, "numpy", "softpinch"}
    for node in parsed():
        modules = []
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            modules = [node.module or ""]
        for module in modules:
            assert module.partition(".")[0] in known or distribution(module) in EXTRAS["all"]


def test_all_is_the_other_extras_together() -> None:
    listed = PROJECT["optional-dependencies"]
    others = {each for extra in listed if extra != "all" for each in listed[extra]}
    assert set(listed) == {
        *("plot", "cli", "study", "dask", "gym", "jax", "control", "testing", "all")
    }
    assert sorted(listed["all"]) == sorted(others)
    assert set(listed["plot"]) < set(listed["cli"])  # its commands draw


def test_paper_scenes_need_no_extra(without: Hide) -> None:
    for package in {"matplotlib", "typer", "rich", "tomli_w", "pandas", "xarray", "scipy"}:
        without(package)
    sp.simulate(paper.manipulation(duration=0.1)).check()
    assert sp.monte_carlo(SCENE, 8, vary={"grasped.mass": sp.Normal(0.1, 0.01)},
                          progress=False).probability("completed").value == 1.0  # fmt: skip
