"""The laws that turn the fingers of a scene: a PID (39), torques of the schedule, or a discrete
linear controller, which the core computes.

A new law needs its class, and a line in `LAWS`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.choices import Jitter
from ..support.record import Kinded, Record, bare
from .hand import one_or_pair, or_other

# Measures that a controller knows without a sensor.
_KNOWN = {"target", "target_rate", "schedule"}
JITTERS = ("uniform", "normal")
# Fields with one number for each entry of y, or measure -> number.
_OF_EACH = ("measure_noise", "resolution", "dead_zone")
# The numbers of a block as the core takes them.
_NUMBERS = ("period", "first_sample", "measure_delay", "delay", "loss", "jitter", "rate_limit")
_NUMBERS += ("no_load_rate", "limits", "initial_torque", *"ABCD", "initial_state", *_OF_EACH)
_NONE = dict.fromkeys(
    ("rate_limit", "no_load_rate", "at", "above"), np.array([np.inf])
)  # for what is None
_NONE |= {"limits": np.tile([-np.inf, np.inf], (1, 2, 1)), "below": np.array([-np.inf])}

# A block of a `SampledController` as the core takes it: measures, number of states, anti-windup and
# whether jitter is normal, numbers (runs, k); of a `GainSwitch` its measure, and `latched`.
Compiled: TypeAlias = tuple[list[str], int, tuple[bool, bool], Floats, tuple[str, bool] | None]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Pid(Record):
    """The gains of the PID controller (39) of a finger's angle, or of a jaw's travel.

    Those of a `Jaw` are in N/m, N s/m and N/(m s).

    Attributes:
        kp: K_P, N m/rad; `kd` is K_D, N m s/rad, and `ki` is K_I, N m/(rad s).
    """

    kp: float = 100.0
    kd: float = 1.0
    ki: float = 1000.0


@dataclass(frozen=True, eq=False, repr=False)
class Law(Kinded):
    """Base class of the laws that a scene file tells from a PID by their `kind`."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Torque(Law):
    """The schedule's values are the torques on the fingers, N m, instead of target angles.

    A positive torque closes its finger. Between the instants of the schedule torques are constant
    for `Schedule.steps`, linear for `Schedule.ramps`. No angle is fed back. Give a schedule too:
    the default one, 0.105 rad for a PID, would be 0.105 N m. What moves a `Jaw` is a force, N.
    """


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GainSwitch(Record):
    """A second set of gains of a `SampledController`, and when it acts.

    It acts on samples that are used at `at` or later, or of which a number of `measure`, as it is
    used (less its target, after a dead zone), is above `above` or below `below`. States xi stay.

    Attributes:
        A: The second gains, as `B`, `C` and `D`, shaped as the block's; None keeps the block's.
        at: Instant on the clock of the schedule, s.
        measure: One of the block's measures, with the thresholds `above` and `below` in its unit.
        latched: Whether the second set stays once it acts. If not, each sample decides anew.
    """

    A: NDArray[np.float64] | None = None
    B: NDArray[np.float64] | None = None
    C: NDArray[np.float64] | None = None
    D: NDArray[np.float64] | None = None
    at: float | None = None
    measure: str | None = None
    above: float | None = None
    below: float | None = None
    latched: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, own in self.gains.items():
            self._set(name, checks.array(f"GainSwitch.{name}", own, ("n", "k")))
        self._set("latched", checks.boolean("GainSwitch.latched", self.latched))
        if self.measure is not None:
            checks.choice("GainSwitch.measure", self.measure, _core.MEASURES)
        crosses = (self.above, self.below) != (None, None)
        if crosses != (self.measure is not None) or not (crosses or self.at is not None):
            raise ValueError(f"{self!r}: must have at, or measure with above or below")

    @property
    def gains(self) -> dict[str, Floats]:
        """The second gains that are given, by their names."""
        return {name: own for name in "ABCD" if (own := getattr(self, name)) is not None}


@dataclass(frozen=True, eq=False, repr=False)
class SampledController(Law):
    """A discrete linear controller: it measures at every period, and its torques are held.

    With the measurements y_k at start + k * period and the state xi_k:

        u_k = C xi_k + D y_k, limited to v_k,    xi_(k+1) = A xi_k + B y_k,

    and v_k is the torque on the fingers from start + k * period + delay until v_(k+1) acts. Steps
    of the integration end at each of these instants, so that a method keeps its order. A delay may
    be longer than the period. The schedule has the target angles of the fingers.

    `cascade` makes one of several, such as of a camera and a servo, each with numbers of its own.

    Measures, with the number of their entries in y:

    - "angle" (2), rad; "angle_rate" (2), rad/s: theta_i of the right and the left finger; this and
      what belongs to it is of a `Jaw` its travel in m, with forces in N for torques;
    - "angle_error" (2), rad: theta_i minus its target, as in the PID (39);
    - "target" (2), rad; "target_rate" (2), rad/s: the schedule's; in a cascade, what the block
      before this one puts out, and zero; "schedule" (2), rad: in each block the schedule's;
    - "position" (2), m; "velocity" (2), m/s: x and y of the object;
    - "rotation" (1), rad; "rotation_rate" (1), rad/s: theta of the object;
    - "compression" (2), m; "shear" (2), m: d_n and d_t of both tips;
    - "multipliers" (4), N: lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N under the torques before;
    - "accelerometer" (2), m/s^2; "gyroscope" (1), rad/s: an inertial sensor at the origin of the
      hand's frame. It reads (a_x + g sin(phi), a_y + g cos(phi)) with the acceleration a along the
      hand's axes, at a jump that after it, and the rate of the tilt phi; at rest (0, g) and 0.

    Attributes:
        period: Time between samples, s.
        A: (n, n); None is a controller without states, with B and C also None.
        B: (n, m), for the m numbers that are measured.
        C: (2, n), N m: torques on the right and the left finger, or targets of the next block.
        D: (2, m); None is zero.
        measures: Names of the measures, in the order of y.
        delay: Time from a sample (and its `measure_delay`) until its torques act, s.
        limits: Smallest and largest torque, N m, (2,), or (2, 2) for each finger; None is no limit.
        initial_torque: Torques on both fingers until the first sample acts, N m, within the limits.
        initial_state: xi_0 (n,); None is zero.
        anti_windup: Clamping: a state is held in a sample that drives a limited torque further out.
        measure_noise: Standard deviation of Gaussian noise, in the units of y: one number for all,
            one for each entry (m,), or measure -> number; it is 0 for what is known, as "target".
        resolution: Steps to which sensors round, given as `measure_noise`; of angles, not errors.
        seed: Seed of noise, losses and jitter, from 0 to 2^64 - 1; `monte_carlo` takes the study's.
        run: Run number, which these depend on too; `monte_carlo` takes the run's.
        first_sample: Time from the start until the first sample, s.
        measure_delay: Time, s, until measurements are used, with the targets of then; then `delay`.
        loss: Probability, below 1, that a sample but the first is lost, and the one before counts.
        jitter: How late samples are, s, below the period: up to it with `jitter_kind` "uniform", or
            by the size of a "normal" number with this deviation, up to 0.999 periods.
        rate_limit: Largest change of a torque in one period, divided by it, N m/s; None: no limit.
        no_load_rate: The rate, rad/s, at which a motor has no torque left: the limit in a finger's
            direction falls to 0 in proportion to its "angle_rate"; None: it does not.
        dead_zone: z, given as `measure_noise`: measurements count as closer to 0 by z, or as 0.
        switch: A second set of gains, and when it acts.
        outer: The block before this one in a cascade; see `cascade`.
    """

    period: float
    A: NDArray[np.float64] | None = None
    B: NDArray[np.float64] | None = None
    C: NDArray[np.float64] | None = None
    D: NDArray[np.float64] | None = None
    measures: tuple[str, ...] = ("angle_error", "angle_rate")
    delay: float = 0.0
    limits: NDArray[np.float64] | None = None
    initial_torque: tuple[float, float] = (0.0, 0.0)
    initial_state: NDArray[np.float64] | None = None
    anti_windup: bool = False
    measure_noise: NDArray[np.float64] | float = 0.0
    resolution: NDArray[np.float64] | float = 0.0
    seed: int = 0
    run: int = 0
    first_sample: float = 0.0
    measure_delay: float = 0.0
    loss: float = 0.0
    jitter: float = 0.0
    jitter_kind: Jitter = "uniform"
    rate_limit: float | None = None
    no_load_rate: float | None = None
    dead_zone: NDArray[np.float64] | float = 0.0
    switch: GainSwitch | None = None
    outer: SampledController | None = None

    def __post_init__(self) -> None:
        of = "SampledController.{}".format
        self._set("period", checks.positive(of("period"), self.period))
        for name in ("first_sample", "measure_delay", "delay", "jitter", "loss"):
            self._set(name, checks.non_negative(of(name), getattr(self, name)))
        if self.jitter >= self.period:
            rule = f"must be below the period, {self.period:g}, so that no sample overtakes another"
            raise ValueError(f"{of('jitter')} = {self.jitter}: {rule}")
        checks.number_that(of("loss"), self.loss, lambda x: x < 1.0, "must be >= 0 and < 1")
        checks.choice(of("jitter_kind"), self.jitter_kind, JITTERS)
        for name in ("rate_limit", "no_load_rate"):
            if getattr(self, name) is not None:
                self._set(name, checks.positive(of(name), getattr(self, name)))
        self._set("measures", checks.names(of("measures"), self.measures, _core.MEASURES))
        m = sum(_core.MEASURES[name] for name in self.measures)
        n = 0 if self.A is None else next(iter(checks.numbers(of("A"), self.A).shape), 0)
        if n == 0 and any(value is not None and np.size(value) for value in (self.B, self.C)):
            rule = "must be (n, n), because B or C is given"
            raise ValueError(f"SampledController.A = {checks.shown(self.A)}: {rule}")
        for name, shape in (("A", (n, n)), ("B", (n, m)), ("C", (2, n)), ("D", (2, m))):
            value = getattr(self, name)
            if value is None and name in "BC" and n:
                rule = f"must have shape {shape}, to fit A and measures"
                raise ValueError(f"{of(name)} = None: {rule}")
            none = value is None or (np.size(value) == 0 and 0 in shape)
            self._set(name, checks.array(of(name), np.zeros(shape) if none else value, shape))
        if n == 0 and self.D is not None and not self.D.any():
            rule = "give D, or A, B and C (`pid` makes them)"
            raise ValueError(f"SampledController: it has no gains; {rule}")
        self._set("limits", _limits(self.limits))
        if self.no_load_rate is not None:
            low, high = (-math.inf, math.inf) if self.limits is None else self.limits.T
            around = (np.maximum(low, -high) <= 0.0) & np.isfinite(np.subtract(high, low))
            if not np.all(around) or "angle_rate" not in self.measures:
                rule = 'needs finite limits, below and above 0, and the measure "angle_rate"'
                raise ValueError(f"{of('no_load_rate')} = {self.no_load_rate}: {rule}")
        torque = checks.pair(of("initial_torque"), self.initial_torque)
        self._set("initial_torque", torque)
        begin = np.zeros(n) if self.initial_state is None else self.initial_state
        self._set("initial_state", checks.array(of("initial_state"), begin, (n,)))
        if self.limits is not None and (np.clip(torque, *self.limits.T) != torque).any():
            rule = f"must be within the limits {self.limits.tolist()} of the right and left finger"
            raise ValueError(f"{of('initial_torque')} = {checks.shown(torque)}: {rule}")
        self._set("anti_windup", checks.boolean(of("anti_windup"), self.anti_windup))
        for name in _OF_EACH:
            self._set(name, self._of_each(name, getattr(self, name)))
        for name in ("seed", "run"):
            self._set(name, checks.integer(of(name), getattr(self, name), 0, 2**64 - 1))
        if self.switch is not None:
            checks.instance(of("switch"), self.switch, GainSwitch)
            checks.choice(
                "GainSwitch.measure", self.switch.measure or self.measures[0], self.measures
            )
            for name, own in self.switch.gains.items():
                checks.array(f"GainSwitch.{name}", own, getattr(self, name).shape)
        if self.outer is not None:
            checks.instance(of("outer"), self.outer, SampledController)
            if (self.outer.seed, self.outer.run) != (self.seed, self.run):
                self._set("outer", replace(self.outer, seed=self.seed, run=self.run))

    def _of_each(self, name: str, value: object) -> Floats:
        """Returns one number that is not negative for each entry of y."""
        place = f"SampledController.{name}"
        widths = [_core.MEASURES[measure] for measure in self.measures]
        if isinstance(value, Mapping):
            checks.refuse_unknown(place, value, self.measures, "")
            for known in sorted(_KNOWN & value.keys() if name != "dead_zone" else ()):
                if checks.number(f"{place}[{known!r}]", value[known]) != 0.0:
                    rule = "must be 0, because no sensor measures it"
                    raise ValueError(f"{place}[{known!r}] = {checks.shown(value[known])}: {rule}")
            value = [checks.number(f"{place}[{k!r}]", value.get(k, 0.0)) for k in self.measures]
            value = np.repeat(value, widths)
        found = checks.number_or_array(place, value, checks.non_negative)
        return checks.array(place, found * np.ones(np.shape(found) or sum(widths)), (sum(widths),))

    @classmethod
    def pid(
        cls, period: float, kp: float = 100.0, kd: float = 1.0, ki: float = 1000.0, **settings: Any
    ) -> Self:
        """Makes the sampled form of the PID (39): u = -K_P e - K_D theta-dot - K_I sum(e) period.

        The continuous PID is its limit as the period goes to zero. The default gains are those of
        `Pid`; with the default hand they are unstable from a delay of 1 ms on, where kp = 4,
        kd = 0.05 and ki = 20 are stable. Give all three gains. In studies those of the right and
        the left finger are -`D.0.0` and -`D.1.1` (kp), -`D.0.2` and -`D.1.3` (kd), -`C.0.0` and
        -`C.1.1` (ki). Units are those of `Pid`; `settings` are other fields.
        """
        period = checks.positive("SampledController.period", period)
        gains = {"kp": kp, "kd": kd, "ki": ki}
        kp, kd, ki = (checks.finite(f"SampledController.pid: {k}", v) for k, v in gains.items())
        one, zero = np.eye(2), np.zeros((2, 2))
        b, d = np.hstack([period * one, zero]), np.hstack([-kp * one, -kd * one])
        settings = {"measures": ("angle_error", "angle_rate")} | settings
        return cls(period, one, b, -ki * one, d, **settings)

    @classmethod
    def cascade(cls, blocks: Iterable[SampledController]) -> SampledController:
        """Makes one controller of several blocks, of which each gives the next one its targets.

        The schedule has the targets of the first block. The outputs of each block (after its limits
        and delays) are the targets of the next one, also in "angle_error", and those of the last
        one are the torques. At an instant that a block shares with a sample of the last one, but
        for round-off, it acts first. The result is the last block, whose seed and run are those of
        all, with the one before it as its `outer`, whose paths begin with "control.outer.".
        """
        name = "cascade: blocks"
        given = checks.several(name, blocks, "several SampledControllers")
        checks.integer(f"{name}: their number", len(given), 1, 16)
        for k, block in enumerate(given):
            checks.instance(f"{name}[{k}]", block, SampledController)
            if block.outer is not None:
                raise ValueError(f"{name}[{k}].outer is given: must be None, the list has them all")
        whole: SampledController = reduce(lambda outer, own: replace(own, outer=outer), given)
        return whole

    def blocks(self) -> Iterator[tuple[str, SampledController]]:
        """Yields the blocks and their paths in a scene, the last one of the cascade first."""
        yield "control", self
        for path, block in self.outer.blocks() if self.outer is not None else ():
            yield f"control.outer{path.removeprefix('control')}", block

    def gains_at(self, time: float) -> SampledController:
        """The cascade with the gains that act at an instant, s; at inf, all second sets, for ever.

        At -inf they are the first ones. Else a measure that decides raises a `ValueError`.
        """
        switch, ever = self.switch, math.isinf(checks.not_nan("time", time))
        outer = None if self.outer is None else self.outer.gains_at(time)
        if switch is None:
            return self if outer is self.outer else replace(self, outer=outer)
        second = time == math.inf or (switch.at is not None and switch.at <= time)
        if switch.measure is not None and not (second or ever):
            rule = "decides which gains act; control.gains_at(inf) or (-inf) has one set"
            raise ValueError(f"GainSwitch.measure = {switch.measure!r}: {rule}")
        gains: dict[str, Any] = switch.gains if second else {}
        return replace(self, outer=outer, switch=None if ever else switch, **gains)

    @property
    def passes_targets(self) -> bool:
        """True if what is measured is added to the targets, and the sum is the output."""
        k = 0
        for name in self.measures:
            if name == "target":
                return bool((np.asarray(self.D)[:, k : k + 2] == np.eye(2)).all())
            k += _core.MEASURES[name]
        return False

    def compile_runs(self, values: Mapping[str, Any]) -> Compiled:
        """Returns this block as the core takes it; `values` differ between runs -> (runs, ...)."""
        own, switched = _NONE | _many(self, values), None
        parts = [own[name] for name in _NUMBERS]
        if (switch := self.switch) is not None:
            own |= _many(switch, values.get("switch", {}))
            parts += [own[name] for name in (*"ABCD", "at", "above", "below")]
            switched = switch.measure or "", switch.latched
        runs = max(map(len, parts))
        parts = [np.broadcast_to(part, (runs, *part.shape[1:])) for part in parts]
        rows = np.hstack([part.reshape(runs, -1) for part in parts])
        how = self.anti_windup, self.jitter_kind == "normal"
        states = 0 if self.A is None else len(self.A)
        return list(self.measures), states, how, np.ascontiguousarray(rows), switched


def _many(record: Record, values: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that are not None, with an axis for the runs."""
    return {k: x for k, x in bare(record, values)._values().items() if x is not None}


def _limits(value: object) -> Floats | None:
    if value is None:
        return None
    given = checks.numbers("SampledController.limits", value)
    place = f"SampledController.limits = {checks.shown(value)}"
    if given.shape not in ((2,), (2, 2)):
        raise ValueError(f"{place}: must be (smallest, largest), or one such pair for each finger")
    pairs = np.array(np.broadcast_to(given, (2, 2)))
    low, high = pairs.T
    if not ((low <= high) & (low < np.inf) & (high > -np.inf)).all():
        raise ValueError(
            f"{place}: the smallest must not exceed the largest, and leave a finite torque"
        )
    return read_only(pairs)


Control: TypeAlias = Pid | tuple[Pid, Pid] | Torque | SampledController

# The entry `kind` of a scene file -> class. A PID has none.
LAWS: dict[str, type[Law]] = {"torque": Torque, "sampled": SampledController}
Law._kinds = LAWS
SampledController._parsers = {"outer": SampledController._parse, "switch": GainSwitch._parse}
# `Scene.law` -> what moves the fingers then, as it is written.
WRITTEN = {
    "pid": "control=Pid(...)",
    "torque": "control=Torque()",
    "sampled": "control=SampledController(...)",
    "driven": 'fingers="driven"',
}


def pids_of(control: object) -> tuple[Pid, Pid]:
    """Returns the PIDs of the right and the left finger of a scene that PIDs or a schedule move."""
    right, left = control if isinstance(control, tuple) else (control, control)
    assert isinstance(right, Pid) and isinstance(left, Pid)
    return right, left


# One PID, one for each side, or a table with `kind`.
parse_control = or_other(one_or_pair(Pid), Law)


def require_known_torque(law: str, name: str, advice: str = "") -> None:
    """Refuses a `SampledController`, whose torques depend on the run; `name` is the function."""
    if law == "sampled":
        rule = "needs the torques at a state, which depend on the run"
        usual = "replace(scene, control=Torque(), schedule=...) is the one between two samples"
        raise ValueError(f"Scene.{WRITTEN[law]}: {name} {rule}; {advice or usual}")
