"""Every public callable refuses a wrong argument with a clear error: it is walked, not listed.

What is new is asked too: a callable that needs arguments and has none in `callables` fails here.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

import callables
import softpinch as sp
from softpinch.study.sampling import Plan

pytest.importorskip("matplotlib")


class Odd:
    """Of no kind that anything takes."""


# What nothing takes, but the eigenvalue of a mode, which is complex.
NEVER: dict[str, Any] = {
    "object": Odd(),
    "complex": 1j,
    "complex array": np.array([1j, 2j]),
    "objects": [Odd()],
    "masked": np.ma.masked_array([0.1, 0.2], [True, False]),
    "masked in a list": [np.ma.masked_array([0.1, 0.2], [True, False])] * 2,
    "masked number": np.ma.masked,
}
# What some take and others do not.
ODD: dict[str, Any] = {
    "None": None,
    "nan": float("nan"),
    "inf": float("inf"),
    "nans": np.full(3, np.nan),
    "huge": 10**400,
    "large": 2**70,
    "negative": -1,
    "true": True,
    "empty text": "",
    "text": "x",
    "bytes": b"x",
    "empty": [],
    "table": {},
    "set": {Odd},
    "of None": (None,),
}
# Asked for by name or number, where what is not there is a KeyError or IndexError.
LOOKED_UP = {"run", "k", "name"}
NAMES = list(callables.public())


class Reached(Exception):
    """An argument has passed every check."""


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that takes seconds is computed."""

    def stop(*_: object, **__: object) -> None:
        raise Reached

    monkeypatch.setattr("softpinch.reproduce.experiment.simulate", stop)
    monkeypatch.setattr("softpinch.reproduce.verdict.converges", stop)


def faults(name: str, parameter: str) -> Iterator[str]:
    """Yields the faults of the answers to wrong values of one parameter."""
    function, right = callables.called(name), callables.arguments().get(name, {})
    for kind, value in (NEVER | ODD).items():
        if kind == "text" and parameter in ("path", "store", "out"):
            continue  # any text is a path
        try:
            with warnings.catch_warnings():
                # A warning that is made an error would hide what comes of the value.
                warnings.simplefilter("ignore")
                function(**{**right, parameter: value})
        except Reached:
            taken = True
        except (ValueError, TypeError, IndexError, KeyError) as error:
            taken = False
            lookup = isinstance(error, IndexError | KeyError)
            # A table is named by what it is to become: "Scene = 3: must be a table".
            asked = name.partition(".")[0] if parameter == "data" else parameter
            if parameter == "source" and kind == "empty text":  # a file that says nothing
                asked = name.partition(".")[0]
            if lookup and parameter not in LOOKED_UP:
                yield f"{kind}: {type(error).__name__}: {error}"
            elif not re.search(rf"\b{asked}\b", str(error)):
                yield f"{kind}: the error does not name it: {error}"
        except Exception as error:
            taken = False
            yield f"{kind}: {type(error).__name__}: {error}"
        else:
            taken = True
        if taken and kind in NEVER and (name, parameter) != ("Modes.leading", "rate"):
            yield f"{kind}: is taken"


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("name", "parameter"),
    [(name, each) for name in NAMES for each in callables.parameters(name)],
)
def test_every_wrong_argument_is_refused_by_its_name(name: str, parameter: str) -> None:
    assert not list(faults(name, parameter))


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", [name for name in NAMES if callables.parameters(name)])
def test_the_right_arguments_are_taken(name: str) -> None:
    """Else the test above would find every value refused for another reason."""
    with suppress(Reached):
        callables.called(name)(**callables.arguments().get(name, {}))


def test_the_walk_meets_what_there_is() -> None:
    assert {"simulate", "plot.motion", "paper.disturbance", "Estimate.of", "Noise.samples"} <= {
        *NAMES
    }
    assert set(sp.__all__) >= callables.RESULTS


@pytest.mark.parametrize(
    "distribution",
    [sp.Normal(0, 1), sp.Uniform(0, 1), sp.LogNormal(1, 1), sp.Choice([1.0]), sp.LogUniform(1, 2)],
    ids=lambda each: type(each).__name__,
)
def test_samples_come_from_a_generator(distribution: sp.Distribution) -> None:
    rng = np.random.default_rng(1)
    for wrong in (None, 5, np.random, np.random.RandomState(1), np.random.default_rng):
        with pytest.raises(TypeError, match=r"^rng = .*: must be a Generator$"):
            distribution.sample(wrong, 3)  # type: ignore[arg-type]
    for n, error in ((2.0, TypeError), (None, TypeError), (True, TypeError), (-1, ValueError),
                     (2**63, ValueError)):  # fmt: skip
        with pytest.raises(error, match=r"^n = .*: must be "):
            distribution.sample(rng, n)  # type: ignore[arg-type]
    assert distribution.sample(rng, np.int64(3)).shape == (3,)
    with pytest.raises(ValueError, match=r"^u is ragged"):
        distribution.ppf([[0.1], [0.1, 0.2]])  # type: ignore[list-item]


def test_parameters_broadcast_to_what_fits_in_memory() -> None:
    low, high = np.zeros(10_000), np.ones((10_000, 1))
    with pytest.raises(ValueError, match=r"^Uniform: shapes must broadcast to at most 4194304 "):
        sp.Uniform(low, high)


def test_more_runs_than_any_memory_holds_are_refused() -> None:
    vary = {"gravity": sp.Normal(9.8, 0.1)}
    for runs, sampler, message in (
        (10**22, "random", r"^runs = 10{22}: must be at most 4611686018427387904$"),
        (2**62, "random", r"^runs = 4611686018427387904: must be at most [0-9]+ in memory"),
        (2**62, "latin_hypercube", "^runs = 4611686018427387904: must be at most"),
    ):
        with pytest.raises(ValueError, match=message):
            sp.monte_carlo(callables.SCENE, runs, vary=vary, sampler=sampler, progress=False)
    many = Plan(vary, 2**60, 0, "latin_hypercube", shapes={"gravity": ()})
    with pytest.raises(ValueError, match=rf"^runs = {2**60}: too many for a Latin hypercube"):
        many.draw(0)


@pytest.mark.parametrize("made", [sp.Scene, sp.Capsule])
def test_a_text_that_is_no_toml_is_named(made: Any) -> None:
    with pytest.raises(ValueError, match=r"^source: Expected '='"):
        made.from_toml("csm")
