"""Derivatives beside the variational equations of the SymPy oracle, integrated by SciPy.

The equations are (24) as SymPy derives them, in all nine coordinates with the gains of (19) and
(20). Their derivatives come from complex numbers. At an instant where an input jumps and that moves
with the number, the derivative of the state jumps by (f before - f after) times that motion. The
difference has the errors of both integrations, of which each is far below 1e-8.
"""

from collections.abc import Sequence
from math import prod
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import softpinch as sp
from complex_numbers import STEP, Complex, Numbers
from derivative_differences import difference, of
from derivative_scenes import (
    LOADS,
    SHARED,
    SIDED,
    SMOOTH_INPUTS,
    TIMES,
    entries,
    moving,
    shared,
    uneven,
)
from oracle.lagrangian import FORCES, PARAMETERS, SHAPES, compiled
from softpinch import _core
from softpinch.scene.paths import resolve

Floats = NDArray[np.float64]
Path = tuple[str, tuple[int, ...]]
DT = 5e-5
# Method, tolerance, and what the derivatives may be off.
FREE = (("dop853", 1e-11, 1e-9), ("radau5", 1e-9, 1e-9), ("rosenbrock", 1e-8, 1e-6))
RECORD = ("state", "multipliers", "torque")
STEPS = sp.Schedule.steps([0.0, 0.0083], np.deg2rad([[4, 5], [8, 3]]))
SMOOTH = sp.Schedule.minimum_jerk([0.0, 0.0043], np.deg2rad([[4, 5], [8, 3]]), move_time=0.0111)
IMPULSE = sp.Impulse(time=0.0057, impulse=(0.02, -0.01), angular_impulse=3e-4)


class Variations:
    """The motion of a scene and its derivatives by the numbers at paths.

    Attributes:
        slopes: Quantity -> its derivatives (n, components, d) at the wanted times: state (q, p),
            integral, multipliers and torque. At a break the state is that before it.
        values: Quantity -> its values (n, components).
    """

    def __init__(
        self,
        scene: sp.Scene,
        paths: Sequence[Path],
        times: Floats,
        gain: float = 1000.0,
        rtol: float = 1e-10,
    ) -> None:
        """Integrates from break to break.

        Args:
            scene: With PID control.
            paths: (path, index) of each number.
            times: Increasing, s, none of them a break.
            gain: alpha and beta, 1/s.
            rtol: Relative tolerance; the absolute one is this share of a millimetre, a milliradian,
                and the same of derivatives by a whole value.
        """
        self._all = [Numbers(scene, *path) for path in paths]
        self._gain = gain
        # All numbers outside of the inputs share one set of inputs.
        keys = [
            k if path.startswith(("schedule", "dist")) else -1 for k, (path, _) in enumerate(paths)
        ]
        _, self._driving, self._driven = np.unique(keys, return_index=True, return_inverse=True)
        self._c = np.array([[one.parameters[n] for n in PARAMETERS] for one in self._all]).T
        own = np.array([one.start for one in self._all]).T
        edges = np.array([one.edges for one in self._all]).T
        # By how much a number can be expected to move.
        sizes = np.array([_size(scene, *path) for path in paths])
        atol = np.concatenate([np.full(20, 1e-3 * rtol), np.tile(1e-3 * rtol / sizes, 20)])
        z = _joined(own)
        rows: list[tuple[float, float, Floats]] = []
        before = 0.0
        for k, (left, right) in enumerate(zip(edges[:-1].real, edges[1:].real, strict=True)):
            a, b = float(left[0]), float(right[0])
            inside = (a + b) / 2
            if k > 0:
                z = self._crossed(z, a, before, inside, edges[k].imag / STEP)
            wanted = times[(times >= a) & (times <= b)]
            found: Any = solve_ivp(
                lambda t, z, inside=inside: self._rates(t, z, inside),
                (a, b),
                z,
                method="DOP853",
                rtol=rtol,
                atol=atol,
                t_eval=np.unique([*wanted, b]),
            )
            assert found.success, found.message
            here = dict(zip(found.t.tolist(), found.y.T, strict=True))
            rows += [(t, inside, here[t]) for t in wanted.tolist()]
            z, before = here[b], inside
        self._rows(rows)

    def _evaluate(self, t: float, x: Complex, inside: float) -> tuple[Complex, Complex, Complex]:
        """The rates (20, d), the multipliers (4, d) and the torques (2, d)."""
        own = [self._all[k].inputs(t, inside) for k in self._driving]
        return self._motion(x, np.array(own)[self._driven].T, self._c)

    def _motion(self, x: Complex, u: Complex, c: Complex) -> tuple[Complex, Complex, Complex]:
        d = x.shape[1]
        flat = compiled("numpy")((*x, *u), tuple(c))
        flat = [np.broadcast_to(entry, d) for entry in flat]
        terms, at = {}, 0
        for name, shape in SHAPES.items():
            part = np.array(flat[at : at + prod(shape)])
            terms[name] = np.moveaxis(part.reshape(*shape, d), -1, 0)
            at += prod(shape)
        gain, residuals = self._gain, terms["residuals"]
        gamma = terms["constraint_rate"].copy()
        gamma[:, :2] += 2 * gain * terms["residual_rates"] + gain**2 * residuals[:, :2]
        gamma[:, 2:] += gain * residuals[:, 2:]
        phi = terms["constraint_matrix"]
        force = sum(terms[name] for name in FORCES)
        matrix = np.zeros((d, 13, 13), dtype=np.complex128)
        matrix[:, :9, :9] = terms["mass_matrix"]
        matrix[:, :9, 9:] = -np.swapaxes(phi, 1, 2)
        matrix[:, 9:, :9] = -phi
        right = np.concatenate([force, gamma], axis=1)[..., None]
        solved = np.linalg.solve(matrix, right)[..., 0].T
        rates = np.concatenate([x[9:18], solved[:9], x[3:5] - u[:2]])
        return rates, solved[9:], terms["control"][:, 3:5].T

    def _rates(self, t: float, z: Floats, inside: float) -> Floats:
        return _joined(self._evaluate(t, _split(z), inside)[0])

    def _crossed(self, z: Floats, t: float, before: float, after: float, moved: Floats) -> Floats:
        """The state and its derivatives just after a break, that moves by `moved` (d,)."""
        carried = _split(z)
        carried = carried + 1j * STEP * moved * self._evaluate(t, carried, before)[0].real
        for k, (time, _) in enumerate(self._all[0].impulses):
            if time.real == t:
                impulse = np.array([one.impulses[k][1] for one in self._all]).T
                carried = self._kicked(carried, impulse)
        return _joined(carried - 1j * STEP * moved * self._evaluate(t, carried, after)[0].real)

    def _kicked(self, x: Complex, impulse: Complex) -> Complex:
        """M dp = J + Phi^T Lambda, Phi dp = 0: the difference that J makes as a force."""
        u = np.zeros((5, x.shape[1]), dtype=np.complex128)
        without = self._motion(x, u, self._c)[0]
        u[2:] = impulse
        change = self._motion(x, u, self._c)[0] - without
        # Targets are the same in both, so that only p changes.
        return np.concatenate([x[:9], x[9:18] + change[9:18], x[18:]])

    def _rows(self, rows: list[tuple[float, float, Floats]]) -> None:
        found: dict[str, list[Complex]] = {}
        for t, inside, z in rows:
            x = _split(z)
            _, multipliers, torque = self._evaluate(t, x, inside)
            parts = {"state": x[:18], "integral": x[18:]}
            for name, part in (parts | {"multipliers": multipliers, "torque": torque}).items():
                found.setdefault(name, []).append(part)
        whole = {name: np.array(parts) for name, parts in found.items()}
        self.values = {name: part[..., 0].real for name, part in whole.items()}
        self.slopes = {name: part.imag / STEP for name, part in whole.items()}


def _joined(x: Complex) -> Floats:
    """The values of the first direction and all derivatives, as one vector."""
    return np.concatenate([x[:, 0].real, (x.imag / STEP).ravel()])


def _split(z: Floats) -> Complex:
    return z[:20, None] + 1j * STEP * z[20:].reshape(20, -1)


def _size(scene: sp.Scene, path: str, index: tuple[int, ...]) -> float:
    if path.startswith("initial") or path.split(".")[-1] in ("time", "times", "duration"):
        return 1e-3
    return max(1e-3, abs(float(np.asarray(resolve(scene, path))[index])))


class Case(NamedTuple):
    scene: sp.Scene
    paths: tuple[str, ...]
    formulations: tuple[str, ...] = tuple(_core.FORMULATIONS)


CASES = {
    "in contact": Case(uneven(), (*SIDED, *SMOOTH_INPUTS, *TIMES)),
    "pressed, with jumps": Case(
        shared(
            disturbances=(IMPULSE, LOADS[1], sp.Step(time=0.0157, force=(1.0, 2.0))), schedule=STEPS
        ),
        (
            *SHARED,
            "grasped.width",
            "schedule.times",
            "schedule.angles",
            *(f"disturbances.0.{name}" for name in ("time", "impulse", "angular_impulse")),
            "disturbances.1.time",
            "disturbances.1.duration",
            "disturbances.2.time",
        ),
    ),
    "touching": Case(
        shared(initial="touching", schedule=SMOOTH),
        (
            *SHARED,
            "hand.right.length",
            "hand.left.root_offset",
            "hand.right.half_thickness",
            "grasped.width",
            "schedule.move_time",
            "schedule.times",
        ),
    ),
    # Off the constraints as only this formulation can be.
    "with a state": Case(
        moving(uneven()), ("initial.q", "initial.p", "initial.integral", *SIDED), ("csm",)
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_derivatives_obey_the_variational_equations(name: str) -> None:
    """At some ends of steps, one at least in each segment, by every formulation.

    Where nothing jumps, free steps have derivatives as accurate as their motion.
    """
    scene, paths, formulations = CASES[name]
    run = sp.simulate(scene, dt=DT)
    times = run.t[[0, len(run.t) // 7, len(run.t) // 3, 2 * len(run.t) // 3, -2, -1]]
    numbers = [(path, index) for path in paths for index in entries(scene, path)]
    expected = Variations(scene, numbers, times).slopes
    how: dict[str, Any] = {"record": RECORD, "sensitivities": paths}
    for formulation in formulations:
        run = sp.simulate(scene, dt=DT, method="dop853", formulation=formulation, **how)
        rows = np.searchsorted(run.t, times)
        np.testing.assert_array_equal(run.t[rows], times)
        for quantity, slopes in expected.items():
            for k, (path, index) in enumerate(numbers):
                ours = of(run, quantity, path, index)[rows]
                off = difference(ours, slopes[:, :, k], quantity)
                assert off <= 1e-8, (formulation, quantity, path, index)
    if name != "in contact":
        return
    for method, tolerance, bound in FREE:
        free = sp.simulate(scene, method=method, tolerance=tolerance, times=times,
                           formulation="nullspace", **how)  # fmt: skip
        for k, (path, index) in enumerate(numbers):
            off = difference(of(free, "state", path, index), expected["state"][:, :, k])
            assert off <= bound, (method, path, index, off)
