"""Bad input: every rule, and the field's name, the value and the rule in its message."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch import _core, paper, strategies

NAN, INF = float("nan"), float("inf")
ANGLES = [[0.1, 0.1], [0.2, 0.2]]
RECORDS: dict[str, Any] = {
    "Finger": sp.Finger,
    "Fingertip": sp.Fingertip,
    "GraspedObject": sp.GraspedObject,
    "Pid": sp.Pid,
    "Stabilization": sp.Stabilization,
    "Scene": sp.Scene,
}
FIELDS = [(record, field, rule) for record, f in _core.RULES.items() for field, rule in f.items()]


def test_every_record_with_rules_is_tested_and_every_number_has_a_rule() -> None:
    assert set(RECORDS) == set(_core.RULES)
    for name in ("Finger", "Fingertip", "GraspedObject", "Pid", "Stabilization"):
        assert {f.name for f in fields(RECORDS[name])} == set(_core.RULES[name])


@pytest.mark.parametrize(("record", "field", "rule"), FIELDS)
def test_each_number_keeps_its_rule(record: str, field: str, rule: str) -> None:
    wrong = [NAN, -INF]
    if "finite" in rule:
        wrong.append(INF)
    if "> 0" in rule:
        wrong += [0.0, -0.0, -1e-300, -1.0]
    if ">= 0" in rule:
        wrong += [-5e-324, -1.0]
    for value in wrong:
        with pytest.raises(ValueError) as caught:
            RECORDS[record](**{field: value})
        assert str(caught.value).startswith(f"{record}.{field} = ")
        assert str(caught.value).endswith(rule)
    right = [1.0, 1e-300, 1e300] if record != "Scene" else [1.0]
    if ">= 0" in rule or rule == "must be finite":
        right.append(0.0)
    if rule == "must be finite":
        right.append(-1.0)
    for value in right:
        assert getattr(RECORDS[record](**{field: value}), field) == value


@pytest.mark.parametrize(("record", "field", "rule"), FIELDS)
@pytest.mark.parametrize("value", ["1.0", b"1", True, [1.0], np.ones(1), 1j, {}, [[1], [1, 2]]])
def test_each_number_is_a_number(record: str, field: str, rule: str, value: Any) -> None:
    with pytest.raises(TypeError, match=rf"^{record}\.{field} = .*: must be a number$"):
        RECORDS[record](**{field: value})


def test_what_is_too_large_for_a_float_is_not_finite() -> None:
    with pytest.raises(ValueError, match=r"Finger\.length = 1000.*must be finite"):
        sp.Finger(length=10**400)
    with pytest.raises(ValueError, match=r"State\.q.*must be finite"):
        sp.State([10**400] * 9)


def test_none_is_only_where_it_is_the_default() -> None:
    assert sp.Fingertip(normal_mass=None).normal_mass is None
    with pytest.raises(TypeError, match=r"Finger\.length = None: must be a number"):
        sp.Finger(length=None)  # type: ignore[arg-type]


def steps(times: Any, angles: Any) -> Any:
    return sp.Schedule.steps(times, angles)


def moves(times: Any, move_time: Any) -> Any:
    return sp.Schedule.minimum_jerk(times, np.arange(2.0 * len(times)).reshape(-1, 2), move_time)


def touching(**changes: Any) -> Any:
    return sp.simulate(sp.Scene(**changes))


REFUSED: list[tuple[Callable[[], Any], str]] = [
    # Schedules.
    (lambda: steps([0, 1, 1], ANGLES + ANGLES[:1]), r"Schedule\.times\[2\] = 1\.0: .*greater"),
    (lambda: steps([1, 0], ANGLES), r"Schedule\.times\[1\] = 0\.0: .* before it, 1\.0"),
    (lambda: steps([0, NAN], ANGLES), r"Schedule\.times\[1\] = nan: must be finite"),
    (lambda: steps([0, INF], ANGLES), r"Schedule\.times\[1\] = inf: must be finite"),
    (lambda: steps([], np.zeros((0, 2))), r"Schedule\.times has shape \(0,\): .* \(k,\)"),
    (lambda: steps(0.0, ANGLES), r"Schedule\.times has shape \(\)"),
    (lambda: steps([0], [[0, INF]]), r"Schedule\.angles\[0, 1\] = inf: must be finite"),
    (lambda: steps([0], [0, 0]), r"Schedule\.angles has shape \(2,\): must have shape \(k, 2\)"),
    (lambda: steps([0], [[0, 0, 0]]), r"Schedule\.angles has shape \(1, 3\)"),
    (lambda: steps([0], ANGLES), r"Schedule\.angles has 2 rows: .* Schedule\.times, 1"),
    (lambda: steps([0, 1], [[0, 0], [1]]), r"Schedule\.angles is ragged"),
    (lambda: steps([0], [["a", "b"]]), r"Schedule\.angles = .* must hold numbers"),
    (lambda: steps(["0"], [[0, 0]]), r"Schedule\.times = .* must hold numbers"),
    (lambda: steps([0], [[None, 0]]), r"Schedule\.angles = .* must hold numbers"),
    (lambda: sp.Schedule.sampled([0], [[0, 0]], hold="cubic"), r"Schedule\.hold = 'cubic': .*zero"),
    (lambda: moves([0, 1], 0.0), r"Schedule\.move_time = 0\.0: must be finite and > 0"),
    (lambda: moves([0, 1], INF), r"Schedule\.move_time = inf: must be finite and > 0"),
    (lambda: moves([0, 1], "1"), r"Schedule\.move_time = '1': must be a number"),
    (lambda: moves([0, 1, 2], 1.01), r"Schedule\.move_time = 1\.01: .* overlap, times\[2\]"),
    (lambda: moves([0, 1], 1e-17), r"Schedule\.move_time = 1e-17: .* later than it starts"),
    (lambda: moves([-1, 0], 1e-80), r"Schedule\.move_time: too short"),
    (lambda: sp.Schedule.ramps([0, 5e-324], ANGLES), r"Schedule\.times: too short"),
    (
        lambda: sp.Schedule(kind="cubic", times=np.zeros(1), angles=np.zeros((1, 2))),
        r"Schedule\.kind = 'cubic': must be one of \"steps\"",
    ),
    (
        lambda: sp.Schedule(kind="ramps", times=np.zeros(1), angles=np.zeros((1, 2)), hold="zero"),
        r"Schedule\.hold: belongs to sampled",
    ),
    (
        lambda: sp.Schedule(kind="minimum_jerk", times=np.zeros(1), angles=np.zeros((1, 2))),
        r"Schedule\.move_time: is missing",
    ),
    # Disturbances.
    (lambda: sp.Step(time=NAN), r"Step\.time = nan: must be finite"),
    (lambda: sp.Step(time=0, force=(1, INF)), r"Step\.force\[1\] = inf: must be finite"),
    (lambda: sp.Step(time=0, force=(1, 2, 3)), r"Step\.force has shape \(3,\): .* \(2,\)"),  # type: ignore[arg-type]
    (lambda: sp.Step(time=0, force=1.0), r"Step\.force has shape \(\): .* \(2,\)"),  # type: ignore[arg-type]
    (lambda: sp.Step(time=0, moment=NAN), r"Step\.moment = nan: must be finite"),
    (lambda: sp.Step(time=0, moment=[1.0]), r"Step\.moment = \[1\.0\]: must be a number"),  # type: ignore[arg-type]
    (lambda: sp.Pulse(time=INF, duration=1), r"Pulse\.time = inf: must be finite"),
    (lambda: sp.Pulse(time=0, duration=0), r"Pulse\.duration = 0\.0: must be finite and > 0"),
    (lambda: sp.Pulse(time=0, duration=-1), r"Pulse\.duration = -1\.0: must be finite and > 0"),
    (lambda: sp.Pulse(time=1, duration=1e-20), r"Pulse\.duration = 1e-20: .* later than time"),
    (lambda: sp.Pulse(time=0, duration=1, force=(NAN, 0)), r"Pulse\.force\[0\] = nan"),
    (lambda: sp.Pulse(time=0, duration=1, moment=INF), r"Pulse\.moment = inf"),
    (lambda: sp.Impulse(time=NAN), r"Impulse\.time = nan"),
    (lambda: sp.Impulse(time=0, impulse=(NAN, 0)), r"Impulse\.impulse\[0\] = nan"),
    (lambda: sp.Impulse(time=0, angular_impulse=INF), r"Impulse\.angular_impulse = inf"),
    (lambda: sp.Sine(frequency_hz=0), r"Sine\.frequency_hz = 0\.0: must be finite and > 0"),
    (lambda: sp.Sine(frequency_hz=1e308), r"Sine\.frequency_hz = 1e\+308: 2 pi times"),
    (lambda: sp.Sine(frequency_hz=1, force=(0, NAN)), r"Sine\.force\[1\] = nan"),
    (lambda: sp.Sine(frequency_hz=1, moment=NAN), r"Sine\.moment = nan"),
    (lambda: sp.Sine(frequency_hz=1, phase=INF), r"Sine\.phase = inf"),
    (lambda: sp.Sine(frequency_hz=1, time=NAN), r"Sine\.time = nan"),
    (lambda: sp.Sine(frequency_hz=1, duration=0), r"Sine\.duration = 0\.0: must be"),
    (lambda: sp.Sine(frequency_hz=1, time=1, duration=1e-20), r"Sine\.duration = 1e-20: .*later"),
    (
        lambda: sp.Sampled(times=np.array([0, 0]), force=np.zeros((2, 2))),
        r"Sampled\.times\[1\] = 0\.0: must be greater",
    ),
    (
        lambda: sp.Sampled(times=np.array([0, 1]), force=np.zeros((3, 2))),
        r"Sampled\.force has 3 rows: .* Sampled\.times, 2",
    ),
    (
        lambda: sp.Sampled(times=np.zeros(1), force=np.zeros((1, 3))),
        r"Sampled\.force has shape \(1, 3\): must have shape \(k, 2\)",
    ),
    (
        lambda: sp.Sampled(times=np.zeros(1), force=np.zeros((1, 2)), moment=np.zeros(2)),
        r"Sampled\.moment has 2 rows: .* Sampled\.times, 1",
    ),
    (
        lambda: sp.Sampled(times=np.zeros(1), force=np.zeros((1, 2)), moment=np.array([NAN])),
        r"Sampled\.moment\[0\] = nan",
    ),
    (
        lambda: sp.Sampled(times=np.zeros(1), force=np.zeros((1, 2)), hold="liner"),
        r'Sampled\.hold = \'liner\': .* did you mean "linear"',
    ),
    (
        lambda: sp.Sampled(times=np.array([0, 5e-324]), force=np.eye(2), hold="linear"),
        r"Sampled\.times: too short",
    ),
    # States.
    (lambda: sp.State([0.0] * 8), r"State\.q has shape \(8,\): must have shape \(9,\)"),
    (lambda: sp.State([0.0] * 8 + [NAN]), r"State\.q\[8\] = nan: must be finite"),
    (lambda: sp.State([0.0] * 9, [INF] * 9), r"State\.p\[0\] = inf: must be finite"),
    (lambda: sp.State([0.0] * 9, integral=(0, NAN)), r"State\.integral\[1\] = nan"),
    (lambda: sp.State([0.0] * 9, time=INF), r"State\.time = inf: must be finite"),
    (lambda: sp.State([0.0] * 9, check="no"), r"State\.check = 'no': must be True or False"),  # type: ignore[arg-type]
    (lambda: sp.State([0.0] * 9, grid=(0.0,)), r"State\.grid = \(0\.0,\): must be"),  # type: ignore[arg-type]
    (lambda: sp.State([0.0] * 9, grid=(NAN, 1)), r"State\.grid\[0\] = nan"),
    (lambda: sp.State([0.0] * 9, grid=(0.0, -1)), r"State\.grid\[1\] = -1: must be at least 0"),
    (lambda: sp.State([0.0] * 9, grid=(0.0, 1.5)), r"State\.grid\[1\] = 1\.5: must be an integer"),  # type: ignore[arg-type]
    (lambda: sp.State.consistent(3), r"scene = 3: must be a Scene"),  # type: ignore[arg-type]
    (lambda: sp.State.consistent(sp.Scene(), x=NAN), r"^x = nan: must be finite"),
    (lambda: sp.State.consistent(sp.Scene(), rotation=NAN), r"^rotation = nan"),
    (lambda: sp.State.consistent(sp.Scene(), fingers=(0, INF)), r"^fingers\[1\] = inf"),
    (lambda: sp.State.consistent(sp.Scene(), velocity=(0, 0)), r"^velocity has shape \(2,\)"),
    # Scenes.
    (lambda: sp.Scene(hand=3), r"Scene\.hand = 3: must be a Hand"),  # type: ignore[arg-type]
    (lambda: sp.Scene(grasped=sp.Pid()), r"Scene\.grasped = Pid\(\): must be a GraspedObject"),  # type: ignore[arg-type]
    (lambda: sp.Scene(schedule=[0]), r"Scene\.schedule = \[0\]: must be a Schedule"),  # type: ignore[arg-type]
    (lambda: sp.Scene(control=(sp.Pid(),)), r"Scene\.control = .*: must be a Pid or a pair"),  # type: ignore[arg-type]
    (lambda: sp.Scene(control=(sp.Pid(), 1)), r"Scene\.control = .*: must be a Pid or a pair"),  # type: ignore[arg-type]
    (lambda: sp.Hand(right=None), r"Hand\.right = None: must be a Finger"),  # type: ignore[arg-type]
    (lambda: sp.Hand(left=sp.Pid()), r"Hand\.left = Pid\(\): must be a Finger"),  # type: ignore[arg-type]
    (lambda: sp.Hand(tip=[sp.Fingertip()] * 3), r"Hand\.tip = .*: must be a Fingertip or a pair"),  # type: ignore[arg-type]
    (lambda: sp.Scene(disturbances=sp.Step(time=0)), r"Scene\.disturbances = .*: .* sequence"),  # type: ignore[arg-type]
    (lambda: sp.Scene(disturbances=[1]), r"Scene\.disturbances\[0\] = 1: must be a Disturbance"),  # type: ignore[arg-type]
    (lambda: sp.Scene(initial="closed"), r'Scene\.initial = \'closed\': .*"touching"'),
    (lambda: sp.Scene(initial=3), r"Scene\.initial = 3: must be a State"),  # type: ignore[arg-type]
    (lambda: sp.Scene(durration=3), r"durration"),  # type: ignore[call-arg]
    (lambda: paper.disturbance("v"), r'case = \'v\': must be one of "i", "ii", "iii", "iv"'),
    (lambda: paper.manipulation(speed=1), r"speed"),
    # Starts.
    (lambda: touching(grasped=sp.GraspedObject(width=0.047)), r"right .* gap 1\.0+\d* mm"),
    (
        lambda: touching(grasped=sp.GraspedObject(width=1.0), initial="touching"),
        r"right fingertip cannot touch",
    ),
    (
        lambda: touching(initial=sp.State([0.0, 0.07, 0, 0.1, 0.1, 0, 0, 0, 0])),
        r"initial state is inconsistent: C_1\^H = ",
    ),
    (
        lambda: touching(initial=replace(sp.Scene().start(), p=np.eye(9)[0])),
        r"initial state is inconsistent: the rate of C_1\^H = ",
    ),
    # Arguments.
    (lambda: sp.simulate(3), r"^scene = 3: must be a Scene"),  # type: ignore[arg-type]
    (lambda: sp.simulate(sp.Scene(), dt=0), r"^dt = 0\.0: must be finite and > 0"),
    (lambda: sp.simulate(sp.Scene(), dt=-1e-4), r"^dt = -0\.0001: must be finite and > 0"),
    (lambda: sp.simulate(sp.Scene(), dt=NAN), r"^dt = nan: must be finite and > 0"),
    (lambda: sp.simulate(sp.Scene(), dt=INF), r"^dt = inf: must be finite and > 0"),
    (lambda: sp.simulate(sp.Scene(), dt="1"), r"^dt = '1': must be a number"),  # type: ignore[arg-type]
    (lambda: sp.simulate(sp.Scene(), dt=1e-300), r"steps .* the limit is"),
    (lambda: sp.simulate(sp.Scene(), method="rk5"), r'^method = \'rk5\': .*"rk4"; did you mean'),
    (lambda: sp.simulate(sp.Scene(), method=4), r"^method = 4: must be one of"),  # type: ignore[arg-type]
    (lambda: sp.simulate(sp.Scene(), formulation="cms"), r'^formulation = \'cms\': .*"csm"'),
    (lambda: sp.simulate(sp.Scene(), stabilization=9), r"^stabilization = 9: must be a Stab"),  # type: ignore[arg-type]
    (lambda: sp.simulate(sp.Scene(), record="energies"), r'^record = \'energies\': .*"energy"'),
    (lambda: sp.simulate(sp.Scene(), record=("state", "x")), r'^record = \'x\': .* "residuals"'),
    (lambda: sp.simulate(sp.Scene(), record=None), r"^record = None: must be names"),  # type: ignore[arg-type]
    (lambda: sp.simulate(sp.Scene(), record=(1,)), r"^record = 1: must be one of"),  # type: ignore[arg-type]
    (lambda: sp.simulate(sp.Scene(), every=0), r"^every = 0: must be at least 1"),
    (lambda: sp.simulate(sp.Scene(), every=1.5), r"^every = 1\.5: must be an integer"),  # type: ignore[arg-type]
    (lambda: sp.simulate(sp.Scene(), every=True), r"^every = True: must be an integer"),
    (lambda: sp.simulate(sp.Scene(), stop_on="pulling"), r'^stop_on = \'pulling\': .*"folded"'),
    (lambda: sp.evaluate(3, 0, [0] * 9, [0] * 9), r"^scene = 3: must be a Scene"),  # type: ignore[arg-type]
    (lambda: sp.evaluate(sp.Scene(), NAN, [0] * 9, [0] * 9), r"^t = nan: must be finite"),
    (lambda: sp.evaluate(sp.Scene(), 0, [0] * 8, [0] * 9), r"^q has shape \(8,\)"),
    (lambda: sp.evaluate(sp.Scene(), 0, [0] * 9, [NAN] * 9), r"^p\[0\] = nan"),
    (lambda: sp.evaluate(sp.Scene(), 0, [0] * 9, [0] * 9, [0]), r"^integral has shape \(1,\)"),
    (
        lambda: sp.evaluate(sp.Scene(), 0, [0] * 9, [0] * 9, formulation="x"),
        r'^formulation = \'x\': must be one of "csm"',
    ),
    (
        lambda: sp.evaluate(sp.Scene(), 0, [0] * 9, [0] * 9, stabilization=9),  # type: ignore[arg-type]
        r"^stabilization = 9: must be a Stabilization",
    ),
]


@pytest.mark.parametrize(("bad", "message"), REFUSED, ids=[m for _, m in REFUSED])
def test_bad_input_is_refused_with_field_value_and_rule(
    bad: Callable[[], Any], message: str
) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        bad()


numbers = st.floats() | st.integers() | st.text(max_size=3) | st.none() | st.lists(st.floats())


@given(st.data())
def test_no_number_however_wild_makes_anything_but_a_record_or_a_clear_error(
    data: st.DataObject,
) -> None:
    record, field, _ = data.draw(st.sampled_from(FIELDS))
    value = data.draw(numbers)
    try:
        made = RECORDS[record](**{field: value})
    except (ValueError, TypeError) as error:
        assert str(error).startswith(f"{record}.{field} = ")
    else:
        _core.validate(record, field, getattr(made, field))


@given(strategies.scenes(duration=0.01), st.data())
def test_any_finite_state_gives_a_run_or_a_clear_error(
    scene: sp.Scene, data: st.DataObject
) -> None:
    finite = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=9, max_size=9)
    state = sp.State(data.draw(finite), data.draw(finite), check=data.draw(st.booleans()))
    try:
        run = sp.simulate(replace(scene, initial=state), dt=1e-3)
    except ValueError as error:
        assert "inconsistent" in str(error)
    else:
        assert run.status
        assert np.isfinite(run.t).all()
