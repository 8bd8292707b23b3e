"""One measured motion: the names of what can be measured, scene, data, and their simulation."""

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..analysis.states import output_ports
from ..run import scaled_error
from ..run.options import Options
from ..run.request import Request
from ..run.run import computed
from ..run.simulate import warn_of_steps
from ..scene import usual
from ..scene.fields import QUANTITIES, of_column
from ..scene.parts import jaws
from ..scene.paths import with_numbers
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats
from ..support.errors import StabilityWarning
from ..support.result import Result

# Noise below this share of a typical size of the scene is round-off.
_ROUND_OFF = 1e-12


class ObservableIndex(NamedTuple):
    """The place of a column in a run: the name of an array, the index in it, and the unit."""

    quantity: str
    column: int
    unit: str


_MEASURABLE = ("q", "p", "multipliers", "torque")
# Name of a column -> where it is.
INDICES: Mapping[str, ObservableIndex] = {
    name: ObservableIndex(quantity, column, QUANTITIES[quantity].units[column])
    for quantity in _MEASURABLE
    for column, name in enumerate(QUANTITIES[quantity].columns)
}
# Group -> its columns. Those of `sp.linearize` have the coordinates' own names.
GROUPS: Mapping[str, tuple[str, ...]] = {
    **{quantity: QUANTITIES[quantity].columns for quantity in _MEASURABLE},
    **{
        group: output_ports((group,)).names
        for group in ("pose", "fingers", "compressions", "shears", "rates")
    },
    "position": ("x", "y"),
    "rotation": ("theta",),
}
NAMES = (*GROUPS, *(name for name in INDICES if name not in GROUPS))


def columns(name: object) -> tuple[str, ...]:
    """Returns the columns of an observable."""
    known = checks.choice("measured", name, NAMES)
    return GROUPS.get(known, (known,))


class FailedRun(ValueError):
    """A run that did not reach the last measured time."""


class Motion(NamedTuple):
    """A simulated motion at the measured instants."""

    table: Floats  # the columns (n, c)
    slope: Floats | None  # their derivatives by the parameters (n, c, p)
    violations: Mapping[str, float]  # those of `Run.violations`
    lost: tuple[str, ...] = ()  # the paths by which it has differences from an event on


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Experiment(Result):
    """A measured motion of one scene, and its fitted motion.

    Attributes:
        scene: The scene, before the fit.
        times: The measured instants (n,), s, on the clock of the scene's start.
        observables: Names of what was measured, as given -> the names of its columns.
        columns: The names of all c columns, which have the `units`.
        data: What was measured (n, c), in SI units; NaN where nothing was.
        noise: The standard deviation of each column's noise (c,); NaN before it is estimated.
        estimated: Whether the noise is estimated from the residuals (c,).
        fitted: The columns of the fitted motion (n, c), without gaps; NaN before the fit.
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
    ) -> Self:
        """Checks the arguments of `fit` for an experiment, the one at `where` ("[0]") in a list."""
        name = f"times{where}"
        instants, begin = checks.times(name, times), scene.start().time
        end = begin + scene.duration
        if instants[0] < begin or instants[-1] > end + 1e-12 * max(abs(end), scene.duration):
            raise ValueError(f"{name}: must be from {begin} to {end} s, the time of the scene")
        if instants[-1] == begin:
            raise ValueError(f"{name} = [{begin}]: must have an instant after the scene's start")
        kind = 'a mapping of observables, such as "rotation", to arrays'
        checks.instance(f"measured{where}", measured, Mapping, kind)
        assert isinstance(measured, Mapping)
        if not measured:
            raise ValueError(f"measured{where} = {{}}: must have at least one observable")
        observables = {name: columns(name) for name in measured}
        owner: dict[str, str] = {}
        blocks = []
        for name, own in observables.items():
            for column in own:
                if (other := owner.setdefault(column, name)) != name:
                    raise ValueError(f'measured{where}: "{other}" and "{name}" both have {column}')
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
            units=tuple(of_column(name, INDICES[name].unit, jaws(scene)) for name in owner),
            data=data,
            noise=found,
            estimated=np.isnan(found),
            fitted=np.full_like(data, np.nan),
        )

    @property
    def residuals(self) -> dict[str, Floats]:
        """Observable -> measured minus fitted (n,) or (n, k), in SI units; NaN where no data is."""
        ends = np.cumsum([len(own) for own in self.observables.values()])[:-1]
        blocks = np.split(self.data - self.fitted, ends, axis=1)
        pairs = zip(self.observables, blocks, strict=True)
        return {name: block[:, 0] if block.shape[1] == 1 else block for name, block in pairs}

    @property
    def known(self) -> NDArray[np.bool_]:
        """Marks the measurements that exist (n, c)."""
        return np.isfinite(self.data)

    @property
    def least_noise(self) -> Floats:
        """The noise (c,) below which there is only round-off."""
        sizes = scaled_error.usual(self.scene)
        radius = max(tip.radius for tip in self.scene.hand.tips)
        levers = np.where(jaws(self.scene), 1.0, radius)
        sizes["torque"] = levers * sizes["multipliers"][:2]
        places = [INDICES[column] for column in self.columns]
        return _ROUND_OFF * np.array([sizes[each.quantity][each.column] for each in places])

    def simulated(
        self, values: Mapping[str, float], options: Options, derivatives: bool, warns: bool = False
    ) -> Motion:
        """Simulates the scene with values by path at the measured times, or raises FailedRun."""
        paths = tuple(values)
        try:
            scene = with_numbers(self.scene, values)
            duration = float(self.times[-1]) - scene.start().time
            if options.tolerance is not None:
                duration *= 1.0 + 1e-12  # rounding must not put the last time behind the end
            scene = replace(scene, duration=min(duration, scene.duration))
            request = Request(scene, replace(options, times=self.times, record=self._recorded))
            if warns:
                usual.warn(scene)
            with warnings.catch_warnings():
                # Differences take the place of derivatives that end at an event.
                warnings.filterwarnings("ignore", "sensitivities", StabilityWarning)
                run = computed(request, paths if derivatives else ())
            if warns:
                warn_of_steps(request, run._result)
        except ValueError as error:
            raise FailedRun(str(error)) from None
        if not run.success:
            raise FailedRun(f"the run ends as {run.status}: {run.message}")
        places = [INDICES[column] for column in self.columns]
        table = np.stack([getattr(run, one.quantity)[:, one.column] for one in places], axis=1)
        slope = None
        if derivatives:
            found = run.sensitivity
            groups = {"state": found} | {name: getattr(found, name) for name in self._recorded[1:]}
            slopes = {k: np.stack([of[path] for path in paths], -1) for k, of in groups.items()}
            slopes["q"], slopes["p"] = np.split(slopes["state"], 2, axis=1)
            slope = np.stack([slopes[one.quantity][:, one.column] for one in places], axis=1)
        return Motion(table, slope, run.violations)

    @property
    def _recorded(self) -> tuple[str, ...]:
        """The quantities that a run records: its state, and then the other measured ones."""
        quantities = dict.fromkeys(INDICES[column].quantity for column in self.columns)
        return ("state", *(name for name in quantities if name not in ("q", "p")))


def _values(name: str, given: object, own: tuple[str, ...], times: Floats) -> Floats:
    table = checks.numbers(name, given)
    wanted = (len(times),) if len(own) == 1 else (len(times), len(own))
    if table.shape != wanted:
        of_group = "" if len(own) == 1 else f" and the columns {', '.join(own)}"
        rule = f"must have shape {wanted}, a row for each time{of_group}"
        raise ValueError(f"{name} has shape {table.shape}: {rule}")
    if np.isinf(table).any():
        row = int(np.argwhere(np.isinf(table))[0][0])
        raise ValueError(f"{name}[{row}] is infinite: must be finite, or NaN without measurement")
    return table.reshape(len(times), len(own))


def _noise(where: str, noise: object, observables: Mapping[str, tuple[str, ...]]) -> Floats:
    """The noise of each column (c,); NaN if it is to be estimated."""
    name = f"noise{where}"
    if not isinstance(noise, Mapping):
        one = math.nan if noise is None else checks.positive(name, noise)
        return np.full(sum(map(len, observables.values())), one)
    for key in noise:
        checks.choice(name, key, observables)
    found = []
    for observable, own in observables.items():
        given = noise.get(observable)
        label, each = f'{name}["{observable}"]', np.array(math.nan)
        if given is not None:
            each = np.asarray(checks.number_or_array(label, given, checks.positive))
        if each.ndim and each.shape != (len(own),):
            rule = f"must be a number or {len(own)} numbers"
            raise ValueError(f"{label} has shape {each.shape}: {rule}")
        found.append(np.broadcast_to(each, len(own)))
    return np.concatenate(found)
