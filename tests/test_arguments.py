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

pytest.importorskip("matplotlib")


class Odd:
    """An object that no argument accepts."""


# What nothing takes, but the eigenvalue of a mode, which is complex.
NEVER: dict[str, Any] = {
    "object": Odd(),
    "objects": [Odd()],
    "complex": 1j,
    "masked": np.ma.masked_array([0.1, 0.2], [True, False]),
}
# What some take and others do not.
ODD: dict[str, Any] = {
    "None": None,
    "nan": float("nan"),
    "inf": float("inf"),
    "nans": np.full(3, np.nan),
    "negative": -1,
    "true": True,
    "empty text": "",
    "text": "x",
    "empty": [],
    "table": {},
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

    monkeypatch.setattr("softpinch.reproduce.experiment.computed", stop)
    monkeypatch.setattr("softpinch.reproduce.verdict._converges", stop)


def faults(name: str, parameter: str) -> Iterator[str]:
    """Yields the faults of the answers to wrong values of one parameter."""
    function, right = callables.called(name), callables.arguments(name)
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
        callables.called(name)(**callables.arguments(name))


def test_the_walk_meets_what_there_is() -> None:
    assert {"simulate", "plot.motion", "paper.disturbance", "Estimate.of", "Noise.samples"} <= {
        *NAMES
    }


def test_parameters_broadcast_to_what_fits_in_memory() -> None:
    low, high = np.zeros(10_000), np.ones((10_000, 1))
    with pytest.raises(ValueError, match=r"^Uniform: shapes must broadcast to at most 4194304 "):
        sp.Uniform(low, high)
