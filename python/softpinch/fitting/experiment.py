"""One measured motion: its scene, the data, and a simulation of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..run.options import Options
from ..run.run import Run
from ..run.scaled_error import usual
from ..run.simulate import not_interrupted, simulate
from ..scene.scene import Scene
from ..scene.template import SceneTemplate
from ..support import checks
from ..support.arrays import Floats
from ..support.result import Result
from .interpolation import Interpolation
from .observables import PLACES, columns

# Noise below this share of a typical size of the scene is round-off.
_ROUND_OFF = 1e-12

# Residuals over a smaller noise would overflow when they are squared.
_LEAST_NOISE = 1e-100


class FailedRun(ValueError):
    """A run that did not reach the last measured time."""


class Motion(NamedTuple):
    """A simulated motion at the measured instants.

    Attributes:
        table: The columns (n, c).
        slope: Their derivatives by the parameters (n, c, p), or None.
        violations: Name of each violation of the model's assumptions -> when it was first seen, s.
    """

    table: Floats
    slope: Floats | None
    violations: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Experiment(Result):
    """A measured motion of one scene, and its fitted motion.

    Attributes:
        scene: The scene, before the fit.
        times: The measured instants (n,), s, on the clock of the scene's start.
        observables: Names of what was measured, as given -> the names of its columns.
        columns: The names of all c columns.
        units: Their units.
        data: What was measured (n, c), in SI units; NaN where nothing was.
        noise: The standard deviation of each column's noise (c,); NaN before it is estimated.
        estimated: Whether the noise is estimated from the residuals (c,).
        fitted: The same of the fitted scene (n, c), without gaps; NaN before the fit.
        violations: `Run.violations` of the fitted motion.
    """

    scene: Scene
    times: Floats
    observables: Mapping[str, tuple[str, ...]]
    columns: tuple[str, ...]
    units: tuple[str, ...]
    data: Floats
    noise: Floats
    estimated: NDArray[np.bool_]
    fitted: Floats
    violations: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def checked(
        cls, scene: Scene, times: object, measured: object, noise: object, where: str = ""
    ) -> Experiment:
        """Checks the data of an experiment.

        Args:
            scene: The scene.
            times: The instants (n,), s.
            measured: Observable -> values (n,) or (n, k).
            noise: None, a number, or observable -> a number or numbers (k,).
            where: The place in a list of experiments, for error messages, such as "[0]".

        Raises:
            ValueError: A value breaks its rule.
            TypeError: A value has the wrong type.
        """
        instants = _instants(f"times{where}", times, scene)
        if not isinstance(measured, Mapping):
            raise TypeError(
                f"measured{where} = {checks.shown(measured)}: must map names of observables, such "
                'as "rotation", to arrays'
            )
        if not measured:
            raise ValueError(f"measured{where} = {{}}: must have at least one observable")
        observables = {name: columns(name) for name in measured}
        owner: dict[str, str] = {}
        blocks = []
        for name, own in observables.items():
            for column in own:
                if owner.setdefault(column, name) != name:
                    raise ValueError(
                        f'measured{where}: "{owner[column]}" and "{name}" both have {column}'
                    )
            blocks.append(_values(f'measured{where}["{name}"]', measured[name], own, instants))
        data = np.hstack(blocks)
        if not np.isfinite(data).any():
            raise ValueError(f"measured{where}: has no number, only NaN")
        found = _noise(where, noise, observables)
        return cls(
            scene=scene,
            times=instants,
            observables=observables,
            columns=tuple(owner),
            units=tuple(PLACES[column].unit for column in owner),
            data=data,
            noise=found,
            estimated=np.isnan(found),
            fitted=np.full_like(data, np.nan),
        )

    @property
    def residuals(self) -> dict[str, Floats]:
        """Observable -> measured minus fitted (n,) or (n, k), in SI units; NaN where no data is."""
        return self._split(self.data - self.fitted)

    def _split(self, table: Floats) -> dict[str, Floats]:
        found, first = {}, 0
        for name, own in self.observables.items():
            block = table[:, first : first + len(own)]
            found[name] = block[:, 0] if len(own) == 1 else block
            first += len(own)
        return found

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where there is a measurement (n, c)."""
        return np.isfinite(self.data)

    @property
    def least_noise(self) -> Floats:
        """The noise (c,) below which there is only round-off."""
        sizes = usual(self.scene)
        radius = max(tip.radius for tip in self.scene.hand.tips)
        sizes["torque"] = radius * sizes["multipliers"][:2]
        places = [PLACES[column] for column in self.columns]
        return _ROUND_OFF * np.array([sizes[each.quantity][each.column] for each in places])

    def simulated(
        self,
        template: SceneTemplate,
        values: Mapping[str, float],
        options: Options,
        derivatives: bool,
    ) -> Motion:
        """Simulates the scene with values put in, at the measured instants.

        Args:
            template: A template of the scene.
            values: Path -> value.
            options: How to simulate.
            derivatives: Whether to compute them too.

        Raises:
            FailedRun: The values break a rule of the scene, or the run ends too early.
        """
        paths = tuple(values)
        how = options.numerics()
        if options.tolerance is not None:
            how["times"] = self.times
        wanted = paths if derivatives else ()
        try:
            scene = self._shortened(template.changed(values), options)
            run = simulate(scene, **how, record=self._recorded, sensitivities=wanted)
        except ValueError as error:
            raise FailedRun(str(error)) from None
        not_interrupted(run)
        if not run.success:
            raise FailedRun(f"the run ends as {run.status}: {run.message}")
        rows = Interpolation(run, self.times)
        table = self._columns(rows, _quantities(run))
        slope = self._columns(rows, _derivatives(run, paths)) if derivatives else None
        return Motion(table, slope, run.violations)

    @property
    def _recorded(self) -> tuple[str, ...]:
        return tuple(
            dict.fromkeys(
                "state" if (quantity := PLACES[column].quantity) in ("q", "p") else quantity
                for column in ("x", *self.columns)
            )
        )

    def _shortened(self, scene: Scene, options: Options) -> Scene:
        """Returns the scene up to the last measured time."""
        duration = float(self.times[-1]) - scene.start().time
        if options.tolerance is not None:
            duration *= 1.0 + 1e-12  # rounding must not put the last time behind the end
        return replace(scene, duration=duration) if duration < scene.duration else scene

    def _columns(self, rows: Interpolation, of: Mapping[str, Floats]) -> Floats:
        q, p = rows.state(of["q"], of["p"])
        found = {"q": q, "p": p}
        for name in self._recorded[1:]:
            found[name] = rows.other(of[name])
        places = [PLACES[column] for column in self.columns]
        return np.stack([found[each.quantity][:, each.column] for each in places], axis=1)


def _quantities(run: Run) -> dict[str, Floats]:
    found = {"q": run.q, "p": run.p}
    for name in ("multipliers", "torque"):
        if name in run.record:
            found[name] = getattr(run, name)
    return found


def _derivatives(run: Run, paths: tuple[str, ...]) -> dict[str, Floats]:
    """The derivatives of the quantities by the values at the paths: (rows, columns, p)."""
    sensitivity = run.sensitivity
    state = np.stack([sensitivity[path] for path in paths], axis=-1)
    found = {"q": state[:, :9], "p": state[:, 9:]}
    for name in ("multipliers", "torque"):
        if name in run.record:
            of = getattr(sensitivity, name)
            found[name] = np.stack([of[path] for path in paths], axis=-1)
    return found


def _instants(name: str, times: object, scene: Scene) -> Floats:
    found = checks.times(name, times)
    begin = scene.start().time
    end = begin + scene.duration
    if found[0] < begin:
        raise ValueError(f"{name}[0] = {found[0]}: must be at least the scene's start, {begin} s")
    if found[-1] > end + 1e-12 * max(abs(end), scene.duration):
        raise ValueError(
            f"{name}[{len(found) - 1}] = {found[-1]}: must be at most the scene's end, {end} s"
        )
    if found[-1] == begin:
        raise ValueError(f"{name} = [{begin}]: must have an instant after the scene's start")
    return found


def _values(name: str, given: object, own: tuple[str, ...], times: Floats) -> Floats:
    table = checks.numbers(name, given)
    wanted = (len(times),) if len(own) == 1 else (len(times), len(own))
    if table.shape != wanted:
        raise ValueError(
            f"{name} has shape {table.shape}: must have shape {wanted}, a row for each time"
            + ("" if len(own) == 1 else f" and the columns {', '.join(own)}")
        )
    if np.isinf(table).any():
        row = int(np.argwhere(np.isinf(table))[0][0])
        raise ValueError(f"{name}[{row}] is infinite: must be finite, or NaN without measurement")
    return table.reshape(len(times), len(own))


def _deviation(name: str, given: object) -> float:
    """Checks a standard deviation, which must not be so small that residuals over it overflow."""
    found = checks.positive(name, given)
    if found < _LEAST_NOISE:
        raise ValueError(f"{name} = {found}: must be at least {_LEAST_NOISE}")
    return found


def _noise(where: str, noise: object, observables: Mapping[str, tuple[str, ...]]) -> Floats:
    """The noise of each column (c,); NaN if it is to be estimated."""
    name = f"noise{where}"
    if not isinstance(noise, Mapping):
        one = math.nan if noise is None else _deviation(name, noise)
        return np.full(sum(map(len, observables.values())), one)
    for key in noise:
        checks.choice(name, key, observables)
    found = []
    for observable, own in observables.items():
        given = noise.get(observable)
        label = f'{name}["{observable}"]'
        each = (
            np.array(math.nan)
            if given is None
            else np.asarray(checks.number_or_array(label, given, _deviation))
        )
        if each.ndim and each.shape != (len(own),):
            raise ValueError(
                f"{label} has shape {each.shape}: must be a number or {len(own)} numbers"
            )
        found.append(np.broadcast_to(each, len(own)))
    return np.concatenate(found)
