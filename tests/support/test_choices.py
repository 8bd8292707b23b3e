"""The types of choices have the names of the tables that the package checks against."""

from typing import Any, get_args

import pytest

import softpinch as sp
from softpinch import _core
from softpinch.run.options import STOP_ON
from softpinch.scene.control import JITTERS
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
    choices.Jitter: JITTERS,
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
