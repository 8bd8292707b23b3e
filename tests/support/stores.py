"""Studies in folders: scenes over in an instant, and what two tables must have in common."""

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import softpinch as sp
from softpinch import _core
from softpinch.study.sampling import BLOCK

SUMMARIES = ("final_state", *_core.SUMMARIES)
# Some are lost at once, some later, some slip: every kind of column has values and nulls.
SCENE = sp.Scene(
    disturbances=[
        sp.Impulse(time=0.002),
        sp.Step(time=0.003, force=(2.0, -1.0), moment=0.01),
        sp.Noise(force_std=1.0, moment_std=0.01, rate_hz=400.0),
    ],
    friction=0.3,
    duration=0.01,
)
PUSH = "disturbances.0.impulse.0"
PUSHED = {PUSH: sp.Choice([0.0, 0.5, 50.0], weights=[0.6, 0.2, 0.2])}
RUNS = 2500
MASSES = np.random.default_rng(1).uniform(0.09, 0.11, RUNS)
TOGETHER = ("control.kp", "disturbances.1.force")


def stiffness(rng: np.random.Generator) -> tuple[float, NDArray[np.float64]]:
    """Takes more numbers for some runs than for others."""
    kp = 100.0 * math.exp(0.1 * rng.normal())
    return kp, rng.normal(size=2) if kp > 100.0 else np.array([kp / 100.0, rng.normal()])


COVARIANCE = [[4.0, 1.0, 0.5], [1.0, 2.0, 0.3], [0.5, 0.3, 1.0]]
# What differs -> how it is drawn, and with which sampler.
KINDS: dict[str, tuple[dict[Any, Any], str]] = {
    "ours": (
        {
            **PUSHED,
            "grasped.mass": sp.Normal(0.1, 0.01),
            "disturbances.1.force": sp.Uniform((-2.0, -2.0), (2.0, 2.0)),
            "hand.tip.youngs_modulus": sp.LogUniform(2e5, 4e5),
            "friction": sp.TruncatedNormal(0.3, 0.1, 0.05, 0.6),
        },
        "random",
    ),
    "sobol": ({**PUSHED, "grasped.mass": stats.gamma(100.0, scale=1e-3)}, "sobol"),
    "latin": ({**PUSHED, "control.kp": sp.LogNormal(4.6, 0.1)}, "latin_hypercube"),
    "scipy": (
        {
            **PUSHED,
            "grasped.mass": stats.truncnorm(-2, 2, loc=0.1, scale=0.01),
            TOGETHER: stats.multivariate_normal([100.0, 1.0, -1.0], COVARIANCE),
        },
        "random",
    ),
    "arrays": (
        {
            **PUSHED,
            "grasped.mass": MASSES,
            "disturbances.1.force": np.stack([MASSES, -MASSES], axis=1),
            ("control.kp", "control.kd"): np.stack([1e3 * MASSES, 10 * MASSES], axis=1).tolist(),
        },
        "random",
    ),
    "functions": (
        {
            **PUSHED,
            "grasped.mass": lambda rng: rng.normal(0.1, 0.01),
            TOGETHER: stiffness,
        },
        "random",
    ),
    "nothing": ({}, "random"),
}  # fmt: skip


def compute(kind: str, runs: int = RUNS, **how: Any) -> Any:
    """A study of one of the kinds, in memory or in a folder."""
    vary, sampler = KINDS[kind]
    given: dict[str, Any] = {"dt": 1e-3, "seed": 2**64 - 5, "progress": False, **how}
    return sp.monte_carlo(
        SCENE, runs, vary=vary, sampler=sampler, summaries=SUMMARIES, settling_band=0.1, **given
    )


TINY = 3 * BLOCK
TINY_SCENE = sp.Scene(disturbances=[sp.Impulse(time=0.0)], duration=2e-3)
TINY_VARY = {PUSH: sp.Choice([0.0, 50.0], weights=[0.7, 0.3]), "grasped.mass": sp.Normal(0.1, 0.01)}


@cache
def in_memory(kind: str) -> sp.Ensemble:
    ensemble: sp.Ensemble = compute(kind)
    return ensemble


def tiny(store: str | Path | None = None, runs: int | None = TINY, **how: Any) -> Any:
    """A study of the shortest runs, in blocks that are done in milliseconds."""
    given: dict[str, Any] = {
        "scene": TINY_SCENE,
        "vary": TINY_VARY,
        "dt": 1e-3,
        "seed": 3,
        "progress": False,
        **how,
    }
    return sp.monte_carlo(runs=runs, store=store, **given)


def require_same(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> None:
    """Equal columns, to the bit; NaN is NaN."""
    assert list(ours) == list(theirs)
    for name, expected in theirs.items():
        found = ours[name]
        assert (found.dtype, found.shape) == (expected.dtype, expected.shape), name
        if expected.dtype.kind != "f":
            np.testing.assert_array_equal(found, expected, err_msg=name)
            continue
        nan = np.isnan(expected)
        np.testing.assert_array_equal(np.isnan(found), nan, err_msg=name)
        np.testing.assert_array_equal(
            found[~nan].view(np.uint64), expected[~nan].view(np.uint64), err_msg=name
        )


def files(folder: Path) -> dict[str, bytes]:
    """All files in a folder but the lock's, by their paths in it."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "lock"
    }


def parts(folder: Path) -> list[Path]:
    """The part files of a study."""
    return sorted((folder / "parts").iterdir())


@cache
def tiny_in_memory() -> sp.Ensemble:
    """The study `tiny` without a store."""
    ensemble: sp.Ensemble = tiny()
    return ensemble


def require_whole(path: Path) -> None:
    """The table is that of a `tiny` study that nothing happened to; every part is as listed."""
    whole = sp.Study.open(path)
    whole.verify()
    assert whole.complete
    require_same(whole.to_dict(), tiny_in_memory().to_dict())


def resume(path: Path) -> sp.Study:
    return sp.Study.open(path).resume(progress=False)


def edit(path: Path, old: str, new: str) -> None:
    """Changes a text file."""
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
