"""Files name distributions of SciPy: what is let in, and that nothing else is called."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import softpinch as sp
from softpinch.study import study_file
from softpinch.study.spec import StudySpec

# Written out once more: a name that joins the list by accident is seen here.
MULTIVARIATE = {
    *("dirichlet", "invwishart", "matrix_normal", "multinomial", "multivariate_hypergeom"),
    *("multivariate_normal", "multivariate_t", "ortho_group", "special_ortho_group"),
    *("uniform_direction", "vonmises_fisher", "wishart"),
}
EVIL = 'kind = "scipy", name = "test", kwds = {extra_argv = ["--version"]}'


def of_one_number() -> set[str]:
    kinds = (stats.rv_continuous, stats.rv_discrete)
    return {name for name in dir(stats) if isinstance(getattr(stats, name), kinds)}


def read(folder: Path, entry: str, path: str = "grasped.mass") -> StudySpec:
    file = folder / "study.toml"
    file.write_text(f'[vary]\n"{path}" = {{{entry}}}\n', encoding="utf-8")
    return study_file.read(file)


def test_only_scipy_distributions_are_accepted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from softpinch.study import sources

    called: list[str] = []
    every = set(dir(stats))
    let_in = of_one_number() | MULTIVARIATE
    assert len(let_in) > 100 and {"norm", "gamma", "poisson"} <= let_in < every
    for name in every - let_in:
        if callable(getattr(stats, name)) and not isinstance(getattr(stats, name), type):
            monkeypatch.setattr(stats, name, lambda *a, name=name, **k: called.append(name))
    accepted = set()
    for name in every:
        try:
            sources.frozen_distribution("here", {"name": name})
            accepted.add(name)
        except ValueError as error:
            # Of those that are let in some need arguments.
            if "must be a distribution of scipy.stats" not in str(error):
                accepted.add(name)
    assert accepted == let_in
    assert set(sources.MULTIVARIATE) == MULTIVARIATE
    assert called == []


@pytest.mark.parametrize(
    "name",
    ["__init__", "distributions.norm", "_stats_py", "norm.rvs", "", 3, ["norm"], None],
)  # fmt: skip
def test_other_names_are_refused(name: Any) -> None:
    from softpinch.study import sources

    with pytest.raises(
        ValueError, match=r"^here: name = .*: must be a distribution of scipy\.stats"
    ):
        sources.frozen_distribution("here", {"name": name} if name is not None else {})


def test_a_study_file_runs_no_function_of_scipys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stats, "test", lambda *a, **k: pytest.fail("SciPy's tests were run"))
    with pytest.raises(
        ValueError, match=r'study\.toml: \[vary\]\."grasped\.mass": name = \'test\''
    ):
        read(tmp_path, EVIL)


BAD = [
    ('name = "gamm", args = [2]', 'did you mean "gamma"'),
    ('name = "norm", args = [0, 1, 2]', "SciPy cannot make norm: "),
    ('name = "norm", kwds = {size = 3}', "SciPy cannot make norm: "),
    ('name = "gamma"', "SciPy cannot make gamma"),
    ('name = "gamma", args = [-2]', "gamma(-2): is outside of the distribution's domain"),
    ('name = "gamma", args = ["2"]', "gamma.args[0] = '2': must hold numbers"),
    ('name = "gamma", args = [nan]', "gamma.args[0] = nan: must be numbers, and none of them NaN"),
    ('name = "gamma", args = [[1, [2]]]', "gamma.args[0] is ragged"),
    ('name = "gamma", args = 2', "args = 2: must be an array"),
    ('name = "uniform", args = [[1, 2], [1, 2, 3]]', "must broadcast"),
    ('name = "irwinhall", args = [100_000_000]', "irwinhall.args[0] = 100000000.0: must be"),
    ('name = "special_ortho_group", kwds = {dim = 1000}', "have shape (1000,), must have shape"),
    ('name = "uniform_direction", kwds = {dim = 2.5}', "SciPy cannot make uniform_direction: "),
]  # fmt: skip


@pytest.mark.parametrize(("entry", "message"), BAD, ids=[entry[7:] for entry, _ in BAD])
def test_arguments_are_numbers_for_its_parameters(entry: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError) as error:
        read(tmp_path, f'kind = "scipy", {entry}')
    text = str(error.value)
    assert text.startswith(f"{tmp_path / 'study.toml'}: ") and message in text, text
    assert '"grasped.mass"' in text and "\n" not in text


def test_arguments_that_make_huge_arrays_are_refused_before_they_are_made(tmp_path: Path) -> None:
    # Each is small, and what they broadcast to takes 80 GB.
    row, column = [1.0] * 100_000, [[1.0]] * 100_000
    entry = f'kind = "scipy", name = "uniform", args = [{row}, {column}]'
    with pytest.raises(ValueError, match="uniform has 10000000000 numbers: must be at most"):
        read(tmp_path, entry)
    mean = 'kind = "scipy", name = "multivariate_normal", kwds = {mean = ' + f"{[0.0] * 3000}}}"
    with pytest.raises(ValueError, match="multivariate_normal has 9000000 numbers: must be"):
        read(tmp_path, mean)


CASES: list[tuple[str, Any]] = [
    ("grasped.mass", stats.truncnorm(-2, math.inf, loc=0.1, scale=0.01)),
    ("grasped.mass", stats.gamma(a=100.0, scale=1e-3)),
    ("schedule.angles", stats.matrix_normal([[0.1, 0.1]], [[1e-4]], np.diag([1.0, 2.0]))),
    ("disturbances.0.force", stats.multivariate_normal([0.0, 1.0], [[2.0, 1.0], [1.0, 3.0]])),
    ("disturbances.0.force", stats.uniform_direction(2)),
]


@pytest.mark.parametrize(("path", "frozen"), CASES, ids=range(len(CASES)))
def test_distributions_of_a_manifest_draw_the_same_numbers(
    path: str, frozen: Any, tmp_path: Path
) -> None:
    pytest.importorskip("pyarrow")
    scene = sp.Scene(duration=2e-3, disturbances=[sp.Step(time=0.0)])
    how: dict[str, Any] = {"vary": {path: frozen}, "dt": 1e-3, "progress": False}
    study = sp.monte_carlo(scene, 3, store=tmp_path / "out", **how)
    again = study.extend(5, progress=False)
    np.testing.assert_array_equal(again[path], sp.monte_carlo(scene, 5, **how)[path])


def test_a_distribution_that_no_file_may_name_is_not_written_as_one(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    scene = sp.Scene(duration=2e-3)
    vary = {"schedule.angles": stats.random_table([1], [1, 0])}
    study = sp.monte_carlo(scene, 3, vary=vary, dt=1e-3, store=tmp_path / "out", progress=False)
    with pytest.raises(
        ValueError, match="which cannot be written to a file: call monte_carlo again"
    ):
        study.extend(5, progress=False)
