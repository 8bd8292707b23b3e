"""Cost of the derivatives of runs, beside runs without them and beside finite differences.

make bench-sensitivity
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from command import parser
from document import put
from machine import clock, describe
from softpinch.scene.template import SceneTemplate

Floats = NDArray[np.float64]
METHODS = ("rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock")
FORMULATIONS = ("csm", "nullspace")
# Eight numbers: six of the parameters, and the two of a force.
EIGHT = (
    "hand.tip.youngs_modulus",
    "hand.tip.normal_viscosity",
    "control.kp",
    "control.kd",
    "control.ki",
    "grasped.mass",
    "disturbances.0.force",
)
# The steps of finite differences, as shares of the numbers.
SHARES = 10.0 ** np.arange(-1.0, -10.5, -0.5)
KNOTS = 32


def pushed(duration: float) -> sp.Scene:
    """A grasp that moves, and is pushed for a quarter of the duration."""
    times = np.linspace(0.0, duration, KNOTS)
    angles = np.deg2rad(8.0 + np.outer(np.sin(4.0 * times / duration), [4.0, -3.0]))
    push = sp.Pulse(time=0.25 * duration, duration=0.25 * duration, force=(2.0, -3.0))
    return sp.Scene(
        schedule=sp.Schedule.ramps(times, angles),
        grasped=sp.GraspedObject(com_offset=4e-3),
        disturbances=[push],
        duration=duration,
    )


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def medians(
    works: Sequence[Callable[[], object]], rounds: int, budget: float
) -> tuple[list[float], list[float]]:
    """Median times, ms, and medians of the ratios to the first work, round by round."""
    times = clock(works, rounds, budget)
    common = [own[: min(len(own), len(times[0]))] for own in times]
    ratios = [float(np.median(own / times[0][: len(own)])) for own in common]
    return [1e3 * float(np.median(own)) for own in times], ratios


class Measurement:
    """The parts of the report. `quick` shows that they work, on short scenes."""

    def __init__(self, quick: bool) -> None:
        """Chooses the scene and the number of rounds."""
        self.quick = quick
        self.scene = pushed(0.02 if quick else 1.0)
        self.rounds, self.budget = (3, 0.1) if quick else (11, 3.0)

    def medians(self, works: Sequence[Callable[[], object]]) -> tuple[list[float], list[float]]:
        """Times and ratios of works that take turns."""
        return medians(works, self.rounds, self.budget)

    def methods(self) -> str:
        """Eight directions beside the run alone, for each pair, with few rows and with all."""
        rows = []
        for method in METHODS:
            for formulation in FORMULATIONS:
                works = []
                for every in (100, 1):
                    run = partial(
                        sp.simulate,
                        self.scene,
                        dt=1e-4,
                        method=method,
                        formulation=formulation,
                        every=every,
                    )
                    works += [run, partial(run, sensitivities=EIGHT)]
                few, ratios = self.medians(works[:2])
                whole, of_all = self.medians(works[2:])
                rows.append(
                    [
                        f"`{method}`",
                        f"`{formulation}`",
                        *(f"{time:.3g}" for time in few),
                        f"{ratios[1]:.1f}",
                        *(f"{time:.3g}" for time in whole),
                        f"{of_all[1]:.1f}",
                    ]
                )
        head = ["method", "formulation", "run, ms", "with eight", "ratio"]
        return table([*head, "every row: run, ms", "with eight", "ratio"], rows)

    def directions(self) -> str:
        """One to 64 directions, and JAX with eight."""
        run = partial(sp.simulate, self.scene, dt=1e-4, every=100)
        asked: list[tuple[str, int, tuple[str, ...]]] = [
            ("`schedule.angles.1.0`", 1, ("schedule.angles.1.0",)),
            ("four knots", 8, tuple(f"schedule.angles.{k}" for k in range(4))),
            ("eight knots", 16, tuple(f"schedule.angles.{k}" for k in range(8))),
            ("`schedule.angles`", 2 * KNOTS, ("schedule.angles",)),
            ("a parameter", 1, EIGHT[:1]),
            ("six parameters and a force", 8, EIGHT),
        ]
        works: list[Callable[[], object]] = [run]
        works += [partial(run, sensitivities=paths) for _, _, paths in asked]
        names = [("the run alone", 0), *((name, count) for name, count, _ in asked)]
        if find_spec("jax") is not None:
            works.append(self.by_jax())
            names.append(("six parameters and a force, `jax.grad`, `final_state`", 8))
        times, ratios = self.medians(works)
        rows = [
            [
                name,
                str(count),
                f"{time:.3g}",
                f"{ratio:.1f}",
                f"{(ratio - 1) / count:.2f}" if count else "",
            ]
            for (name, count), time, ratio in zip(names, times, ratios, strict=True)
        ]
        return table(
            ["derivatives by", "directions", "ms", "ratio", "runs for each direction"], rows
        )

    def by_jax(self) -> Callable[[], object]:
        """The gradient of a number of the last state, by eight numbers, compiled."""
        import jax

        import softpinch.jax

        jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]
        layer = softpinch.jax.final_state(self.scene, EIGHT, dt=1e-4)
        gradient = jax.jit(jax.grad(lambda values: layer(values).q[0]))
        values = {path: np.array(value) for path, value in numbers(self.scene).items()}
        return lambda: jax.block_until_ready(gradient(values))  # type: ignore[no-untyped-call]

    def overhead(self) -> str:
        """Runs of ten steps: what Python and the border take."""
        short = pushed(1e-3)
        run = partial(sp.simulate, short, dt=1e-4, every=100)
        works = [
            run,
            partial(run, sensitivities=EIGHT[:6]),
            partial(run, sensitivities=EIGHT),
            partial(run, sensitivities="schedule.angles"),
        ]
        names = ("the run", "six parameters", "six parameters and a force", "64 angles")
        times, _ = self.medians(works)
        rows = [[name, f"{time:.2f}"] for name, time in zip(names, times, strict=True)]
        return table(["short run", "ms"], rows)

    def differences(self) -> str:
        """Error against time: our derivatives, and differences with the best of all steps."""
        scene = self.scene
        reference = Reference(scene)
        rows = []
        for name, how in settings(self.quick):
            run = partial(rows_of, scene, how)
            ours = partial(rows_of, scene, how, EIGHT)
            times, _ = self.medians([run, ours])
            error = reference.error(ours()[1])
            cells = [name, f"{times[0]:.3g}", f"{error:.0e}", f"{times[1]:.3g}"]
            shares = SHARES[::6] if self.quick else SHARES
            for central in (False, True):
                found = [reference.error(difference(scene, how, s, central)) for s in shares]
                count = 17 if central else 9
                best = int(np.argmin(found))
                cells += [
                    f"{found[best]:.0e} at {shares[best]:.0e}",
                    f"{count * times[0]:.3g}",
                ]
            rows.append(cells)
        head = ["run", "ms", "ours: error", "ms", "9 runs: error", "ms", "17 runs: error", "ms"]
        note = "The reference and differences of order 6, with another formulation, are"
        return f"{table(head, rows)}\n\n{note} {reference.apart:.0e} apart."

    def ensembles(self) -> str:
        """Gradients of summaries in an ensemble on one thread, for each run."""
        runs = 16 if self.quick else 128
        modulus = np.geomspace(2e5, 5e5, runs)
        scene = self.scene if self.quick else pushed(0.2)
        many = partial(
            sp.monte_carlo,
            scene,
            vary={EIGHT[0]: modulus},
            dt=1e-4,
            summaries=("final_state", "peak_rotation"),
            threads=1,
            progress=False,
        )
        wanted = partial(many, gradients=("final_state", "peak_rotation"))
        single = partial(sp.simulate, scene, dt=1e-4, every=100)

        def alone(**more: Any) -> None:
            for _ in range(runs):
                single(**more)

        asked: list[tuple[str, Callable[[], object]]] = [
            ("ensemble, no gradients", many),
            ("gradients by one parameter", wanted),
            ("by six parameters", partial(wanted, sensitivities=EIGHT[:6])),
            ("by six parameters and a force", partial(wanted, sensitivities=EIGHT)),
            ("`simulate` for each run, no derivatives", alone),
            (
                "`simulate` for each run, six parameters and a force",
                partial(alone, sensitivities=EIGHT),
            ),
        ]
        times, ratios = medians([work for _, work in asked], 3 if self.quick else 5, 60.0)
        rows = [
            [name, f"{1e3 * time / runs:.3g}", f"{ratio:.1f}"]
            for (name, _), time, ratio in zip(asked, times, ratios, strict=True)
        ]
        return table(["", "us for each run", "ratio"], rows)

    def parts(self) -> Iterator[tuple[str, str]]:
        """Name and table of each part."""
        yield "sensitivity methods", self.methods()
        yield "sensitivity directions", self.directions()
        yield "sensitivity overhead", self.overhead()
        yield "sensitivity differences", self.differences()
        yield "sensitivity ensembles", self.ensembles()


def settings(quick: bool) -> list[tuple[str, dict[str, Any]]]:
    """Name and options of the runs whose derivatives are compared with a reference."""
    found: list[tuple[str, dict[str, Any]]] = []
    for method, formulation, lengths in (
        ("rk4", "csm", (4e-4, 1e-4, 2.5e-5)),
        ("dop853", "nullspace", (1e-3, 4e-4, 2e-4)),
        ("radau5", "nullspace", (1e-3, 2e-4)),
    ):
        for dt in lengths[:1] if quick else lengths:
            own = {"method": method, "formulation": formulation, "dt": dt}
            found.append((f"`{method}`, `{formulation}`, dt = {dt:g} s", own))
    for tolerance in (1e-5,) if quick else (1e-5, 1e-8, 1e-11):
        own = {"method": "dop853", "formulation": "nullspace", "tolerance": tolerance}
        found.append((f"`dop853`, `nullspace`, tolerance = {tolerance:.0e}", own))
    return found


def numbers(scene: sp.Scene) -> dict[str, Any]:
    """Path -> value of the eight numbers."""
    tip, control, push = scene.hand.tips[0], scene.control, scene.disturbances[0]
    assert isinstance(control, sp.Pid) and isinstance(push, sp.Pulse)
    values = (tip.youngs_modulus, tip.normal_viscosity, control.kp, control.kd, control.ki)
    return dict(zip(EIGHT, (*values, scene.grasped.mass, push.force), strict=True))


def rows_of(
    scene: sp.Scene, how: Mapping[str, Any], paths: Sequence[str] = ()
) -> tuple[Floats, Floats]:
    """The last row of a run (18,), and its derivatives by all numbers (18, d)."""
    last: dict[str, Any] = {"every": 1_000_000}
    if "tolerance" in how:
        last = {"times": np.array([scene.duration])}
    run = sp.simulate(scene, **how, **last, sensitivities=paths)
    assert run.success, run.message
    slopes = [run.sensitivity[path][-1].reshape(18, -1) for path in paths]
    return np.concatenate([run.q[-1], run.p[-1]]), np.hstack(slopes or [np.zeros((18, 0))])


def difference(
    scene: sp.Scene, how: Mapping[str, Any], share: float, central: bool, order: int = 2
) -> Floats:
    """The derivatives (18, d) by finite differences with steps that are shares of the numbers."""
    # Multiple of the step -> weight.
    weights = {1: 1.0, 0: -1.0}
    if central:
        weights = {1: 0.5, -1: -0.5}
    if order == 6:
        weights = {1: 45, 2: -9, 3: 1, -1: -45, -2: 9, -3: -1}
        weights = {k: w / 60 for k, w in weights.items()}
    columns = []
    values = numbers(scene)
    template = SceneTemplate(scene, EIGHT, 0)
    for path, value in values.items():
        flat = np.atleast_1d(np.asarray(value, dtype=np.float64))
        for n in range(len(flat)):
            step = share * abs(flat[n])
            column = np.zeros(18)
            for k, weight in weights.items():
                moved = flat.copy()
                moved[n] += k * step
                there = template.changed({**values, path: moved.reshape(np.shape(value))})
                column += weight / step * rows_of(there, how)[0]
            columns.append(column)
    return np.column_stack(columns)


class Reference:
    """Derivatives of the exact motion at its end (18, d), and their sizes along the run."""

    def __init__(self, scene: sp.Scene) -> None:
        """Computes them with short steps, and again by differences of another formulation."""
        fine: dict[str, Any] = {"method": "dop853", "formulation": "nullspace", "dt": 2e-5}
        run = sp.simulate(scene, **fine, every=100, sensitivities=EIGHT)
        slopes = [run.sensitivity[path].reshape(len(run), 18, -1) for path in EIGHT]
        whole = np.concatenate(slopes, axis=2)
        self.exact = whole[-1]
        self.sizes = np.abs(whole).max(axis=0)
        again = difference(scene, {**fine, "formulation": "csm"}, 2e-2, central=True, order=6)
        self.apart = self.error(again)

    def error(self, found: Floats) -> float:
        """The largest error of derivatives, each scaled by its largest size along the run."""
        return float(np.max(np.abs(found - self.exact) / self.sizes))


def main() -> None:
    quick = parser(__doc__).parse_args().quick
    jax = find_spec("jax") is not None
    missing = {} if jax else {"JAX": "not installed"}
    machine = describe(libraries=["jax"] if jax else [], missing=missing)
    print(f"{machine}\n\nmedians of works that take turns; ratios to a run without derivatives")
    if not quick:
        put("sensitivity machine", f"```\n{machine}\n```")
    for name, found in Measurement(quick).parts():
        print(f"\n{name}\n\n{found}")
        if not quick:
            put(name, found)


if __name__ == "__main__":
    main()
