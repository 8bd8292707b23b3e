"""Results: read-only, compared by value, and so are copies of them, pickled ones too."""

import copy
import inspect
import pickle
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import callables
import softpinch as sp
from softpinch.accuracy import advisor, reference
from softpinch.run.options import Options
from softpinch.support.result import Result

COPIES: dict[str, Callable[[Any], Any]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda result: pickle.loads(pickle.dumps(result)),
}


@cache
def results() -> dict[str, Any]:
    """One of each kind that is a dataclass, by its class's name; some arrays hold NaN."""
    scene = callables.SCENE
    run = sp.simulate(
        scene, tolerance=1e-3, times=[0.001], method="dop853", record=sp._core.RECORDABLE
    )
    estimated = sp.simulate(scene, 1e-3, record=("state", "multipliers"), estimate_error=True)
    checked = sp.monte_carlo(
        scene,
        vary={"grasped.mass": np.linspace(0.09, 0.11, 4)},
        dt=1e-3,
        check_dt=True,
        progress=False,
    )
    evaluation = sp.evaluate(scene, 0.0, run.q[0], run.p[0])
    modes = callables.modes()
    advised = sp.advise(scene, 1e-3, **callables.PAIR)
    rest = sp.equilibrium(scene)
    rare = sp.rare_event(scene, **callables.RARE)
    every: list[Any] = [
        rest,
        callables.equilibria(),
        callables.fitted(),
        sp.fit_law(**callables.CURVE),
        callables.differentiated().sensitivity.at(1),
        sp.grip(scene, 5.0),
        sp.carry_limits(rest, [[1.0, 0.0]]),
        sp.wrench_limits(rest, [[1.0, 0.0, 0.0]]),
        sp.linearize(scene, rest),
        sp.loop(callables.SAMPLED),
        advised,
        advised.trials[0],
        callables.precision(),
        callables.precision().rows[0],
        callables.stability(),
        callables.sweep(),
        checked.discretisation["final_state"],  # type: ignore[index]
        sp.compare(checked, checked),
        rare,
        rare.levels[0],
        estimated.error_estimate,
        evaluation,
        evaluation.energies,
        evaluation.forces,
        reference.solve(scene),
        replace(modes, rates=modes.rates * np.nan),
        run._options,
        run.energy,
        sp.explain(scene, measure=False),
        sp.explain(scene, measure=False).terms[0],
        sp.max_stable_dt(scene, measure=False),
    ]
    return {type(each).__name__: each for each in every}


PUBLIC = [v for n in sp.__all__ if inspect.isclass(v := getattr(sp, n)) and issubclass(v, Result)]
KINDS = [cls.__name__ for cls in (*PUBLIC, Options, advisor.Trial, reference.Reference)]


def arrays(value: Any) -> Iterator[np.ndarray]:
    if isinstance(value, np.ndarray):
        yield value
    elif is_dataclass(value):
        for field in fields(value):
            yield from arrays(getattr(value, field.name))


def test_there_is_one_of_each_kind() -> None:
    assert set(results()) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("how", COPIES)
def test_a_copy_is_equal_and_read_only(kind: str, how: str) -> None:
    result = results()[kind]
    again = COPIES[how](result)
    assert again is not result
    assert again == result
    assert hash(again) == hash(result)
    for one in (result, again):
        assert not any(array.flags.writeable for array in arrays(one))


@pytest.mark.parametrize("kind", KINDS)
def test_what_differs_in_one_number_is_another(kind: str) -> None:
    result = results()[kind]
    assert result != 3
    changed = 0
    for field in fields(result):
        value = getattr(result, field.name)
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            other: Any = np.where(np.isnan(value), 1.0, np.nan)
        elif isinstance(value, str):
            other = f"{value}?"
        elif isinstance(value, float):
            other = value + 1.0 if value == value else 1.0
        else:
            continue
        if np.size(value) and not np.array_equal(other, value):
            assert replace(result, **{field.name: other}) != result, field.name
            changed += 1
    assert changed
