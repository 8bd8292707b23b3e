"""Bad input: every rule, and the field's name, the value and the rule in its message.

`tests/test_arguments.py` walks all public callables with values of wrong types.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch import _core, paper, strategies

# The package as those see it who check no types.
raw: Any = sp
NAN, INF = float("nan"), float("inf")
ANGLES = [[0.1, 0.1], [0.2, 0.2]]
MASKED = np.ma.array([0.1, 0.2], mask=[True, False])
RECORDS: dict[str, Any] = {
    "Finger": sp.Finger,
    "Jaw": sp.Jaw,
    "Parallelogram": sp.Parallelogram,
    "Face": sp.Face,
    "Arc": partial(sp.Arc, radius=0.03),
    "ParallelSprings": partial(sp.ParallelSprings, youngs_modulus=1e5),
    "PowerLaw": partial(sp.PowerLaw, coefficient=1e5, exponent=2.0),
    "MeasuredLaw": partial(sp.MeasuredLaw, [1e-3, 2e-3, 3e-3], [1.0, 4.0, 9.0]),
    "Maxwell": partial(sp.Maxwell, share=0.5, time=0.1),
    "Fingertip": sp.Fingertip,
    "GraspedObject": sp.GraspedObject,
    "Pid": sp.Pid,
    "GainSwitch": partial(sp.GainSwitch, at=0.1, measure="angle_rate", above=1.0),
    "Stabilization": sp.Stabilization,
    "Scene": sp.Scene,
}
# Fields that are no numbers.
OTHERS = {
    "Fingertip": {"law", "relaxation"},
    "GraspedObject": {"right", "left"},
    "Arc": {"center", "counterface"},
    "MeasuredLaw": {"compression", "force"},
    "GainSwitch": {*"ABCD", "measure", "latched"},
}
FIELDS = [(record, field, rule) for record, f in _core.RULES.items() for field, rule in f.items()]


def test_every_number_of_a_record_has_a_rule() -> None:
    assert set(RECORDS) == set(_core.RULES)
    for name in RECORDS.keys() - {"Scene"}:
        own = {f.name for f in fields(getattr(sp, name))} - OTHERS.get(name, set())
        assert own == set(_core.RULES[name])


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
    if "pi" in rule:
        wrong.append(4.0)
        right = [1.0, 1e-300]
    if "> 1" in rule:
        right = [1.5, 1e300]
    if ">= 0" in rule or rule == "must be finite":
        right.append(0.0)
    if rule == "must be finite":
        right.append(-1.0)
    for value in right:
        assert getattr(RECORDS[record](**{field: value}), field) == value
    # Friction may be two numbers too, of the right and the left contact.
    two = r"(, or two, \(right, left\))?" if field == "friction" else ""
    for value in ("1.0", True, [1.0], 1j):
        with pytest.raises(TypeError, match=rf"^{record}\.{field} = .*: must be a number{two}$"):
            RECORDS[record](**{field: value})


def test_none_is_taken_only_where_it_is_the_default() -> None:
    assert raw.Fingertip(normal_mass=None).normal_mass is None
    for refused in (lambda: raw.Finger(length=None), lambda: raw.Step(time=None)):
        with pytest.raises(TypeError, match=r"\w+\.\w+ = None: must be a number"):
            refused()


def steps(times: Any, angles: Any) -> Any:
    return raw.Schedule.steps(times, angles)


def moves(times: Any, move_time: Any) -> Any:
    return raw.Schedule.minimum_jerk(times, np.arange(2.0 * len(times)).reshape(-1, 2), move_time)


def simulated(how: Any = None, **changes: Any) -> Any:
    return raw.simulate(raw.Scene(**changes), **(how or {}))


def sampled(times: Any, **fields: Any) -> Any:
    return raw.Sampled(times=np.array(times), **{"force": np.zeros((len(times), 2)), **fields})


REFUSED: list[tuple[Callable[[], Any], str]] = [
    # Schedules.
    (lambda: steps([0, 1, 1], ANGLES + ANGLES[:1]), r"Schedule\.times\[2\] = 1\.0: .*greater"),
    (lambda: steps([0, NAN], ANGLES), r"Schedule\.times\[1\] = nan: must be finite"),
    (lambda: steps([], np.zeros((0, 2))), r"Schedule\.times has shape \(0,\): .* \(k,\)"),
    (lambda: steps([0], [[0, INF]]), r"Schedule\.angles\[0, 1\] = inf: must be finite"),
    (lambda: steps([0], [6, 6]), r"must have shape \(k, 2\), a row \(right, left\) for"),
    (lambda: steps([0], ANGLES), r"Schedule\.angles has 2 rows: .* Schedule\.times, 1"),
    (lambda: steps([0, 1], [[0, 0], [1]]), r"Schedule\.angles is ragged"),
    (
        lambda: raw.Schedule.sampled([0], [[0, 0]], hold="cubic"),
        r"Schedule\.hold = 'cubic': .*zero",
    ),
    (lambda: moves([0, 1, 2], 1.01), r"Schedule\.move_time = 1\.01: .* overlap, times\[2\]"),
    (lambda: moves([0, 1, 2], [1.01, 9]), r"Schedule\.move_time\[0\] = 1\.01: .* overlap, times"),
    (lambda: moves([0, 1], 1e-17), r"Schedule\.move_time = 1e-17: .* later than it starts"),
    (lambda: moves([0, 1, 2], [0.1]), r"move_time has shape \(1,\): .*\(2,\), one for each move"),
    (lambda: moves([0, 1, 2], [0.1, -1.0]), r"Schedule\.move_time\[1\] = -1\.0: must be finite"),
    (lambda: moves([0, 1e-90, 1], None), r"Schedule\.times: too short, the rates"),
    (lambda: raw.Schedule.ramps([0, 5e-324], ANGLES), r"Schedule\.times: too short"),
    (lambda: raw.Schedule.in_degrees("steps", [0], [[1, 1]], hold="zero"), r"hold: belongs to"),
    (
        lambda: raw.Schedule(kind="minimum_jerk", times=np.zeros(1), angles=np.zeros((1, 2))),
        r"Schedule\.move_time: is missing",
    ),
    (lambda: steps([0], [[0, 0]]).target([0.0, NAN]), r"^t\[1\] = nan: must be finite"),
    # Disturbances.
    (lambda: raw.Step(time=NAN), r"Step\.time = nan: must be finite"),
    (lambda: raw.Step(time=0, force=(1, INF)), r"Step\.force\[1\] = inf: must be finite"),
    (lambda: raw.Step(time=0, force=(1, 2, 3)), r"Step\.force has shape \(3,\): .* \(2,\)"),
    (lambda: raw.Pulse(time=0, duration=0), r"Pulse\.duration = 0\.0: must be finite and > 0"),
    (lambda: raw.Pulse(time=1, duration=1e-20), r"Pulse\.duration = 1e-20: .* later than time"),
    (lambda: raw.Impulse(time=0, impulse=(NAN, 0)), r"Impulse\.impulse\[0\] = nan"),
    (lambda: raw.Sine(frequency_hz=1e308), r"Sine\.frequency_hz = 1e\+308: 2 pi times"),
    (lambda: raw.Sine(frequency_hz=1, time=1, duration=1e-20), r"Sine\.duration = 1e-20: .*later"),
    (lambda: sampled([0, 0]), r"Sampled\.times\[1\] = 0\.0: must be greater"),
    (
        lambda: sampled([0, 1], force=np.zeros((3, 2))),
        r"Sampled\.force has 3 rows: .* Sampled\.times, 2",
    ),
    (lambda: sampled([0], moment=np.zeros(2)), r"Sampled\.moment has 2 rows: .* Sampled\.times, 1"),
    (
        lambda: sampled([0], hold="liner"),
        r'Sampled\.hold = \'liner\': .* did you mean "linear"',
    ),
    (lambda: sampled([0, 5e-324], force=np.eye(2), hold="linear"), r"Sampled\.times: too short"),
    # States.
    (lambda: raw.State([0.0] * 8), r"State\.q has shape \(8,\): must have shape \(9,\)"),
    (lambda: raw.State([0.0] * 9, [INF] * 9), r"State\.p\[0\] = inf: must be finite"),
    (lambda: raw.State([0.0] * 9, integral=(0, NAN)), r"State\.integral\[1\] = nan"),
    (lambda: raw.State([0.0] * 9, linearized=[0.0] * 20), r"State\.linearized has shape"),
    (lambda: raw.State.consistent(raw.Scene(), x=NAN), r"^x = nan: must be finite"),
    # Scenes.
    (lambda: raw.Scene(initial="touch"), r"'touch': must be a State, \"touching\" or None"),
    (lambda: paper.disturbance("v"), r'case = \'v\': must be one of "i", "ii", "iii", "iv"'),
    # Starts.
    (lambda: simulated(grasped=raw.GraspedObject(width=0.047)), r"right .* gap 1(\.0\d*)? mm"),
    (
        lambda: simulated(grasped=raw.GraspedObject(width=1.0), initial="touching"),
        r"right fingertip cannot touch",
    ),
    (
        lambda: simulated(initial=raw.State([0.0, 0.07, 0, 0.1, 0.1, 0, 0, 0, 0])),
        r"initial state is inconsistent: C_1\^H = ",
    ),
    (
        lambda: simulated(initial=replace(raw.Scene().start(), p=np.eye(9)[0])),
        r"initial state is inconsistent: the rate of C_1\^H = ",
    ),
    # Arguments.
    (lambda: simulated({"dt": -1e-4}), r"^dt = -0\.0001: must be finite and > 0"),
    (lambda: simulated({"dt": 1e-300}), r"steps .* the limit is"),
    (lambda: simulated({"method": "rk5"}), r'^method = \'rk5\': .*"rk4", .*; did you mean "rk4"'),
    (lambda: simulated({"record": ("state", "x")}), r'^record = \'x\': .* "residuals"'),
    (lambda: simulated({"every": 0}), r"^every = 0: must be at least 1"),
    (lambda: simulated({"stop_on": "pushing"}), r'^stop_on = \'pushing\': .*"pulling"'),
    (lambda: raw.evaluate(raw.Scene(), NAN, [0] * 9, [0] * 9), r"^t = nan: must be finite"),
    (lambda: raw.Estimate.counted(3, 2), r"^count = 3: must be at most 2"),
    (lambda: raw.Estimate.counted(1, 2, 1.0), r"^confidence = 1\.0: must be above 0 and below 1"),
]
WRONG_TYPES: list[tuple[Callable[[], Any], str]] = [
    (lambda: raw.State([0.0] * 9, grid=(0.0,)), r"State\.grid = \(0\.0,\): must be"),
    (lambda: raw.Scene(hand=3), r"Scene\.hand = 3: must be a Hand"),
    (lambda: raw.Scene(control=(raw.Pid(), 1)), r"Scene\.control = .*: must be a Pid or a pair"),
    (lambda: raw.Hand(tip=[raw.Fingertip()] * 3), r"Hand\.tip = .*: must be a Fingertip or a pair"),
    (lambda: raw.Scene(disturbances=sp.Step(time=0)), r"must be a sequence .* such as \[Step\("),
    (lambda: raw.Scene(disturbances=[1]), r"Scene\.disturbances\[0\] = 1: must be a Disturbance"),
    (lambda: raw.Scene(durration=3), r"durration"),
    # Masked arrays, whose mask NumPy drops.
    (lambda: steps(MASKED, ANGLES), r"^Schedule\.times: must not be a masked array"),
    (lambda: raw.Step(time=0, force=MASKED), r"^Step\.force: must not be a masked array"),
    (
        lambda: raw.monte_carlo(raw.Scene(), vary={"grasped.mass": MASKED}),
        r'^vary\["grasped\.mass"\]: must not be a masked array',
    ),
]


@pytest.mark.parametrize(("bad", "message"), REFUSED, ids=[m for _, m in REFUSED])
def test_bad_input_is_refused_with_field_value_and_rule(
    bad: Callable[[], Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        bad()


@pytest.mark.parametrize(("bad", "message"), WRONG_TYPES, ids=[m for _, m in WRONG_TYPES])
def test_what_has_the_wrong_type_is_a_type_error(bad: Callable[[], Any], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        bad()


@given(strategies.scenes(duration=0.01), st.data())
def test_any_finite_state_gives_a_run_or_a_clear_error(
    scene: sp.Scene, data: st.DataObject
) -> None:
    finite = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=9, max_size=9)
    state = raw.State(data.draw(finite), data.draw(finite), check=data.draw(st.booleans()))
    try:
        run = sp.simulate(replace(scene, initial=state), dt=1e-3)
    except ValueError as error:
        assert "inconsistent" in str(error)
    else:
        assert np.isfinite(run.t).all()


def repeated(value: Any, *shape: int) -> np.ndarray:
    """An array of any size that takes no memory."""
    return np.broadcast_to(value, shape)


def inputs(**changes: Any) -> _core.Inputs:
    still = (np.zeros((1, 0)), np.zeros((1, 1, 2, 1)))
    parts: dict[str, Any] = dict.fromkeys(("forces", "sines", "impulses", "noises"), ())
    return _core.Inputs(**{"schedule": still, **parts, "fingers": "pid", **changes})


MUCH = 10**12
HUGE: dict[str, Callable[[], object]] = {
    "rows": lambda: _core.residuals(
        sp.Scene().parameters(), repeated(0.0, MUCH, 9), repeated(0.0, MUCH, 9)
    ),
    "eigenvalues": lambda: _core.stable_step("rk4", repeated(-1j, MUCH)),
    "sines": lambda: inputs(sines=[repeated(0.0, MUCH, 7)]),
}


@pytest.mark.parametrize("make", HUGE.values(), ids=HUGE)
def test_arrays_that_memory_does_not_hold_are_refused_without_an_abort(
    make: Callable[[], object],
) -> None:
    with pytest.raises(ValueError, match=r" would need \d\.\d+e\d+, the limit is 2\.1e9"):
        make()
