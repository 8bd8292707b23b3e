"""The lone run beside SciPy, on the paper's manipulation: steps a second, time at equal error.

make bench
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import softpinch as sp
from machine import describe, median_time
from numpy_model import right_hand_side
from softpinch import paper

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from oracle.trajectory import reference

Floats = NDArray[np.float64]
STABILIZATION = sp.Stabilization()
LEVELS = (1e-4, 1e-6, 1e-8)


def scipy_run(scene: sp.Scene, method: str, rtol: float) -> Floats:
    """The end of the run by `solve_ivp`, switch by switch."""
    f = right_hand_side(scene, STABILIZATION.alpha, STABILIZATION.beta)
    targets = np.asarray(scene.schedule.angles)
    edges = [*np.asarray(scene.schedule.times), scene.duration]
    start = sp.State.consistent(scene)
    y = np.concatenate([start.q, start.p, start.integral])
    # Lengths, angles, speeds and rates differ by decades, and so must what is negligible of each.
    size = np.array(
        [0.02, 0.08, 0.2, 0.4, 0.4] + 4 * [0.008] + [0.3, 0.3, 3, 6, 6] + 4 * [0.3] + [0.03] * 2
    )
    for a, b, target in zip(edges[:-1], edges[1:], targets, strict=True):
        done = solve_ivp(
            f, (a, b), y, method=method, rtol=rtol, atol=rtol * size, args=(target,), t_eval=[b]
        )
        y = done.y[:, -1]
    return np.asarray(y)


def first_below(
    level: float,
    settings: list[float],
    run: Callable[[float], Floats],
    error: Callable[[Floats], float],
) -> tuple[float, float] | None:
    """The loosest setting whose error at the end is below the level, and that error."""
    for setting in settings:
        found = error(run(setting))
        if found <= level:
            return setting, found
    return None


def main() -> None:
    scene = paper.manipulation()
    print(describe())
    print(f"           SciPy {scipy.__version__}")
    print(f"scene      the paper's manipulation, {scene.duration:g} s\n")

    def steps_a_second(**options: object) -> float:
        run = sp.simulate(scene, dt=1e-4, **options)
        return run.stats["steps"] / median_time(lambda: sp.simulate(scene, dt=1e-4, **options), 31)

    bare = steps_a_second(every=10**9)
    print("RK4, csm, monitors on: million steps a second (median of 31), share of the bare speed")
    for name, options in {
        "last state only": {"every": 10**9},
        "state, every 10th step": {"every": 10},
        "everything but energy, every 10th": {
            "every": 10,
            "record": ("state", "multipliers", "residuals"),
        },
        "everything, every 10th (carries the ledger)": {
            "every": 10,
            "record": ("state", "multipliers", "residuals", "energy"),
        },
        "state, every step": {"every": 1},
    }.items():
        speed = steps_a_second(**options)
        print(f"  {name:45s} {speed / 1e6:6.2f}  {speed / bare:5.0%}")

    exact = reference(scene)
    scale = np.abs(exact.q).max(axis=0)

    def error(end: Floats) -> float:
        return float((np.abs(end[:9] - exact.q[-1]) / scale).max())

    def ours(dt: float) -> Floats:
        return np.asarray(sp.simulate(scene, dt=dt, every=10**9).q[-1])

    print(
        "\nOne run at equal error of q at the end (the loosest setting that meets it), median of 5"
    )
    print(
        f"  {'error below':12s} {'method':8s} {'setting':>9s} {'error':>9s} "
        f"{'time, ms':>10s} {'ratio':>8s}"
    )
    tolerances = [10.0 ** (-k / 2) for k in range(6, 27)]
    for level in LEVELS:
        found = first_below(level, [2e-3 / 2 ** (k / 2) for k in range(14)], ours, error)
        if found is None:
            print(f"  {level:<12.0e} rk4 does not reach it")
            continue
        dt, reached = found
        base = median_time(lambda dt=dt: ours(dt), 5)  # type: ignore[misc]
        print(
            f"  {level:<12.0e} {'ours rk4':8s} {dt:9.1e} {reached:9.1e} {1e3 * base:10.2f} {1:8.1f}"
        )
        for method in ("RK45", "DOP853", "LSODA"):
            run: Callable[[float], Floats] = lambda rtol, m=method: scipy_run(scene, m, rtol)  # noqa: E731
            peer = first_below(level, tolerances, run, error)
            if peer is None:
                print(
                    f"  {level:<12.0e} {method:8s} does not reach it "
                    f"at rtol >= {tolerances[-1]:.0e}"
                )
                continue
            spent = median_time(lambda r=peer[0], f=run: f(r), 5)  # type: ignore[misc]
            print(
                f"  {level:<12.0e} {method:8s} {peer[0]:9.1e} {peer[1]:9.1e} {1e3 * spent:10.2f} "
                f"{spent / base:8.1f}"
            )


if __name__ == "__main__":
    main()
