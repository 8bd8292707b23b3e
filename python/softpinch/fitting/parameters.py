"""The numbers that a fit varies, and the coordinates in which it searches."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..scene.paths import resolve
from ..scene.scene import Scene
from ..scene.template import SceneTemplate
from ..scene.units import units
from ..support import checks
from ..support.arrays import Floats
from ..support.result import Result

# Bounds with at least this ratio are searched in the logarithm.
_DECADES = 10.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Parameter(Result):
    """A number that is fitted.

    The search has the coordinate u, which is 0 at `start` and grows by 1 over `span`. So a step of
    one is the whole allowed range, or if that is infinite a decade (with `log`) or the size of the
    start.

    Attributes:
        path: Its dotted path.
        unit: Its unit.
        low: The least allowed value, which may be -inf.
        high: The largest allowed value, which may be inf.
        start: Where the search starts.
        log: Whether u is proportional to the logarithm of the value.
        span: The change of the value, or of its natural logarithm, along a step of one in u.
    """

    path: str
    unit: str
    low: float
    high: float
    start: float
    log: bool
    span: float

    def value(self, u: float) -> float:
        """Returns the value at the coordinate u, within the bounds."""
        with np.errstate(over="ignore"):
            step = np.float64(self.span) * u
            found = self.start * np.exp(step) if self.log else self.start + step
        return float(min(max(found, self.low), self.high))

    def slope(self, u: float) -> float:
        """Returns the derivative of the value by u."""
        return self.value(u) * self.span if self.log else self.span

    def coordinate(self, value: float) -> float:
        """Returns u of a value; -inf for 0 and `log`."""
        if not self.log:
            return (value - self.start) / self.span
        return math.log(value / self.start) / self.span if value > 0.0 else -math.inf

    @property
    def room(self) -> float:
        """The width of an interval of u from which on the number counts as not determined."""
        low, high = self.bounds
        return min(high - low, 3.0 if self.log else 1e3)

    @property
    def bounds(self) -> tuple[float, float]:
        """The bounds of u."""
        return self.coordinate(self.low), self.coordinate(self.high)


def parameters(
    scenes: Sequence[Scene],
    vary: Mapping[str, object],
    start: Mapping[str, object] | None,
) -> tuple[Parameter, ...]:
    """Makes the parameters of a fit; the first scene has the values from which the search starts.

    Raises:
        ValueError: A path does not exist in each scene or is not a number, bounds are not in
            order, or a start is outside of them.
        TypeError: An argument has the wrong type.
    """
    if not isinstance(vary, Mapping):
        raise TypeError(
            f"vary = {checks.shown(vary)}: must map paths to bounds (low, high), or to None"
        )
    if not vary:
        raise ValueError("vary = {}: must have at least one path")
    for path in vary:
        if not isinstance(path, str):
            raise TypeError(
                f"vary: the key {checks.shown(path)} must be one path; one number for several "
                "paths is not supported"
            )
    templates = [SceneTemplate(scene, vary, 0) for scene in scenes]
    if start is not None and not isinstance(start, Mapping):
        raise TypeError(f"start = {checks.shown(start)}: must map paths of vary to numbers")
    for path in start or {}:
        checks.choice("start", path, vary)
    return tuple(
        _parameter(templates[0], path, bounds, start or {}) for path, bounds in vary.items()
    )


def _parameter(
    template: SceneTemplate, path: str, bounds: object, start: Mapping[str, object]
) -> Parameter:
    name = f'vary["{path}"]'
    if path == "duration":
        raise ValueError('vary: "duration": the measured times determine it')
    if shape := template.shapes[path]:
        raise ValueError(
            f"vary: {path!r} has shape {shape}: must be one number, such as "
            f"{'.'.join([path, *['0'] * len(shape)])!r}"
        )
    value = _value(template, path)
    low, high = (-math.inf, math.inf) if bounds is None else _bounds(name, bounds)
    log = low > 0.0 and math.log(high) - math.log(low) >= math.log(_DECADES)
    if bounds is None and value > 0.0 and _refuses(template, {path: -value}):
        low, log = 0.0, True
    value = min(max(value, low), high)
    if path in start:
        value = checks.finite(f'start["{path}"]', start[path])
        if not low <= value <= high or (log and value <= 0.0):
            raise ValueError(
                f'start["{path}"] = {value}: must be within the bounds {low:g} and {high:g}'
            )
    if log:
        finite = low > 0.0 and math.isfinite(high)
        span = math.log(high) - math.log(low) if finite else math.log(_DECADES)
    else:
        span = high - low if math.isfinite(high - low) else abs(value) or 1.0
    unit = units(path, ())
    assert isinstance(unit, str)
    return Parameter(path=path, unit=unit, low=low, high=high, start=value, log=log, span=span)


def _value(template: SceneTemplate, path: str) -> float:
    """The scene's own value, which for a mass of a tip that is None is the mass of the object."""
    slots = template.slots.get(path)
    return float(template.scene.parameters()[slots[0]] if slots else resolve(template.scene, path))


def _bounds(name: str, given: object) -> tuple[float, float]:
    ends = checks.several(name, given, "bounds (low, high), or None", at_most=1000)
    if len(ends) != 2:
        raise ValueError(f"{name} = {checks.shown(given)}: must be bounds (low, high), or None")
    low, high = (
        checks.not_nan(f"{name}: {end}", each)
        for end, each in zip(("low", "high"), ends, strict=True)
    )
    if not low < high:
        raise ValueError(f"{name}: high = {high:g}: must be above low = {low:g}")
    return low, high


def _refuses(template: SceneTemplate, values: Mapping[str, float]) -> bool:
    try:
        template.changed(values)
    except ValueError:
        return True
    return False


def values(parameters: Sequence[Parameter], u: Floats) -> dict[str, float]:
    """Returns path -> value at the coordinates u (p,)."""
    return {each.path: each.value(at) for each, at in zip(parameters, u.tolist(), strict=True)}


def slopes(parameters: Sequence[Parameter], u: Floats) -> Floats:
    """Returns the derivatives of the values by u (p,)."""
    return np.array([each.slope(at) for each, at in zip(parameters, u.tolist(), strict=True)])
