"""The loop of a `SampledController` and a linear motion, over the common period of its blocks.

Between two instants of a block the torques are held, so a linear motion has an exact discrete-time
model. With the states of the blocks, their outputs and what they have measured it is the loop,
whose spectral radius is the factor by which a deviation grows in each period. Limits, dead zones,
lost samples and jitter are left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from .. import _core
from ..support.arrays import Complexes, Floats
from .control import SampledController
from .parts import Jaw

if TYPE_CHECKING:
    from .scene import Scene

# With more torques under way the matrix of the loop is too large to compute.
MOST_UNDER_WAY = 50
# A mode whose factor in a period is so close to 1 neither grows nor decays: that is round-off.
NEUTRAL = 1e-8
# A common period has at most so many periods of the last block.
_MOST_SAMPLES = 2000
# Instants that are closer than this share of a period are one.
SAME = 1e-9
# Terms of the exponential series, of a matrix whose norm is at most one half.
_TERMS = 16
# Measure -> its places among the angles and then the rates of the fingers.
_OF_FINGERS = {"angle": [0, 1], "angle_error": [0, 1], "angle_rate": [2, 3]}
# Measures that depend on no state.
_GIVEN = {"target", "target_rate", "schedule", "accelerometer", "gyroscope"}


def common_period(control: SampledController) -> tuple[float, str]:
    """The common period of the blocks, s, and an empty text; or inf, and why there is no loop."""
    last, common = control.period, 1
    for path, block in control.blocks():
        ratio = Fraction(min(block.period / last, 1e9)).limit_denominator(_MOST_SAMPLES)
        common = math.lcm(common, ratio.numerator)
        if abs(float(ratio) * last - block.period) > SAME * block.period or common > _MOST_SAMPLES:
            rule = f"must have a common period with control.period = {last}, of at most"
            return math.inf, f"{path}.period = {block.period}: {rule} {_MOST_SAMPLES} of these"
        for name in ("measure_delay", "delay"):
            if getattr(block, name) > MOST_UNDER_WAY * block.period:
                rule = f"must be at most {MOST_UNDER_WAY} periods of its block"
                return math.inf, f"{path}.{name} = {getattr(block, name)}: {rule}"
    return common * last, ""


def driving(block: SampledController) -> list[int]:
    """Places of the states that drive an output, unlike those of a PD law made by `pid`."""
    a, drive = np.asarray(block.A) != 0.0, np.any(block.C, axis=0)
    for _ in a:
        drive = drive | (drive @ a)
    return np.flatnonzero(drive).tolist()


def factors(
    control: SampledController, a: Floats, b: Floats, measures: Sequence[tuple[Floats, Floats]]
) -> Complexes:
    """The factors of the loop's modes in a `common_period`; nan if a number overflows.

    The motion is x' = a x + b v (n, n), (n, 2), under the torques v. Each block, the last one
    first, measures h x + j v (m, n), (m, 2).
    """
    with np.errstate(all="ignore"):
        loop = _matrix(control, a, b, measures)
    if not np.isfinite(loop).all():
        return np.full(len(loop), complex(np.nan, np.nan))
    return np.linalg.eigvals(loop).astype(complex)


def spectral_radius(
    control: SampledController, a: Floats, b: Floats, measures: Sequence[tuple[Floats, Floats]]
) -> float:
    """The largest magnitude of the `factors`; nan if a number overflows."""
    return float(np.abs(factors(control, a, b, measures)).max())


def _matrix(
    control: SampledController, a: Floats, b: Floats, measures: Sequence[tuple[Floats, Floats]]
) -> Floats:
    """The matrix of the loop over a common period.

    It is of x and, of each block, xi, the outputs in force and, newest first, those that may be
    under way and the measurements that may be. Its rows begin as those of the identity, and follow
    the instants of the period.
    """
    blocks = [block for _, block in control.blocks()]
    period, tick = common_period(control)[0], SAME * min(block.period for block in blocks)
    parts, instants, stop, drive = [], [], len(a), [driving(block) for block in blocks]
    for k, block in enumerate(blocks):
        delays = np.array([0.0, block.measure_delay, block.delay])
        late = (delays / block.period + SAME).astype(int)
        m = len(measures[k][0])
        sizes = len(drive[k]), 2, 2 * late[2] + 2, (late[1] + 1) * m
        ends = stop + np.cumsum([0, *sizes])
        parts.append([slice(*ends[i : i + 2]) for i in range(4)])
        stop = int(ends[-1])
        for number in range(round(period / block.period)):
            taken = block.first_sample + number * block.period
            for stage, time in enumerate(taken + np.cumsum(delays)):
                place = round(time % period / tick) % round(period / tick)
                instants.append((place, -k, stage, int(late[stage])))
    rows = np.eye(stop)
    x, now = slice(0, len(a)), 0
    held: dict[int, tuple[Floats, Floats]] = {}
    for place, k, stage, late_by in [*sorted(instants), (round(period / tick), 1, 0, 0)]:
        if place > now:
            if place - now not in held:
                held[place - now] = _held(a, b, tick * (place - now))
            free, forced = held[place - now]
            rows[x] = free @ rows[x] + forced @ rows[parts[0][1]]
            now = place
        if k > 0:
            break
        block, (h, j), (xi, force, outputs, seen) = blocks[-k], measures[-k], parts[-k]
        if stage == 0:
            y = h @ rows[x] + j @ rows[parts[0][1]]
            rows[seen] = np.vstack([y, rows[seen]])[: seen.stop - seen.start]
        elif stage == 1:
            y = rows[seen][late_by * len(h) :][: len(h)].copy()
            first = 0
            for name in block.measures:
                sign = {"target": 1.0, "angle_error": -1.0}.get(name, 0.0)
                if sign and 1 - k < len(blocks):
                    y[first : first + 2] += sign * rows[parts[1 - k][1]]
                first += _core.MEASURES[name]
            own, n = [np.asarray(getattr(block, name)) for name in "ABCD"], drive[-k]
            u = own[2][:, n] @ rows[xi] + own[3] @ y
            rows[xi] = own[0][np.ix_(n, n)] @ rows[xi] + own[1][n] @ y
            rows[outputs] = np.vstack([u, rows[outputs]])[: outputs.stop - outputs.start]
        else:
            rows[force] = rows[outputs][2 * late_by :][:2]
    return rows


def _held(a: Floats, b: Floats, time: float) -> tuple[Floats, Floats]:
    """F and G of x(t + time) = F x(t) + G u with held inputs u."""
    size, whole = len(a), len(a) + b.shape[1]
    generator = np.zeros((whole, whole))
    generator[:size] = time * np.hstack([a, b])
    norm = float(np.abs(generator).sum(axis=0).max())
    if not math.isfinite(norm):
        return np.full(a.shape, np.nan), np.full(b.shape, np.nan)
    halvings = max(0, math.frexp(norm)[1] + 1)
    step = np.ldexp(generator, -halvings)
    found = np.eye(whole)
    for k in range(_TERMS, 0, -1):
        found = np.eye(whole) + step @ found / k
    for _ in range(halvings):
        found = found @ found
    return found[:size, :size], found[:size, size:]


def measured(
    control: SampledController, places: Mapping[str, list[int]], c: Floats, d: Floats
) -> list[tuple[Floats, Floats]]:
    """H (m, n) and J (m, 2) of each block, which measures y = H x + J v under the torques v.

    `places` has the rows of each measure in c (k, n) and d (k, 2); other measures are constant.
    """

    def of(block: SampledController, by: Floats) -> Floats:
        none = [np.zeros((_core.MEASURES[name], by.shape[1])) for name in block.measures]
        rows = zip(block.measures, none, strict=True)
        return np.vstack([by[places[name]] if name in places else zero for name, zero in rows])

    return [(of(block, c), of(block, d)) for _, block in control.blocks()]


def growth(scene: Scene, control: SampledController) -> float:
    """The factor by which the swings of free fingers grow in one common period; 0.0: unknown.

    It is that of the worse gains, and unknown if blocks measure more than fingers, or have no loop.
    """
    names = {name for _, block in control.blocks() for name in block.measures}
    if not names <= _OF_FINGERS.keys() | _GIVEN or common_period(control)[0] == math.inf:
        return 0.0
    # A finger that touches nothing moves by I theta'' = u, without gravity.
    a, b = np.zeros((4, 4)), np.zeros((4, 2))
    a[:2, 2:] = np.eye(2)
    fingers = (scene.hand.right, scene.hand.left)
    with np.errstate(all="ignore"):
        b[2:] = np.diag([1.0 / (f.mass if isinstance(f, Jaw) else f.inertia) for f in fingers])
    found = measured(control, _OF_FINGERS, np.eye(4), np.zeros((4, 2)))
    sets = {control.gains_at(-math.inf), control.gains_at(math.inf)}
    factors = [spectral_radius(own, a, b, found) for own in sets]
    return 0.0 if np.isnan(factors).any() else max(factors)
