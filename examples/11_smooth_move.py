"""The smoothest move
==================

A move between two poses that never pulls: direct shooting with exact derivatives::

    python examples/11_smooth_move.py [smooth_move.png]

Two fingers hold a box lightly, and shall turn and shift it within 40 ms. The smoothest motion of
the fingers that does this would need tips that pull, which real tips cannot. So their targets at a
few knots are chosen such that

- the integral of the fingers' squared accelerations is smallest (the objective),
- at the end the box has its new x and angle, and box and fingers are at rest (equalities),
- both tips press with 0.5 N or more at every step (inequalities).

Each evaluation is one run: direct shooting. `sp.simulate(..., sensitivities="schedule.angles")`
gives the derivatives of all its rows by all knots, and the chain rule in NumPy those of objective
and constraints. `scipy.optimize` (SLSQP) takes them; beside it, it works with finite differences.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import minimize

import softpinch as sp
from softpinch.plot.style import BLACK, GREY, PAGE, RED, tag

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("smooth_move.png"))
given = parser.parse_args()

Floats = NDArray[np.float64]
PATH = "schedule.angles"
START, GOAL = np.array([1.5, 1.5]), np.array([15.0, -12.0])  # degrees
SPAN = 12.0  # degrees
DURATION, DT = 0.04, 2e-4  # s
LEAST = 0.5  # N
KNOTS = np.linspace(0.0, DURATION, 11)
# Deviations at the end that count as 1: of x, m, and theta, rad; then of the rates of x, y, theta
# and the fingers, m/s and rad/s.
ENDS = [0, 2, *range(9, 14)]
SIZES = np.array([1e-3, 1e-2, 0.1, 0.1, 1.0, 1.0, 1.0])


def held(angles: Floats) -> sp.Scene:
    """A scene whose fingers are held at constant targets, in degrees."""
    return sp.Scene(schedule=sp.Schedule.steps([0.0], np.deg2rad([angles])))


rest, end = sp.equilibrium(held(START)), sp.equilibrium(held(GOAL))
assert rest.state is not None and end.state is not None
scene = replace(held(START), initial=replace(rest.state, time=0.0), duration=DURATION)
wanted = np.concatenate([end.state.q[[0, 2]], np.zeros(5)])
print(f"from {rest}\nto   {end}")


class Move(NamedTuple):
    """What a run is judged by, and the derivatives of it by the targets, if they were asked for."""

    run: sp.Run
    cost: float  # integral of the fingers' squared accelerations, 1000 rad^2/s^3
    ends: Floats  # (7,), 0 at the goal
    pressing: Floats  # (2 n,), N, 0 or more
    cost_slope: Floats
    ends_slope: Floats
    pressing_slope: Floats


class Shooting:
    """The runs by their targets, in degrees, at the knots after the first, flat (20,)."""

    def __init__(self, exact: bool) -> None:
        """Runs have derivatives if `exact`."""
        self.paths = (PATH,) if exact else ()
        self.moves: dict[bytes, Move] = {}
        self.seconds = 0.0

    def __call__(self, targets: Floats) -> Move:
        """The move with these targets; SciPy asks for its parts one after another."""
        key = targets.tobytes()
        if key not in self.moves:
            began = time.perf_counter()
            self.moves[key] = self._compute(targets)
            self.seconds += time.perf_counter() - began
        return self.moves[key]

    def _compute(self, targets: Floats) -> Move:
        angles = np.deg2rad(np.vstack([START, targets.reshape(-1, 2)]))
        run = sp.simulate(
            replace(scene, schedule=sp.Schedule.ramps(KNOTS, angles)),
            dt=DT,
            record=("state", "multipliers"),
            stop_on=(),  # the search may pass where a tip would leave the box
            sensitivities=self.paths,
        )
        assert run.success, run.message  # all runs have the same rows then
        state = np.hstack([run.q, run.p])
        step = np.diff(run.t)[:, None]
        # The mean acceleration in a step, of each finger.
        acceleration = np.diff(run.p[:, 3:5], axis=0) / step
        cost = 1e-3 * float(np.sum(step * acceleration**2))
        ends = (state[-1, ENDS] - wanted) / SIZES
        pressing = run.multipliers[:, :2].ravel() - LEAST
        slopes = [np.empty(0)] * 3
        if self.paths:
            # The chain rule. All columns are derivatives by one target; the first knot is fixed.
            n, free = len(run), targets.size
            by_target = np.deg2rad(run.sensitivity[PATH][:, :, 1:].reshape(n, 18, free))
            forces = np.deg2rad(run.sensitivity.multipliers[PATH][:, :2, 1:].reshape(2 * n, free))
            rates = np.diff(by_target[:, 12:14], axis=0)
            slopes[0] = 2e-3 * np.einsum("ki,kij->j", acceleration, rates)
            slopes[1] = by_target[-1, ENDS] / SIZES[:, None]
            slopes[2] = forces
        return Move(run, cost, ends, pressing, *slopes)


class Found(NamedTuple):
    """A solution, and what it took."""

    move: Move
    iterations: int
    runs: int
    seconds: float
    in_runs: float  # s


def smoothest(first: Floats, exact: bool = True, pushing: bool = True) -> Found:
    """Solves the problem from first targets; without `pushing` tips may pull."""
    began = time.perf_counter()
    shoot = Shooting(exact)
    at_goal: dict[str, Any] = {"type": "eq", "fun": lambda x: shoot(x).ends}
    pushes: dict[str, Any] = {"type": "ineq", "fun": lambda x: shoot(x).pressing}
    if exact:
        at_goal["jac"] = lambda x: shoot(x).ends_slope
        pushes["jac"] = lambda x: shoot(x).pressing_slope
    done = minimize(
        lambda x: shoot(x).cost,
        first,
        jac=(lambda x: shoot(x).cost_slope) if exact else None,
        method="SLSQP",
        constraints=[at_goal, pushes] if pushing else [at_goal],
        # Far from the usual path a tip leaves the box and the model ends.
        bounds=[(x - SPAN, x + SPAN) for x in first],
        options={"maxiter": 200, "ftol": 1e-7},
    )
    assert done.success, done.message
    seconds = time.perf_counter() - began
    return Found(shoot(done.x), done.nit, len(shoot.moves), seconds, shoot.seconds)


def told(name: str, found: Found) -> None:
    """Prints a line of the table."""
    move = found.move
    print(
        f"{name:<30}{move.cost:14.3f}{move.pressing.min() + LEAST:13.2f}{found.iterations:11d}"
        f"{found.runs:6d}{found.seconds:9.2f}{found.in_runs:9.2f}"
    )


# The usual smooth path is the first guess. The fingers lag behind it, so it misses the goal.
share = KNOTS[1:, None] / DURATION
path = START + (GOAL - START) * (10 * share**3 - 15 * share**4 + 6 * share**5)
first = path.ravel()
pulling = smoothest(first, pushing=False)
best = smoothest(first)
differences = smoothest(first, exact=False)
print(
    "                                integral of  least normal                     time  of it in"
)
print(
    "                              acceleration^2     force, N iterations  runs   all, s   runs, s"
)
told("tips may pull", pulling)
told("tips press, our derivatives", best)
told("tips press, differences", differences)
print(f"the same solution, within {np.ptp([best.move.cost, differences.move.cost]):.1g}")

# Again with a tenth of the step, and with the checks that the search left out.
for name, found in (("may pull", pulling), ("press", best)):
    again = sp.simulate(found.move.run.scene, dt=DT / 10, every=10)
    print(f"tips {name}, with dt = {DT / 10:g} s: {again.status}, violations {again.violations}")
    if again.success:
        off = np.abs(again.q[-1, :2] - found.move.run.q[-1, :2]).max()
        print(f"the box is where it was with dt = {DT:g} s, within {off:.1g} m")

with sp.plot.styled():
    figure = Figure(figsize=(PAGE, 3.0), layout="constrained")
    angles, forces = figure.subplots(1, 2)
    for label, found, color in (("may pull", pulling, RED), ("never pulls", best, BLACK)):
        run = found.move.run
        for k, dashes in enumerate(("-", (0, (4, 1.5)))):
            which = f"{label}, {('right', 'left')[k]}"
            angles.plot(1e3 * run.t, np.rad2deg(run.q[:, 3 + k]), color=color, linestyle=dashes)
            forces.plot(
                1e3 * run.t, run.multipliers[:, k], color=color, linestyle=dashes, label=which
            )
        targets = np.rad2deg(run.scene.schedule.angles)
        angles.plot(1e3 * KNOTS, targets, color=color, marker=".", linestyle="none")
    forces.axhline(0.0, color=GREY, linewidth=0.6)
    angles.set_ylabel("angles of the fingers [deg],\ndots: their targets at the knots")
    forces.set_ylabel("normal forces on the tips [N]")
    for axes, letter in ((angles, "a"), (forces, "b")):
        axes.set_xlabel("time [ms]")
        tag(axes, letter)
    forces.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
print("saved", sp.plot.save(figure, given.picture))
