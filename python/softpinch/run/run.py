"""`Run`, the result of `simulate`: recorded arrays, status, checks, and states to continue from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..scene import Scene, State, fields, jaws
from ..scene.motion import HandMotion, HandState
from ..scene.outline import drawings
from ..support import NotRecordedError, Shown, ShownTable, checks, plain, read_only, save_map
from .contact import ContactChange, ContactMode, DifferentiatedChange, known_modes
from .error_estimate import QUANTITIES, ErrorEstimate
from .ledger import LEDGER, EnergyLedger
from .options import Options
from .request import Request
from .sensitivity import Sensitivity, checked, differentiated


class Run(Shown):
    """The result of `simulate`.

    Arrays are read-only and have one row for each of the n recorded instants. Access to a quantity
    that was not recorded raises `NotRecordedError`. The row at a switch of the schedule or at an
    impulse has the state just before it, but multipliers, torques and contacts just after the
    switch. The row at an impulse has the contacts just before the impulse.

    Attributes:
        scene: The simulated scene.
        dt: As of `simulate`, s, and so are `tolerance`, `method`, `formulation`, `stabilization`,
            `record`, `every` and `stop_on`; dt or tolerance is None if it did not set the steps.
        t: Recorded instants (n,), s.
        status: "completed"; the violation of `stop_on` that ended the run: "separated", "crushed",
            "folded", "pulling", "slipping", "rim", "off_face" or "opened"; or "not_finite",
            "unstable" (the steps were too long for an explicit method: the energy ledger is open by
            more energy than the motion was ever given), "newton_failed", "step_too_small",
            "too_many_steps" or "interrupted". Unilateral contact ends a run also as "crushed",
            "folded" or "lost" (a contact leaves its face, or no tip is beside a face), "chattering"
            (over 64 events in one step) and "no_mode" (no modes agree with the forces).
        message: The status in words, with the numbers.
        violations: Name of each violation of the model's assumptions that was seen -> the time at
            which it was first seen, s.
        violation_intervals: Name of each of these violations -> the intervals in which it was seen,
            (k, 2), s: the first and the last of consecutive checked instants that showed it. The
            checked instants are the ends of all steps, recorded or not, and with `tolerance` also
            the instants of `times` and those inside a step at which a tip seemed to separate and
            return. So the violation may last up to one step longer at either end. In unilateral
            contact "slipping" (a tip slips) and "opened" (a tip is free) have their exact times;
            "pulling" and "separated" do not occur, and closed tips only are "crushed", "folded", on
            the "rim" or "off_face".
        holds: Whether the grasp held. With unilateral contact: the run reaches its end, and no tip
            is free there. With bilateral contact, as far as that can tell: the run reaches its end,
            and from `summaries_after` on no tip pulls (lambda^H < 0) or, if the scene has
            `friction`, needs more of it (|lambda^N| > mu lambda^H).
        stats: Counts of the work: steps, rejected (attempts), evaluations (of the right-hand side),
            jacobians, factorisations, iterations (Newton's), segments.
    """

    def __init__(
        self,
        scene: Scene,
        options: Options,
        result: Mapping[str, Any],
        error: ErrorEstimate | None = None,
        slopes: Sensitivity | None = None,
    ) -> None:
        # `result` is that of `_core.Simulation.run`; one that was stored may have writable arrays.
        for value in (*result.values(), *result["violation_intervals"].values()):
            if isinstance(value, np.ndarray):
                read_only(value)
        self._options = options
        self._result = result
        self._error = error
        self._slopes = slopes
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
        self.violation_intervals: dict[str, NDArray[np.float64]] = result["violation_intervals"]
        self.holds: bool = result["holds"]
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
        """Rates of the coordinates (n, 9), m/s and rad/s."""
        return self._recorded("p", "state")

    @property
    def integral(self) -> NDArray[np.float64]:
        """Integrals of the angle errors in (39), (n, 2), rad s."""
        return self._recorded("integral", "state")

    @property
    def relaxation(self) -> NDArray[np.float64]:
        """States of `Maxwell` branches (n, k), N and m, in the order of `State.relaxation`."""
        return self._recorded("relaxation", "state")

    @property
    def multipliers(self) -> NDArray[np.float64]:
        """Multipliers lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N, (n, 4), N.

        lambda^H is positive if the tip presses on the object.
        """
        return self._recorded("multipliers", "multipliers")

    @property
    def residuals(self) -> NDArray[np.float64]:
        """Constraint residuals C_1^H, C_2^H of (9), m, and C_1^N, C_2^N of (12), m/s, (n, 4)."""
        return self._recorded("residuals", "residuals")

    @property
    def torque(self) -> NDArray[np.float64]:
        """Torques on the fingers (n, 2), N m: of the PID (39), or driving "driven" fingers.

        At a switch they are the torques just after it. Those of a jaw are forces, N.
        """
        return self._recorded("torque", "torque")

    @property
    def contact(self) -> NDArray[np.uint8]:
        """Modes of the contacts (n, 2), right and left, as codes of `ContactMode`.

        Both tips always stick in bilateral contact.
        """
        return self._recorded("contact", "contact")  # type: ignore[return-value]

    @property
    def hand(self) -> HandState:
        """Place and motion of the hand's frame at the rows; at rest if the scene has no motion."""
        return (self.scene.motion or HandMotion.constant()).at(self.t)

    def world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Converts points of the hand's frame at the rows (n, ..., 2), m, to fixed axes.

        >>> import softpinch as sp
        >>> motion = sp.HandMotion.minimum_jerk([0.0, 0.1], [[0.0, 0.0], [0.5, 0.0]])
        >>> run = sp.simulate(sp.Scene(motion=motion, duration=0.1), dt=1e-3)
        >>> run.world(run.q[:, :2])[-1].shape
        (2,)
        """
        given = checks.numbers("points", points)
        if given.ndim < 2 or given.shape[0] != len(self.t) or given.shape[-1] != 2:
            raise ValueError(f"points: has shape {given.shape}, must be ({len(self.t)}, ..., 2)")
        hand, axes = self.hand, (..., *(None,) * (given.ndim - 2))
        sin, cos = np.sin(hand.tilt)[axes], np.cos(hand.tilt)[axes]
        x, y = given[..., 0], given[..., 1]
        turned = np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1)
        return turned + hand.position.reshape(len(given), *(1,) * (given.ndim - 2), 2)

    @property
    def contact_changes(self) -> list[ContactChange]:
        """The changes of the contacts' modes, in the order of time; empty in bilateral contact.

        A slip that turns round is a change from SLIP to SLIP. In a run with `sensitivities` each
        has the derivatives of its time, `run.contact_changes[k].sensitivity[path]`.
        """
        slopes, found = self._slopes, self._result["contact_changes"]
        if slopes is None:
            return [ContactChange(*each[:2], *map(ContactMode, each[2:4])) for each in found]
        changes: list[ContactChange] = []
        for each, by_path in zip(found, slopes._changes(len(found)), strict=True):
            change = DifferentiatedChange(*each[:2], *map(ContactMode, each[2:4]))
            change._by_path = by_path
            changes.append(change)
        return changes

    @property
    def energy(self) -> EnergyLedger:
        """The energy ledger."""
        columns = self._recorded("energy", "energy").T
        # Bilateral contact has no losses of its own, so that they are not recorded.
        nothing = [read_only(np.zeros(len(self.t)))] * (len(LEDGER) - len(columns))
        named = dict(zip(LEDGER, [*columns, *nothing], strict=True))
        return EnergyLedger(**named, start=self._result["begun"])

    @property
    def error_estimate(self) -> ErrorEstimate:
        """The estimated error of the recorded rows, if `simulate` had `estimate_error=True`."""
        if self._error is None:
            raise NotRecordedError("the error was not estimated: pass estimate_error=True")
        return self._error

    @property
    def sensitivity(self) -> Sensitivity:
        """The derivatives of the recorded rows, if `simulate` had `sensitivities`."""
        if self._slopes is None:
            raise NotRecordedError("no derivatives were computed: pass sensitivities=(path, ...)")
        return self._slopes

    @property
    def success(self) -> bool:
        """True if the run reached its end time."""
        return self.status == "completed"

    def __len__(self) -> int:
        return len(self.t)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Returns the recorded arrays except `t`, by name, the ledger's as "energy_kinetic", ..."""
        result = self._result
        found = {name: result[name] for name in fields.QUANTITIES if result[name] is not None}
        if result["energy"] is not None:
            ledger = self.energy
            recorded = LEDGER[: result["energy"].shape[1]]
            found |= {f"energy_{name}": getattr(ledger, name) for name in (*recorded, "closure")}
        return found

    def state(self, k: int = -1) -> State:
        """Returns the state at recorded row `k`, from which another run can continue.

        With `dt` the continued run gives the same bits as an uninterrupted one. With `tolerance` it
        is as accurate, but chooses other steps. The last state is always available. A state of
        formulation "csm" has check=False, because it includes drift off the constraints.

        Raises:
            NotRecordedError: The state was not recorded, and `k` is not the last row.
        """
        n = len(self.t)
        k = checks.integer("k", k)
        if not -n <= k < n:
            raise IndexError(f"k = {checks.shown(k)}: the run has only {n} recorded rows")
        result = self._result
        at: Mapping[str, Any] = result["final"]
        if k not in (-1, n - 1):
            at = {"q": self.q[k], "p": self.p[k], "integral": self.integral[k], "t": self.t[k]}
            at |= {"anchor": result["grid_anchor"][k], "step": result["grid_step"][k]}
            for name in ("contacts", "controller", "linearized", "relaxation"):
                rows = result["controllers" if name == "controller" else name]
                at[name] = None if rows is None else rows[k]
            if at["linearized"] is not None and np.isnan(at["linearized"][0]):
                at["linearized"] = None
        branches = at["relaxation"]
        return State(
            at["q"],
            at["p"],
            tuple(at["integral"]),
            at["t"],
            check=self.formulation != "csm",
            grid=(at["anchor"], at["step"]),
            linearized=at["linearized"],
            contact=at["contacts"],
            controller=at["controller"],
            relaxation=branches if branches is not None and len(branches) else None,
        )

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """Returns the states at any instants of the run, also between its rows and its steps.

        The run is computed once more, with the same steps. States inside a step are as accurate as
        those at the `times` of `simulate`.

        Args:
            times: Instants (n,), s, in any order, within the run; others raise ValueError.

        Returns:
            Coordinates and their rates (n, 18), m, rad, m/s and rad/s.
        """
        instants = checks.array("times", times, ("n",))
        begin, end = self.scene.start().time, float(self._result["final"]["t"])
        for k in np.flatnonzero(~((begin <= instants) & (instants <= end))):
            rule = f"must be from {begin:.6g} to {end:.6g}, where the run ends"
            raise ValueError(f"times[{k}] = {instants[k]}: {rule}")
        asked, place = np.unique(instants, return_inverse=True)
        found = Request(self.scene, self._options).rows_at(asked)
        if len(found["t"]) < len(asked):
            # With a tolerance the asked instants are checked for violations, too.
            rule = f"is in the step after {found['t'][-1]:.6g} s, in which the run ends"
            raise ValueError(f"times: {asked[len(found['t'])]} {rule}; ask for earlier instants")
        return np.hstack([found["q"], found["p"]])[place]

    def check(self, *, residual: float = 1e-6, closure: float = 1e-4) -> Self:
        """Checks the invariants of the recorded quantities and returns the run.

        The checks are: times increase; all numbers are finite; the constraint residuals, computed
        from the states if they were not recorded, are small; the energy ledger closes; status and
        violations agree with the states.

        In unilateral contact also: lambda^H >= 0 and |lambda^N| <= mu lambda^H, with equality in
        slip; no force acts on a tip that is free or grazes; no free tip beside a face is within the
        object; friction and impacts only take energy; and the modes of the rows, `contact_changes`,
        `violations`, `status` and `holds` agree. Residuals must be small only of constraints that
        hold: C^H of closed tips, C^N of tips that stick. What was not recorded is not checked.

        With the default limits, the paper's scenes at dt = 1e-4 have a margin of six or more. A
        stiffer scene needs a smaller dt or larger limits.

        Args:
            residual: Limit for C^H as a share of the fingertip's radius, and for C^N as a share of
                the largest speed of the object or of a fingertip along the run.
            closure: Limit for the ledger's error as a share of the largest energy exchanged; the
                round-off of the energies is allowed, too. `math.inf` disables a check.

        Raises:
            AssertionError: An invariant is broken. The message has the invariant, time, row,
                component, value and limit.
        """
        from .check import check_run  # most runs are not checked

        check_run(self, known_modes(self._result), residual=residual, closure=closure)
        return self

    def provenance(self) -> dict[str, Any]:
        """Returns the run's scene, options, software versions and status as plain data."""
        options = {name: plain(value) for name, value in self._options._values().items()}
        return {
            "softpinch": _core.__version__,
            "results_version": _core.RESULTS_VERSION,
            "scene": self.scene.to_dict(),
            **options,
            "max_steps": None if self.tolerance is None else self._options.max_steps,
            "status": self.status,
            "message": self.message,
            "holds": self.holds,
            "violations": self.violations,
            "stats": self.stats,
        }

    def save(self, path: str | Path) -> Path:
        """Writes the recorded arrays to a file with exact numbers.

        An `.npz` file has `t`, the arrays of `arrays()`, and `provenance()` as JSON text, from
        whose "scene" `Scene.from_dict` restores the scene. A `.csv` file has a column for each
        component, with its unit in the header, and no provenance. Both include the estimated error,
        if there is one, as "error_q", "error_p" and "error_multipliers". The path is returned.
        """
        arrays = self.arrays()
        if self._error is not None:
            bars = {name: getattr(self._error, name) for name in QUANTITIES}
            arrays |= {f"error_{name}": bar for name, bar in bars.items() if bar is not None}
        # Arrays without headers are those of the energy ledger, which have one column each.
        own = jaws(self.scene)
        columns = [fields.headers(name, own) or (f"{name} [J]",) for name in arrays]
        header = ["t [s]", *(column for group in columns for column in group)]
        arrays = {"t": self.t, **arrays}
        return save_map(path, header, _rows(arrays.values()), arrays, self.provenance())

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor, because an unpickled array would be writable.
        return Run, (self.scene, self._options, self._result, self._error, self._slopes)

    def _picture(self) -> str:
        """Drawings at the first, middle and last row, as SVG; without rows of q, of the start."""
        t, q = self.t, self._result["q"]
        if q is None or not len(t):
            return self.scene._picture()
        finite = set(np.flatnonzero(np.isfinite(q).all(axis=1)))
        rows = sorted({0, len(t) // 2, len(t) - 1} & finite)
        return drawings(self.scene, [q[k] for k in rows], [f"t = {t[k]:.6g} s" for k in rows])

    def _tables(self) -> Iterator[ShownTable]:
        """The result of the run with counts of its work, and the first times of violations."""
        facts = {"result": self.message, "holds": self.holds, **self.stats}
        # Of counts that are zero, explicit methods have several.
        shown = [item for item in facts.items() if item[1] != 0 or item[1] is False]
        yield ShownTable(("", ""), shown)
        if self.violations:
            yield ShownTable(("violation", "first at [s]"), tuple(self.violations.items()))

    def __repr__(self) -> str:
        seen = "".join(f", {name} at {time:.6g} s" for name, time in self.violations.items())
        span = f"t = {self.t[0]:.6g} to {self.t[-1]:.6g} s" if len(self.t) else "no rows"
        recorded = ", ".join(self.record) or "time only"
        return (
            f"<Run {self.status}: {span}, {len(self.t)} rows ({recorded}), "
            f"{self.stats['steps']} steps of {self.method}{seen}>"
        )


def _rows(arrays: Iterable[NDArray[Any]]) -> Iterator[tuple[Any, ...]]:
    # Column by column, because the codes of contacts are integers and the others are not.
    columns = (column for each in arrays for column in np.atleast_2d(each.T))
    yield from zip(*(column.tolist() for column in columns), strict=True)


def computed(request: Request, sensitivities: Sequence[str] = ()) -> Run:
    """Computes a run, without the warnings and estimates of `simulate`."""
    wanted = checked(request, sensitivities)
    result = request.run_to_end()
    slopes = differentiated(request, result["t"], wanted)
    return Run(request.scene, request.options, result, slopes=slopes)
