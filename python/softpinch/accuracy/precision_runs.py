"""The runs behind `precision`: sampling of their rows, their errors, and their run times."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..run import scaled_error
from ..run.measures import held_residuals
from ..run.options import Options
from ..run.run import Run
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support.arrays import Floats
from .driven import Inputs
from .measurements import QUANTITIES, Measurement, Peer
from .reference import Reference
from .trial_run import TrialRun, cpu_times, repeated

EVERYTHING = ("state", "multipliers", "residuals", "energy", "contact")

# Errors are computed at this many evenly spread rows of a run, and 1, 3, 7, ... steps after each
# switch of the inputs.
_ROWS = 48
# Share of the time from one switch to the next that counts as "at the switch".
_AT_SWITCH = 0.01
# Runs with more steps are recorded at every k-th step only.
_MOST_RECORDED = 200_000
# Lower bound of the time that a step takes, s.
_CHEAPEST_STEP = 1e-7
# Number of timed repetitions of a run, unless it is slow.
_REPEATS = 7


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """Sampled rows and largest residuals of a run, kept until the reference has been computed."""

    status: str
    stats: Mapping[str, int]
    t: Floats
    q: Floats
    p: Floats
    multipliers: Floats
    holonomic: float
    nonholonomic: float
    closure: float


def look_at(run: Run, switches: Floats) -> Look:
    """Samples the rows of a run that are compared with the reference, and its residuals."""
    rows = sampled_rows(run, switches)
    residuals = held_residuals(run).max(axis=0)
    exchanged = run.energy.exchanged
    closure = float(np.abs(run.energy.closure).max())
    return Look(
        status=run.status,
        stats=run.stats,
        t=run.t[rows],
        q=run.q[rows],
        p=run.p[rows],
        multipliers=run.multipliers[rows],
        holonomic=float(residuals[:2].max()),
        nonholonomic=float(residuals[2:].max()),
        closure=closure / exchanged if exchanged > 0.0 else closure,
    )


def sampled_rows(run: Run, switches: Floats, count: int = _ROWS) -> NDArray[np.intp]:
    """Indices of rows spread over the run, of rows soon after each switch, and of the last row."""
    last = len(run) - 1
    even = np.linspace(0, last, count).round().astype(np.intp)
    after = 2 ** np.arange(0, max(last, 1).bit_length() + 1) - 1
    near = (np.searchsorted(run.t, switches)[:, None] + after[None, :6]).ravel()
    rows = np.unique(np.concatenate([even, near[near <= last], [last]]))
    # An event may come just before such a row or just after it. At a switch it comes at it.
    events = np.setdiff1d([change.time for change in run.contact_changes], switches)
    return np.asarray(rows[~np.isin(run.t[rows], events) | (rows == last)])


def switching(scene: Scene) -> Floats:
    """The start of a scene, and the instants at which an input jumps or kinks (k,), s."""
    return np.array(Inputs(scene, float(scene.start().time), end_of(scene)).edges[:-1])


def end_of(scene: Scene) -> float:
    """The last instant of a scene's run, s."""
    return float(scene.start().time + scene.duration)


class Curve:
    """One pair of formulation and method, over the values of one kind of setting.

    `look` runs every value once and says at which instants the reference is needed. `measured` then
    compares these runs with the reference and times them.
    """

    def __init__(
        self,
        scene: Scene,
        pair: tuple[str, str],
        setting: str,
        values: Floats,
        gains: Stabilization,
        switches: Floats,
    ) -> None:
        """Takes the settings; runs nothing yet.

        Args:
            scene: The scene to simulate.
            pair: Formulation and method.
            setting: "dt" or "tolerance".
            values: Values of the setting, from loose to tight.
            gains: The stabilization gains.
            switches: Instants at which the scene's inputs jump or kink, s.
        """
        self.scene, self.setting, self.values, self.gains = scene, setting, values, gains
        self.switches = switches
        self.formulation, self.method = pair
        self.looks: list[Look | None] = []

    def options(self, value: float) -> Options:
        """One value of the setting, with everything recorded that is measured."""
        every = 1
        if self.setting == "dt":
            every = max(1, math.ceil(self.scene.duration / value / _MOST_RECORDED))
        how: dict[str, Any] = {self.setting: value}
        return Options.checked(
            method=self.method,
            formulation=self.formulation,
            stabilization=self.gains,
            record=EVERYTHING,
            every=every,
            **how,
        )

    def look(self, longest: float) -> Floats:
        """Runs every value once, except those expected to take longer than `longest`, s.

        Returns:
            The instants of all sampled rows, s.
        """
        spent, before = 0.0, 0.0
        for value in self.values:
            # Time grows inversely with dt, and about with the fourth root of 1 / tolerance.
            power = 1.0 if self.setting == "dt" else 0.25
            expected = spent * (before / value) ** power
            if not before and self.setting == "dt":
                expected = _CHEAPEST_STEP * self.scene.duration / value
            if expected > longest:
                self.looks.append(None)
                continue
            trial = TrialRun.of(self.scene, self.options(float(value)))
            self.looks.append(look_at(trial.run, self.switches))
            spent, before = trial.time, value
        return np.concatenate([[], *(look.t for look in self.looks if look is not None)])

    def measured(self, exact: Reference, skipped: list[str]) -> list[Measurement]:
        """A timed measurement for each value; adds a line to `skipped` for each value not run."""
        solver = f"{self.formulation} {self.method}"
        fixed = self.setting == "dt"
        rows: list[Measurement] = []
        for value, look in zip(self.values.tolist(), self.looks, strict=True):
            row = Measurement(
                solver=solver,
                formulation=self.formulation,
                method=self.method,
                setting=self.setting,
                value=value,
                status="not_run",
                expected_order=_core.ORDERS[self.method] if fixed else 0,
            )
            if look is None:
                skipped.append(f"{solver}, {self.setting} = {value:.3g}: would take too long")
                rows.append(row)
                continue
            times = cpu_times(self.scene, self.options(value), _REPEATS)
            row = replace(
                row,
                status=look.status,
                holonomic=look.holonomic,
                nonholonomic=look.nonholonomic,
                closure=look.closure,
                **_summarized(times),
                evaluations=look.stats["evaluations"],
                factorisations=look.stats["factorisations"],
                steps=look.stats["steps"],
                **errors(look, exact, self.switches),
            )
            rows.append(_with_order(row, rows[-1]) if rows and fixed else row)
        return rows


def errors(look: Look, exact: Reference, switches: Floats) -> dict[str, Any]:
    """The fields `end`, `smooth` and `at_switches` of a `Measurement`, by quantity."""
    nothing = dict.fromkeys(QUANTITIES, math.inf)
    if look.status != "completed":
        return {"end": nothing, "smooth": nothing, "at_switches": nothing}
    at = np.searchsorted(exact.t, look.t)
    stretch = np.append(np.diff(switches), exact.t[-1] - switches[-1])
    which = np.searchsorted(switches, look.t, side="right") - 1
    # The start is no switch: a run has no error there.
    near = (which > 0) & (look.t - switches[which] <= _AT_SWITCH * stretch[which])
    found: dict[str, dict[str, float]] = {"end": {}, "smooth": {}, "at_switches": {}}
    for name in QUANTITIES:
        rows = scaled_error.by_row(
            getattr(look, name), getattr(exact, name)[at], exact.scales[name]
        )
        found["end"][name] = float(rows[-1])
        found["smooth"][name] = float(rows[~near].max(initial=0.0))
        if near.any():
            found["at_switches"][name] = float(rows[near].max())
    return found


def _with_order(row: Measurement, longer: Measurement) -> Measurement:
    errors = longer.error, row.error
    if not all(0.0 < error < math.inf for error in errors):
        return row
    return replace(row, order=math.log(errors[0] / errors[1]) / math.log(longer.value / row.value))


def _summarized(times: Sequence[float]) -> dict[str, Any]:
    """The fields `time` and `quartiles` of a `Measurement`."""
    low, high = np.quantile(times, [0.25, 0.75])
    return {"time": statistics.median(times), "quartiles": (float(low), float(high))}


def peer_rows(
    peer: Peer, scene: Scene, exact: Reference, longest: float, skipped: list[str]
) -> list[Measurement]:
    """A timed measurement for each value of a peer's setting; adds failures to `skipped`."""
    try:
        solve = peer.prepare(scene)
    except (ValueError, TypeError, AssertionError, RuntimeError) as reason:
        skipped.append(f"{peer.name}: {reason}")
        return []
    rows: list[Measurement] = []
    spent = 0.0
    for value in peer.values:
        row = Measurement(
            solver=peer.name, setting=peer.setting, value=float(value), status="not_run"
        )
        if spent > longest:
            skipped.append(f"{peer.name}, {peer.setting} = {value:.3g}: would take too long")
            rows.append(row)
            continue
        try:
            q, p = peer.ends(solve(value))
            times = repeated(partial(solve, value), _REPEATS)
        except (ArithmeticError, ValueError, RuntimeError) as reason:
            rows.append(replace(row, status="failed", end=dict.fromkeys(("q", "p"), math.inf)))
            skipped.append(f"{peer.name}, {peer.setting} = {value:.3g}: {reason}")
            continue
        spent = statistics.median(times)
        end = scaled_error.at_end({"q": q, "p": p}, exact, exact.scales)
        status = "completed" if all(map(math.isfinite, end.values())) else "not_finite"
        rows.append(replace(row, status=status, end=end, **_summarized(times)))
    return rows
