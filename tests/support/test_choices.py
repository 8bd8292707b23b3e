"""The types of choices have the names of the tables that the package checks against."""

import inspect
import re
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

import callables
import softpinch as sp
from softpinch import _core
from softpinch.run.options import STOP_ON
from softpinch.scene.schedule import HOLDS, KINDS
from softpinch.support import choices

TABLES: dict[Any, tuple[str, ...]] = {
    choices.Method: _core.METHODS,
    choices.Formulation: _core.FORMULATIONS,
    choices.ContactModel: _core.CONTACT_MODELS,
    choices.Recordable: _core.RECORDABLE,
    choices.Violation: _core.VIOLATIONS,
    # The core has the final state beside the numbers that it folds.
    choices.Summary: ("final_state", *_core.SUMMARIES),
    choices.ScheduleKind: KINDS,
    choices.Hold: HOLDS,
}


@pytest.mark.parametrize("choice", TABLES, ids=lambda choice: get_args(choice)[0])
def test_a_type_has_the_names_of_its_table(choice: Any) -> None:
    assert get_args(choice) == tuple(TABLES[choice])


REFUSALS: dict[Any, Any] = {
    choices.Fingers: lambda name: sp.Scene(fingers=name),
    choices.Sampler: lambda name: sp.monte_carlo(
        sp.Scene(duration=1e-3), 2, vary={"gravity": sp.Normal(9.8, 0.1)}, sampler=name, dt=1e-3
    ),
}


@pytest.mark.parametrize("choice", REFUSALS, ids=lambda choice: get_args(choice)[0])
def test_names_without_a_table_are_those_of_the_error(choice: Any) -> None:
    with pytest.raises(ValueError, match="must be one of") as error:
        REFUSALS[choice]("another")
    listed = str(error.value).partition("must be one of ")[2].split(", ")
    assert tuple(name.strip('"') for name in listed) == get_args(choice)


def test_every_type_is_compared() -> None:
    named = {v for name, v in vars(choices).items() if name[0].isupper() and get_args(v)}
    assert named == {*TABLES, *REFUSALS}
    assert set(STOP_ON) <= set(get_args(choices.Violation))


def test_the_signatures_have_them() -> None:
    assert get_type_hints(sp.simulate)["method"] is choices.Method
    assert get_type_hints(sp.simulate)["formulation"] is choices.Formulation
    assert get_type_hints(sp.Schedule.sampled)["hold"] is choices.Hold


def test_mypy_reads_the_uses() -> None:
    makefile = Path(__file__).parents[2] / "Makefile"
    assert "typed_uses.py" in makefile.read_text("utf-8")


# Argument -> the type in its annotation.
CHOSEN = {
    "method": "Method",
    "methods": "Method",
    "formulation": "Formulation",
    "formulations": "Formulation",
    "sampler": "Sampler",
    "stop_on": "Violation",
    "record": "Recordable",
    "hold": "Hold",
}


def test_every_public_function_has_them() -> None:
    """Not `softpinch.reference`, whose methods are SciPy's."""
    found = [
        (name, parameter, callables.called(name))
        for name in callables.public()
        if not name.startswith("reference.")
        for parameter in callables.parameters(name)
        if parameter in CHOSEN
    ]
    asked = {name for name, *_ in found}
    assert {"advise", "work_precision", "max_stable_dt", "stabilization_sweep", "modes"} <= asked
    wrong = []
    for name, parameter, function in found:
        if name.startswith("Simulator."):
            function = getattr(sp.Simulator, name.partition(".")[2])  # the test's is derived
        # Not evaluated, because the types of some other arguments are imported for checkers only.
        hint = str(inspect.signature(function).parameters[parameter].annotation)
        if not re.search(rf"\b{CHOSEN[parameter]}\b", hint):
            wrong.append(f"{name}({parameter}: {hint})")
    assert not wrong, wrong
