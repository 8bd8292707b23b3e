"""A finished run: what was recorded, how it ended, whether it can be believed, and how to go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..scene.coordinates import COORDINATE_UNITS, COORDINATES, RATE_UNITS, RATES
from ..scene.scene import Scene, State
from ..support import checks
from ..support.arrays import read_only
from ..support.errors import NotRecordedError
from ..support.result import Result
from ..support.table import save_by_suffix, save_csv, save_npz
from .error_estimate import QUANTITIES, ErrorEstimate
from .options import Options

# What a column of a CSV file is called, and in which unit it is.
COLUMNS: dict[str, tuple[str, ...]] = {
    "q": tuple(f"{c} [{u}]" for c, u in zip(COORDINATES, COORDINATE_UNITS, strict=True)),
    "p": tuple(f"{c} [{u}]" for c, u in zip(RATES, RATE_UNITS, strict=True)),
    "integral": ("integral_1 [rad s]", "integral_2 [rad s]"),
    "multipliers": tuple(f"lambda_{name} [N]" for name in ("1H", "2H", "1N", "2N")),
    "residuals": ("C_1H [m]", "C_2H [m]", "C_1N [m/s]", "C_2N [m/s]"),
    "torque": ("torque_1 [N m]", "torque_2 [N m]"),
}
_RECORDED = tuple(COLUMNS)
COLUMNS |= {
    f"error_{name}": tuple(f"error of {column}" for column in COLUMNS[name]) for name in QUANTITIES
}


@dataclass(frozen=True, kw_only=True, eq=False)
class EnergyLedger(Result):
    """Energies and works of a run at its recorded instants, each (n,), J.

    Each work is a quadrature of its own beside the state, so that `closure` is a check of both.

    Attributes:
        kinetic: p^T M p / 2.
        elastic: P of (5).
        gravity: P_g of (16).
        controller_work: Of the torques (39), since the start.
        external_work: Of the disturbances, impulses included.
        viscous_loss: Lost in the fingertips (44, 45), positive.
        constraint_work: lambda^T Phi p, what drift off the constraints gives or takes, and what
            "projected" does to the energy: zero on the constraints.
        start: Kinetic, elastic and gravity energy where the works begin, the run's start, J: the
            first row's, unless `times` left that out.
    """

    kinetic: NDArray[np.float64]
    elastic: NDArray[np.float64]
    gravity: NDArray[np.float64]
    controller_work: NDArray[np.float64]
    external_work: NDArray[np.float64]
    viscous_loss: NDArray[np.float64]
    constraint_work: NDArray[np.float64]
    start: tuple[float, float, float]

    @property
    def total(self) -> NDArray[np.float64]:
        """Kinetic, elastic and gravity energy together (n,), J."""
        with np.errstate(all="ignore"):
            return self.kinetic + self.elastic + self.gravity

    @property
    def closure(self) -> NDArray[np.float64]:
        """(Energy now - energy at the start) - (works - loss), (n,), J: the ledger's error."""
        # A run that overflowed has infinite energies; its status says so.
        with np.errstate(all="ignore"):
            change: NDArray[np.float64] = self.total - sum(self.start)
            works = self.controller_work + self.external_work + self.constraint_work
            return change - (works - self.viscous_loss)

    @property
    def exchanged(self) -> float:
        """The largest change of an energy, or work, along the run, J: the scale of `closure`."""
        energies = (self.kinetic, self.elastic, self.gravity)
        pairs = zip(energies, self.start, strict=True)
        with np.errstate(all="ignore"):
            changes = [np.abs(energy - start).max() for energy, start in pairs]
        works = (self.controller_work, self.external_work, self.viscous_loss, self.constraint_work)
        return float(max(*changes, *(np.abs(work).max() for work in works)))


LEDGER = tuple(name for name in EnergyLedger.__dataclass_fields__ if name != "start")


class Run:
    """The result of `simulate`.

    What was not recorded raises `NotRecordedError`. Arrays are read-only, n rows are recorded
    instants. The row at a switch or an impulse is the one just before it, but multipliers at a
    switch are those just after it.

    Attributes:
        scene: What was simulated.
        dt: Longest step, s; None where the error chose it.
        tolerance: Largest error of a step, as a share; None where steps were fixed.
        method: How time was stepped.
        formulation: How the constraints were kept.
        stabilization: The gains of (19) and (20).
        record: What was recorded.
        every: Every how many steps.
        stop_on: The violations that would have ended it.
        t: (n,), s.
        status: "completed", "separated", "crushed", "folded", "not_finite", "newton_failed",
            "step_too_small", "too_many_steps" or "interrupted".
        message: The same in words, with the numbers.
        violations: Name of each way in which the model stopped holding -> first time, s.
        stats: Counted work: steps, rejected (attempts), evaluations (of the right-hand side),
            jacobians, factorisations, iterations (Newton's), segments.
    """

    def __init__(
        self,
        scene: Scene,
        options: Options,
        result: Mapping[str, Any],
        error: ErrorEstimate | None = None,
    ) -> None:
        """Takes what `_core.Simulation.run` returned; users get runs from `simulate`."""
        self._options = options
        self._result = result
        self._error = error
        self.scene = scene
        self.dt = options.dt
        self.tolerance = options.tolerance
        self.method = options.method
        self.formulation = options.formulation
        self.stabilization = options.stabilization
        self.record = options.record
        self.every = options.every
        self.stop_on = options.stop_on
        self.t: NDArray[np.float64] = result["t"]
        self.status: str = result["status"]
        self.message: str = result["message"]
        self.violations: dict[str, float] = result["violations"]
        self.stats: dict[str, int] = result["stats"]

    def _recorded(self, name: str, quantity: str) -> NDArray[np.float64]:
        value: NDArray[np.float64] | None = self._result[name]
        if value is None:
            wanted = tuple(r for r in _core.RECORDABLE if r in (*self.record, quantity))
            verb = "were" if name in ("multipliers", "residuals") else "was"
            raise NotRecordedError(f"{name} {verb} not recorded: pass record={wanted!r}")
        return value

    @property
    def q(self) -> NDArray[np.float64]:
        """Coordinates (n, 9): x, y, theta, theta_1, theta_2, d_n1, d_n2, d_t1, d_t2, m and rad."""
        return self._recorded("q", "state")

    @property
    def p(self) -> NDArray[np.float64]:
        """Their rates (n, 9), m/s and rad/s."""
        return self._recorded("p", "state")

    @property
    def integral(self) -> NDArray[np.float64]:
        """The integrals of the angles' errors in (39), (n, 2), rad s."""
        return self._recorded("integral", "state")

    @property
    def multipliers(self) -> NDArray[np.float64]:
        """(n, 4): lambda_1^H, lambda_2^H (positive presses), lambda_1^N, lambda_2^N, N."""
        return self._recorded("multipliers", "multipliers")

    @property
    def residuals(self) -> NDArray[np.float64]:
        """(n, 4): C_1^H, C_2^H of (9), m, and C_1^N, C_2^N of (12), m/s."""
        return self._recorded("residuals", "residuals")

    @property
    def torque(self) -> NDArray[np.float64]:
        """The torques on the fingers (n, 2), N m: of the PID (39), or what drives the fingers.

        At a switch, as `multipliers`, those just after it.
        """
        return self._recorded("torque", "torque")

    @property
    def energy(self) -> EnergyLedger:
        """The energy ledger."""
        columns = self._recorded("energy", "energy").T
        named = dict(zip(LEDGER, columns, strict=True))
        return EnergyLedger(**named, start=self._result["begun"])

    @property
    def error_estimate(self) -> ErrorEstimate:
        """How wrong the recorded rows are."""
        if self._error is None:
            raise NotRecordedError("the error was not estimated: pass estimate_error=True")
        return self._error

    @property
    def success(self) -> bool:
        """Whether it reached the end."""
        return self.status == "completed"

    def __len__(self) -> int:
        """How many instants were recorded."""
        return len(self.t)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """What was recorded beside `t`, by name; the ledger's columns as energy_kinetic, ..."""
        found = {name: self._result[name] for name in _RECORDED if self._result[name] is not None}
        if self._result["energy"] is not None:
            ledger = self.energy
            found |= {f"energy_{name}": getattr(ledger, name) for name in (*LEDGER, "closure")}
        return found

    def state(self, k: int = -1) -> State:
        """The state at recorded row `k`, from which another run goes on to the same bits.

        With `tolerance` it goes on as accurately, but in steps of its own. The last state is there
        whatever was recorded. States of formulation "csm" carry that formulation's drift off the
        constraints, so they have check=False.

        Raises:
            IndexError: There is no such row.
            NotRecordedError: The state was not recorded, and `k` is not the last row.
        """
        n = len(self.t)
        k = checks.integer("k", k)
        if not -n <= k < n:
            raise IndexError(f"k = {checks.shown(k)}: no row of a run with {n} recorded rows")
        result = self._result
        if k in (-1, n - 1):
            last = result["final"]
            q, p, integral, t = last["q"], last["p"], last["integral"], last["t"]
            grid, linearized = (last["anchor"], last["step"]), last["linearized"]
        else:
            q, p, integral, t = self.q[k], self.p[k], self.integral[k], self.t[k]
            grid = (result["grid_anchor"][k], result["grid_step"][k])
            linearized = None if result["linearized"] is None else result["linearized"][k]
            if linearized is not None and np.isnan(linearized[0]):
                linearized = None
        check = self.formulation != "csm"
        return State(q, p, tuple(integral), t, check=check, grid=grid, linearized=linearized)

    def check(self, *, residual: float = 1e-6, closure: float = 1e-4) -> Self:
        """Raises where an invariant broke, naming it, where and by how much; else returns the run.

        Checked is what was recorded: times increase and are finite, as everything else; the
        constraint residuals, computed from the states where they were not recorded; the energy
        ledger's closure; that status and violations are what the states say.

        The defaults leave the paper's scenes at dt = 1e-4 a margin of six or more. Both errors
        fall as dt^4 with method "rk4": a stiffer scene wants a smaller dt, or larger tolerances.

        Args:
            residual: Largest C^H as a share of the fingertip's radius, and C^N as a share of the
                largest speed along the run, of the object or of a fingertip.
            closure: Largest error of the ledger as a share of the largest energy exchanged.
                `math.inf` leaves a check out.

        Raises:
            AssertionError: The message has the invariant, time, row, component, value and limit.
        """
        from .check import check_run  # most runs are not checked

        check_run(self, residual=residual, closure=closure)
        return self

    def provenance(self) -> dict[str, Any]:
        """What made this run, as plain data: scene, options, versions, and how it ended."""
        options = self._options
        return {
            "softpinch": _core.__version__,
            "results_version": _core.RESULTS_VERSION,
            "scene": self.scene.to_dict(),
            "dt": options.dt,
            "tolerance": options.tolerance,
            "method": options.method,
            "formulation": options.formulation,
            "stabilization": options.stabilization.to_dict(),
            "record": list(options.record),
            "every": options.every,
            "times": None if options.times is None else options.times.tolist(),
            "stop_on": list(options.stop_on),
            "max_steps": None if options.tolerance is None else options.max_steps,
            "status": self.status,
            "message": self.message,
            "violations": self.violations,
            "stats": self.stats,
        }

    def save(self, path: str | Path) -> Path:
        """Writes what was recorded.

        `.npz` has `t`, the arrays of `arrays()`, and as text `provenance()` in JSON, from which
        `Scene.from_dict` makes the scene again. `.csv` has a column for each component, with its
        unit in the header, and no provenance. Numbers are exact in both. Where the error was
        estimated both have it too, as error_q and so on.

        Raises:
            ValueError: The suffix is another.
            TypeError: It is no path.
            OSError: The file cannot be written.
        """
        return save_by_suffix(path, {".npz": self._save_npz, ".csv": self._save_csv})

    def _saved(self) -> dict[str, NDArray[np.float64]]:
        arrays = self.arrays()
        if self._error is not None:
            bars = {name: getattr(self._error, name) for name in QUANTITIES}
            arrays |= {f"error_{name}": bar for name, bar in bars.items() if bar is not None}
        return arrays

    def _save_npz(self, path: Path) -> None:
        save_npz(path, {"t": self.t, **self._saved()}, self.provenance())

    def _save_csv(self, path: Path) -> None:
        arrays = self._saved()
        # Only the ledger's arrays are not in COLUMNS: one column each.
        columns = [COLUMNS.get(name, (f"{name} [J]",)) for name in arrays]
        header = ["t [s]", *(column for group in columns for column in group)]
        table = np.column_stack([self.t, *arrays.values()])
        save_csv(path, header, table.tolist())

    def __reduce__(self) -> tuple[Any, ...]:
        """Through `restored`: unpickled arrays would be writable."""
        return restored, (self.scene, self._options, self._result, self._error)

    def __repr__(self) -> str:
        """Status, span, rows and what was seen, on one line."""
        seen = "".join(f", {name} at {time:.6g} s" for name, time in self.violations.items())
        span = f"t = {self.t[0]:.6g} to {self.t[-1]:.6g} s" if len(self.t) else "no rows"
        recorded = ", ".join(self.record) or "time only"
        return (
            f"<Run {self.status}: {span}, {len(self.t)} rows ({recorded}), "
            f"{self.stats['steps']} steps of {self.method}{seen}>"
        )


def restored(
    scene: Scene, options: Options, result: Mapping[str, Any], error: ErrorEstimate | None = None
) -> Run:
    """A run from arrays that were stored: read-only again, as the core makes them."""
    for value in result.values():
        if isinstance(value, np.ndarray):
            read_only(value)
    return Run(scene, options, result, error)
