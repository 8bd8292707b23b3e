"""The lone run beside SciPy, on the paper's manipulation: steps a second, time at equal error.

make bench
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import numpy_model
import softpinch as sp
from command import parser
from machine import describe, median_time
from softpinch import paper, reference

Floats = NDArray[np.float64]
GAINS = sp.Stabilization()
LEVELS = (1e-4, 1e-6, 1e-8)
STEPS = [2e-3 / 2 ** (k / 2) for k in range(14)]
TOLERANCES = [10.0 ** (-k / 2) for k in range(6, 27)]
LAST_ONLY = 10**9
RECORDED = {
    "last state only": {"every": LAST_ONLY},
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
}


def recording(scene: sp.Scene, repeats: int) -> None:
    """Steps a second, by what is recorded."""

    def steps_a_second(**options: object) -> float:
        run = sp.simulate(scene, dt=1e-4, **options)
        work = lambda: sp.simulate(scene, dt=1e-4, **options)  # noqa: E731
        return run.stats["steps"] / median_time(work, repeats)

    bare = steps_a_second(every=LAST_ONLY)
    print(
        f"RK4, csm, monitors on: million steps a second (median of {repeats}), "
        "share of the bare speed"
    )
    for name, options in RECORDED.items():
        speed = steps_a_second(**options)
        print(f"  {name:45s} {speed / 1e6:6.2f}  {speed / bare:5.0%}")


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


def equal_error(scene: sp.Scene, repeats: int, stride: int) -> None:
    """Time at equal error, with every so many of the settings tried."""
    exact = reference.solve(scene, [scene.duration])

    def error(end: Floats) -> float:
        return float((np.abs(end[:9] - exact.q[-1]) / exact.scales["q"]).max())

    def ours(dt: float) -> Floats:
        return np.asarray(sp.simulate(scene, dt=dt, every=LAST_ONLY).q[-1])

    solvers = {"ours rk4": (ours, STEPS)}
    for method in ("RK45", "DOP853", "LSODA"):
        run = numpy_model.by_scipy(scene, method, GAINS.alpha, GAINS.beta)
        solvers[method] = (run, TOLERANCES)
    print(
        "\nOne run at equal error of q at the end (the loosest setting that meets it), "
        f"median of {repeats}"
    )
    print(
        f"  {'error below':12s} {'method':8s} {'setting':>9s} {'error':>9s} "
        f"{'time, ms':>10s} {'ratio':>8s}"
    )
    for level in LEVELS:
        base = np.nan
        for name, (run, settings) in solvers.items():
            label = f"  {level:<12.0e} {name:8s}"
            found = first_below(level, settings[::stride], run, error)
            if found is None:
                print(f"{label} does not reach it with {settings[-1]:.1e}")
                continue
            setting, reached = found
            spent = median_time(lambda f=run, s=setting: f(s), repeats)  # type: ignore[misc]
            base = spent if run is ours else base
            print(
                f"{label} {setting:9.1e} {reached:9.1e} {1e3 * spent:10.2f} {spent / base:8.1f}",
                flush=True,
            )


def main() -> None:
    quick = parser(__doc__).parse_args().quick
    scene = paper.manipulation()
    if quick:
        scene = replace(scene, duration=0.05)
    print(describe(libraries=["SciPy"]))
    print(f"scene      the paper's manipulation, {scene.duration:g} s\n", flush=True)
    recording(scene, 3 if quick else 31)
    equal_error(scene, *((1, 3) if quick else (5, 1)))


if __name__ == "__main__":
    main()
