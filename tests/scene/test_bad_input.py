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

# The package as those see it who check no types.
raw: Any = sp
NAN, INF = float("nan"), float("inf")
ANGLES = [[0.1, 0.1], [0.2, 0.2]]
MASKED = np.ma.array([0.1, 0.2], mask=[True, False])
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
    # Friction may be two numbers too, of the right and the left contact.
    two = r"(, or two, \(right, left\))?" if field == "friction" else ""
    with pytest.raises(TypeError, match=rf"^{record}\.{field} = .*: must be a number{two}$"):
        RECORDS[record](**{field: value})


def test_what_is_too_large_for_a_float_is_not_finite() -> None:
    with pytest.raises(ValueError, match=r"Finger\.length = .*must be finite"):
        raw.Finger(length=10**400)
    with pytest.raises(ValueError, match=r"State\.q.*must be finite"):
        raw.State([10**400] * 9)


def test_none_is_only_where_it_is_the_default() -> None:
    assert raw.Fingertip(normal_mass=None).normal_mass is None
    with pytest.raises(TypeError, match=r"Finger\.length = None: must be a number"):
        raw.Finger(length=None)


def steps(times: Any, angles: Any) -> Any:
    return raw.Schedule.steps(times, angles)


def moves(times: Any, move_time: Any) -> Any:
    return raw.Schedule.minimum_jerk(times, np.arange(2.0 * len(times)).reshape(-1, 2), move_time)


def touching(**changes: Any) -> Any:
    return raw.simulate(raw.Scene(**changes))


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
    (lambda: steps([0], [[None, 0]]), r"Schedule\.angles = .*None.*: must hold numbers"),
    (lambda: steps([0], [[{}, 0]]), r"Schedule\.angles = .* must hold numbers"),
    (
        lambda: raw.Schedule.sampled([0], [[0, 0]], hold="cubic"),
        r"Schedule\.hold = 'cubic': .*zero",
    ),
    (lambda: moves([0, 1], 0.0), r"Schedule\.move_time = 0\.0: must be finite and > 0"),
    (lambda: moves([0, 1], INF), r"Schedule\.move_time = inf: must be finite and > 0"),
    (lambda: moves([0, 1], "1"), r"Schedule\.move_time = '1': must be a number"),
    (lambda: moves([0, 1, 2], 1.01), r"Schedule\.move_time = 1\.01: .* overlap, times\[2\]"),
    (lambda: moves([0, 1], 1e-17), r"Schedule\.move_time = 1e-17: .* later than it starts"),
    (lambda: moves([0, 1, 2], [0.1]), r"move_time has 1 entries: .*one for each move, 2 \("),
    (lambda: moves([0, 1, 2], [0.1, -1.0]), r"Schedule\.move_time\[1\] = -1\.0: must be finite"),
    (lambda: moves([0, 1, 2], [1.01, 9]), r"Schedule\.move_time\[0\] = 1\.01: .* overlap, times"),
    (lambda: moves([0, 1e-90, 1], None), r"Schedule\.times: too short, the rates"),
    (lambda: raw.Schedule.in_degrees("sine", [0], [[1, 1]]), r"kind = 'sine': must be one of"),
    (lambda: raw.Schedule.in_degrees("steps", [0], [[1, 1]], hold="zero"), r"hold: belongs to"),
    (lambda: moves([-1, 0], 1e-80), r"Schedule\.move_time: too short"),
    (lambda: raw.Schedule.ramps([0, 5e-324], ANGLES), r"Schedule\.times: too short"),
    (
        lambda: raw.Schedule(kind="cubic", times=np.zeros(1), angles=np.zeros((1, 2))),
        r"Schedule\.kind = 'cubic': must be one of \"steps\"",
    ),
    (
        lambda: raw.Schedule(kind="ramps", times=np.zeros(1), angles=np.zeros((1, 2)), hold="zero"),
        r"Schedule\.hold: belongs to sampled",
    ),
    (
        lambda: raw.Schedule(kind="minimum_jerk", times=np.zeros(1), angles=np.zeros((1, 2))),
        r"Schedule\.move_time: is missing",
    ),
    # Disturbances.
    (lambda: raw.Step(time=NAN), r"Step\.time = nan: must be finite"),
    (lambda: raw.Step(time=0, force=(1, INF)), r"Step\.force\[1\] = inf: must be finite"),
    (lambda: raw.Step(time=0, force=(1, 2, 3)), r"Step\.force has shape \(3,\): .* \(2,\)"),
    (lambda: raw.Step(time=0, force=1.0), r"Step\.force has shape \(\): .* \(2,\)"),
    (lambda: raw.Step(time=0, moment=NAN), r"Step\.moment = nan: must be finite"),
    (lambda: raw.Step(time=0, moment=[1.0]), r"Step\.moment = \[1\.0\]: must be a number"),
    (lambda: raw.Pulse(time=INF, duration=1), r"Pulse\.time = inf: must be finite"),
    (lambda: raw.Pulse(time=0, duration=0), r"Pulse\.duration = 0\.0: must be finite and > 0"),
    (lambda: raw.Pulse(time=0, duration=-1), r"Pulse\.duration = -1\.0: must be finite and > 0"),
    (lambda: raw.Pulse(time=1, duration=1e-20), r"Pulse\.duration = 1e-20: .* later than time"),
    (lambda: raw.Pulse(time=0, duration=1, force=(NAN, 0)), r"Pulse\.force\[0\] = nan"),
    (lambda: raw.Pulse(time=0, duration=1, moment=INF), r"Pulse\.moment = inf"),
    (lambda: raw.Impulse(time=NAN), r"Impulse\.time = nan"),
    (lambda: raw.Impulse(time=0, impulse=(NAN, 0)), r"Impulse\.impulse\[0\] = nan"),
    (lambda: raw.Impulse(time=0, angular_impulse=INF), r"Impulse\.angular_impulse = inf"),
    (lambda: raw.Sine(frequency_hz=0), r"Sine\.frequency_hz = 0\.0: must be finite and > 0"),
    (lambda: raw.Sine(frequency_hz=1e308), r"Sine\.frequency_hz = 1e\+308: 2 pi times"),
    (lambda: raw.Sine(frequency_hz=1, force=(0, NAN)), r"Sine\.force\[1\] = nan"),
    (lambda: raw.Sine(frequency_hz=1, moment=NAN), r"Sine\.moment = nan"),
    (lambda: raw.Sine(frequency_hz=1, phase=INF), r"Sine\.phase = inf"),
    (lambda: raw.Sine(frequency_hz=1, time=NAN), r"Sine\.time = nan"),
    (lambda: raw.Sine(frequency_hz=1, duration=0), r"Sine\.duration = 0\.0: must be"),
    (lambda: raw.Sine(frequency_hz=1, time=1, duration=1e-20), r"Sine\.duration = 1e-20: .*later"),
    (
        lambda: raw.Sampled(times=np.array([0, 0]), force=np.zeros((2, 2))),
        r"Sampled\.times\[1\] = 0\.0: must be greater",
    ),
    (
        lambda: raw.Sampled(times=np.array([0, 1]), force=np.zeros((3, 2))),
        r"Sampled\.force has 3 rows: .* Sampled\.times, 2",
    ),
    (
        lambda: raw.Sampled(times=np.zeros(1), force=np.zeros((1, 3))),
        r"Sampled\.force has shape \(1, 3\): must have shape \(k, 2\)",
    ),
    (
        lambda: raw.Sampled(times=np.zeros(1), force=np.zeros((1, 2)), moment=np.zeros(2)),
        r"Sampled\.moment has 2 rows: .* Sampled\.times, 1",
    ),
    (
        lambda: raw.Sampled(times=np.zeros(1), force=np.zeros((1, 2)), moment=np.array([NAN])),
        r"Sampled\.moment\[0\] = nan",
    ),
    (
        lambda: raw.Sampled(times=np.zeros(1), force=np.zeros((1, 2)), hold="liner"),
        r'Sampled\.hold = \'liner\': .* did you mean "linear"',
    ),
    (
        lambda: raw.Sampled(times=np.array([0, 5e-324]), force=np.eye(2), hold="linear"),
        r"Sampled\.times: too short",
    ),
    # States.
    (lambda: raw.State([0.0] * 8), r"State\.q has shape \(8,\): must have shape \(9,\)"),
    (lambda: raw.State([0.0] * 8 + [NAN]), r"State\.q\[8\] = nan: must be finite"),
    (lambda: raw.State([0.0] * 9, [INF] * 9), r"State\.p\[0\] = inf: must be finite"),
    (lambda: raw.State([0.0] * 9, integral=(0, NAN)), r"State\.integral\[1\] = nan"),
    (lambda: raw.State([0.0] * 9, time=INF), r"State\.time = inf: must be finite"),
    (lambda: raw.State([0.0] * 9, check="no"), r"State\.check = 'no': must be True or False"),
    (lambda: raw.State([0.0] * 9, grid=(0.0,)), r"State\.grid = \(0\.0,\): must be"),
    (lambda: raw.State([0.0] * 9, grid=(NAN, 1)), r"State\.grid\[0\] = nan"),
    (lambda: raw.State([0.0] * 9, grid=(0.0, -1)), r"State\.grid\[1\] = -1: must be at least 0"),
    (
        lambda: raw.State([0.0] * 9, grid=(0.0, 2**70)),
        r"State\.grid\[1\] = 1180.*: must be at most",
    ),
    (lambda: raw.State([0.0] * 9, linearized=[0.0] * 20), r"State\.linearized has shape"),
    (lambda: raw.State([0.0] * 9, grid=(0.0, 1.5)), r"State\.grid\[1\] = 1\.5: must be an integer"),
    (lambda: raw.State.consistent(3), r"scene = 3: must be a Scene"),
    (lambda: raw.State.consistent(raw.Scene(), x=NAN), r"^x = nan: must be finite"),
    (lambda: raw.State.consistent(raw.Scene(), rotation=NAN), r"^rotation = nan"),
    (lambda: raw.State.consistent(raw.Scene(), fingers=(0, INF)), r"^fingers\[1\] = inf"),
    (lambda: raw.State.consistent(raw.Scene(), velocity=(0, 0)), r"^velocity has shape \(2,\)"),
    # Scenes.
    (lambda: raw.Scene(hand=3), r"Scene\.hand = 3: must be a Hand"),
    (lambda: raw.Scene(grasped=raw.Pid()), r"Scene\.grasped = Pid\(\): must be a GraspedObject"),
    (lambda: raw.Scene(schedule=[0]), r"Scene\.schedule = \[0\]: must be a Schedule"),
    (lambda: raw.Scene(control=(raw.Pid(),)), r"Scene\.control = .*: must be a Pid or a pair"),
    (lambda: raw.Scene(control=(raw.Pid(), 1)), r"Scene\.control = .*: must be a Pid or a pair"),
    (lambda: raw.Hand(right=None), r"Hand\.right = None: must be a Finger"),
    (lambda: raw.Hand(left=raw.Pid()), r"Hand\.left = Pid\(\): must be a Finger"),
    (lambda: raw.Hand(tip=[raw.Fingertip()] * 3), r"Hand\.tip = .*: must be a Fingertip or a pair"),
    (lambda: raw.Scene(disturbances=raw.Step(time=0)), r"Scene\.disturbances = .*: .* sequence"),
    (lambda: raw.Scene(disturbances=[1]), r"Scene\.disturbances\[0\] = 1: must be a Disturbance"),
    (lambda: raw.Scene(initial="closed"), r'Scene\.initial = \'closed\': .*"touching"'),
    (lambda: raw.Scene(initial=3), r"Scene\.initial = 3: must be a State"),
    (lambda: raw.Scene(durration=3), r"durration"),
    (lambda: paper.disturbance("v"), r'case = \'v\': must be one of "i", "ii", "iii", "iv"'),
    (lambda: paper.manipulation(speed=1), r"speed"),
    # Starts.
    (lambda: touching(grasped=raw.GraspedObject(width=0.047)), r"right .* gap 1(\.0\d*)? mm"),
    (
        lambda: touching(grasped=raw.GraspedObject(width=1.0), initial="touching"),
        r"right fingertip cannot touch",
    ),
    (
        lambda: touching(initial=raw.State([0.0, 0.07, 0, 0.1, 0.1, 0, 0, 0, 0])),
        r"initial state is inconsistent: C_1\^H = ",
    ),
    (
        lambda: touching(initial=replace(raw.Scene().start(), p=np.eye(9)[0])),
        r"initial state is inconsistent: the rate of C_1\^H = ",
    ),
    # Arguments.
    (lambda: raw.simulate(3), r"^scene = 3: must be a Scene"),
    (lambda: raw.simulate(raw.Scene(), dt=0), r"^dt = 0\.0: must be finite and > 0"),
    (lambda: raw.simulate(raw.Scene(), dt=-1e-4), r"^dt = -0\.0001: must be finite and > 0"),
    (lambda: raw.simulate(raw.Scene(), dt=NAN), r"^dt = nan: must be finite and > 0"),
    (lambda: raw.simulate(raw.Scene(), dt=INF), r"^dt = inf: must be finite and > 0"),
    (lambda: raw.simulate(raw.Scene(), dt="1"), r"^dt = '1': must be a number"),
    (lambda: raw.simulate(raw.Scene(), dt=1e-300), r"steps .* the limit is"),
    (
        lambda: raw.simulate(raw.Scene(), method="rk5"),
        r'^method = \'rk5\': .*"rk4", .*; did you mean "rk4"',
    ),
    (lambda: raw.simulate(raw.Scene(), method=4), r"^method = 4: must be one of"),
    (lambda: raw.simulate(raw.Scene(), formulation="cms"), r'^formulation = \'cms\': .*"csm"'),
    (lambda: raw.simulate(raw.Scene(), stabilization=9), r"^stabilization = 9: must be a Stab"),
    (lambda: raw.simulate(raw.Scene(), record="energies"), r'^record = \'energies\': .*"energy"'),
    (lambda: raw.simulate(raw.Scene(), record=("state", "x")), r'^record = \'x\': .* "residuals"'),
    (lambda: raw.simulate(raw.Scene(), record=None), r"^record = None: must be names"),
    (lambda: raw.simulate(raw.Scene(), record=(1,)), r"^record = 1: must be one of"),
    (lambda: raw.simulate(raw.Scene(), every=0), r"^every = 0: must be at least 1"),
    (lambda: raw.simulate(raw.Scene(), every=1.5), r"^every = 1\.5: must be an integer"),
    (lambda: raw.simulate(raw.Scene(), every=True), r"^every = True: must be an integer"),
    (lambda: raw.simulate(raw.Scene(), stop_on="pushing"), r'^stop_on = \'pushing\': .*"pulling"'),
    (lambda: raw.evaluate(3, 0, [0] * 9, [0] * 9), r"^scene = 3: must be a Scene"),
    (lambda: raw.evaluate(raw.Scene(), NAN, [0] * 9, [0] * 9), r"^t = nan: must be finite"),
    (lambda: raw.evaluate(raw.Scene(), 0, [0] * 8, [0] * 9), r"^q has shape \(8,\)"),
    (lambda: raw.evaluate(raw.Scene(), 0, [0] * 9, [NAN] * 9), r"^p\[0\] = nan"),
    (lambda: raw.evaluate(raw.Scene(), 0, [0] * 9, [0] * 9, [0]), r"^integral has shape \(1,\)"),
    (
        lambda: raw.evaluate(raw.Scene(), 0, [0] * 9, [0] * 9, formulation="x"),
        r'^formulation = \'x\': must be one of "csm"',
    ),
    (
        lambda: raw.evaluate(raw.Scene(), 0, [0] * 9, [0] * 9, stabilization=9),
        r"^stabilization = 9: must be a Stabilization",
    ),
    (lambda: steps([0], [[0, 0]]).target([0.0, NAN]), r"^t\[1\] = nan: must be finite"),
    (lambda: steps([0], [[0, 0]]).target(10**400), r"^t = .*: must be finite"),
    (lambda: steps([0], [[0, 0]]).target("1"), r"^t = '1': must hold numbers"),
    (lambda: raw.simulate(raw.Scene(), estimate_error={}), r"^estimate_error = {}: must be True"),
    (lambda: raw.max_stable_dt(raw.Scene(), measure="no"), r"^measure = 'no': must be True or"),
    (lambda: raw.stabilization_sweep(raw.Scene(), products=[10**400]), r"^products = .* finite"),
    (lambda: raw.work_precision(raw.Scene(), dt=[10**400]), r"^dt = .*: must be finite"),
    (lambda: raw.Estimate.counted(3, 2), r"^count = 3: must be at most 2"),
    (lambda: raw.Estimate.counted(1, 2, 1.0), r"^confidence = 1\.0: must be above 0 and below 1"),
    (lambda: raw.Estimate.of([0.0, 1.0]), r"^happened = \[0\.0, 1\.0\]: must hold booleans"),
    # Masked arrays, whose mask NumPy drops.
    (lambda: steps(MASKED, ANGLES), r"^Schedule\.times: must not be a masked array"),
    (lambda: steps([0, 1], [MASKED, MASKED]), r"^Schedule\.angles: must not be a masked array"),
    (lambda: raw.Step(time=np.ma.masked), r"^Step\.time = masked: must be a number"),
    (lambda: raw.Step(time=0, force=MASKED), r"^Step\.force: must not be a masked array"),
    (lambda: raw.Normal(MASKED, 1.0), r"^Normal\.mean: must not be a masked array"),
    (lambda: raw.Choice(MASKED), r"^Choice\.values: must not be a masked array"),
    (
        lambda: raw.monte_carlo(raw.Scene(), vary={"grasped.mass": MASKED}),
        r'^vary\["grasped\.mass"\]: must not be a masked array',
    ),
    (
        lambda: raw.monte_carlo(raw.Scene(), 9, only=np.ma.array([1, 2], mask=[True, False])),
        r"^only: must not be a masked array",
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
        stored = getattr(made, field)
        if stored is None:
            assert field in ("normal_mass", "tangential_mass", "friction", "height")
        else:
            for number in stored if isinstance(stored, tuple) else (stored,):
                _core.validate(record, field, number)


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
        assert run.status
        assert np.isfinite(run.t).all()
