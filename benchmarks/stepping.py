"""Cost of a period of a run that is stepped from outside, alone and in vectors, beside MuJoCo.

make bench-stepping
"""

import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
import stepping_peers
from command import parser
from document import folders, put
from machine import clock, describe, without_mujoco

PERIOD, DT = 1e-3, 1e-4  # s
EACH = round(PERIOD / DT)
GRIP, VARIED = 1.2, 0.02  # N m, mean and standard deviation of the torques
NUMBERS = (1, 8, 64, 256, 2048)
COMPARED = 256
# us for one period of one environment: the targets.
ALONE_TARGET, VECTOR_TARGET = 8.0, 1.0
PARTS = ("alone", "vector")
THREADS = os.cpu_count() or 1

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Work:
    """A timed work.

    Attributes:
        name: For the table.
        begin: Puts everything at its start; not timed.
        work: The work.
        periods: How many periods of one environment it computes.
        target: Most us for each of them that are aimed at.
        threads: How many compute.
    """

    name: str
    begin: Callable[[], object]
    work: Callable[[], object]
    periods: int
    target: float | None = None
    threads: int = 1


@dataclass(frozen=True)
class Timed:
    """Wall times of a period of one environment, us, and their ratios to the first work's.

    Attributes:
        work: What was timed.
        times: Of each round (rounds,).
        ratios: To the first work in the same round (rounds,).
    """

    work: Work
    times: Floats
    ratios: Floats

    @property
    def median(self) -> float:
        return float(np.median(self.times))

    def cells(self) -> str:
        low, middle, high = np.quantile(self.times, [0.25, 0.5, 0.75])
        return f"{middle:.3g} | {low:.3g} to {high:.3g} | {float(np.median(self.ratios)):.3g}"


def timed(works: Sequence[Work], rounds: int) -> list[Timed]:
    """All works, which take turns."""
    begins = [each.begin for each in works]
    spent = clock([each.work for each in works], rounds, math.inf, begins=begins)
    times = [1e6 * own / each.periods for each, own in zip(works, spent, strict=True)]
    return [Timed(each, own, own / times[0]) for each, own in zip(works, times, strict=True)]


def held_grasp() -> sp.Scene:
    """Our default grasp at rest under torques, on a clock that lasts for any benchmark."""
    scene = sp.Scene(
        control=sp.Torque(), schedule=sp.Schedule.steps([0.0], [[GRIP, GRIP]]), duration=1.0
    )
    rest = sp.simulate(scene, DT, every=10**9, record=("state",)).state(-1)
    return replace(scene, initial=replace(rest, time=0.0, grid=None), duration=1e6)


def torques(*shape: int) -> Floats:
    """Different in every period, as a controller's are; reproducible."""
    return GRIP + VARIED * np.random.default_rng(7).standard_normal((*shape, 2))


def stepped(scene: sp.Scene, held: Floats) -> Work:
    """`Simulator.step`, with the torques as a controller in NumPy gives them."""
    sim = sp.Simulator(scene, PERIOD, DT)

    def work() -> None:
        for torque in held:
            sim.step(torque)
        if sim.observation.status != "running":
            raise RuntimeError(sim.message)

    return Work("`Simulator.step`", sim.reset, work, len(held), ALONE_TARGET)


def core_stepped(scene: sp.Scene, held: Floats) -> Work:
    """The core's own step, which builds the arrays of an observation."""
    sim = sp.Simulator(scene, PERIOD, DT)
    step = sim._core.step
    pairs = [(right, left) for right, left in held.tolist()]

    def work() -> None:
        for right, left in pairs:
            step(right, left, None)

    return Work("the same without its Python: the core's step", sim.reset, work, len(held))


def one_run(scene: sp.Scene, periods: int) -> Work:
    """The same steps in one `simulate`, with torques that do not change."""
    whole = replace(scene, duration=periods * PERIOD)
    work = partial(sp.simulate, whole, DT, every=10**9, record=("state",))
    name = f"one `simulate` of {1e3 * periods * PERIOD:g} ms, for each ms"
    return Work(name, lambda: None, work, periods)


def rebuilt(scene: sp.Scene, held: Floats) -> Work:
    """Without simulators: a scene for each period, which starts at the state before."""

    def work() -> None:
        state = scene.initial
        for torque in held:
            now = replace(
                scene,
                schedule=sp.Schedule.steps([0.0], [torque]),
                initial=state,
                duration=PERIOD,
            )
            run = sp.simulate(now, DT, record=("state", "multipliers"), every=EACH)
            state = run.state(-1)

    return Work("a `Scene` and a `simulate` for each period", lambda: None, work, len(held))


def alone(quick: bool) -> list[Timed]:
    """One environment."""
    scene, held = held_grasp(), torques(10 if quick else 200)
    works = [
        stepped(scene, held),
        core_stepped(scene, held),
        one_run(scene, 1000),
        rebuilt(scene, held[: len(held) // 10]),
    ]
    if not without_mujoco():
        for integrator in stepping_peers.INTEGRATORS:
            for one_by_one, called in (
                (True, f"{EACH} calls of `mj_step`"),
                (False, f"`mj_step(..., {EACH})`"),
            ):
                begin, work = stepping_peers.alone(
                    integrator, DT, EACH, held[: len(held) // 2], one_by_one
                )
                works.append(Work(f"MuJoCo, {integrator}, {called}", begin, work, len(held) // 2))
            # The longest step with which its pinch holds; it needs no order four.
            begin, work = stepping_peers.alone(integrator, PERIOD, 1, held[: len(held) // 2], True)
            name = f"MuJoCo, {integrator}, one step of {1e3 * PERIOD:g} ms"
            works.append(Work(name, begin, work, len(held) // 2))
    return timed(works, 3 if quick else 31)


def many(scene: sp.Scene, actions: Floats, threads: int, by_core: bool = False) -> Work:
    """`VectorSimulator.step`, or only the core's part of it."""
    periods, n, _ = actions.shape
    sims = sp.VectorSimulator(scene, n, PERIOD, DT, threads=threads)
    t, q, p, multipliers, _ = sims.observations
    arrays = (t, q, p, multipliers, np.empty(n, np.uint8))

    def work() -> None:
        for action in actions:
            sims.step(action)
        if (sims.observations.status != "running").any():
            raise RuntimeError("an environment has ended")

    def core_work() -> None:
        for action in actions:
            sims._core.step_all(action, None, arrays)

    if by_core:
        name = f"{n} environments, without its Python"
        return Work(name, sims.reset, core_work, periods * n, threads=threads)
    target = VECTOR_TARGET if n == COMPARED else None
    name = f"{n} environment{'s' * (n > 1)}"
    return Work(name, sims.reset, work, periods * n, target, threads)


def ensembles(scene: sp.Scene, threads: int) -> list[Work]:
    """The same steps in `monte_carlo`: plain, with a breakpoint of noise, and with a sample."""
    rate = 1.0 / PERIOD
    noisy = replace(scene, disturbances=(sp.Noise(force_std=0.1, moment_std=0.0, rate_hz=rate),))
    controller = sp.SampledController.pid(
        PERIOD, 4.0, 0.05, 0.0, initial_torque=(GRIP, GRIP), limits=(-3.0, 3.0)
    )
    rest = scene.start().q[3:5]
    targets = sp.Schedule.steps([0.0], [rest + GRIP / 4.0])
    sampled = replace(scene, control=controller, schedule=targets)
    late = replace(sampled, control=replace(controller, delay=1.4 * PERIOD))
    return [
        ensemble(scene, "", threads),
        ensemble(noisy, ", with a sample of noise in each", threads),
        ensemble(sampled, ", with a `SampledController` (PD)", threads),
        ensemble(late, ", with the same and a delay of 1.4 ms", threads),
        *two_rates(sampled, threads),
    ]


def two_rates(scene: sp.Scene, threads: int) -> list[Work]:
    """A camera at 31 Hz before the PD of a scene, in the core and in NumPy."""
    frame, late, gain, apart = 32, 30, 8.0, np.array([[1.0], [-1.0]])  # periods
    servo, targets = scene.control, scene.schedule.target(0.0)
    assert isinstance(servo, sp.SampledController)
    camera = sp.SampledController(
        frame * PERIOD,
        A=np.eye(1),
        B=np.array([[frame * PERIOD, 0.0, 0.0]]),
        C=gain * apart,
        D=np.hstack([np.zeros((2, 1)), np.eye(2)]),
        measures=("rotation", "target"),
        measure_delay=late * PERIOD,
        initial_torque=(float(targets[0]), float(targets[1])),
    )
    both = replace(scene, control=sp.SampledController.cascade([camera, servo]))
    in_core = ensemble(both, ", with a camera at 31 Hz and the PD at 1 kHz", threads)
    free = replace(scene, control=sp.Torque(), schedule=sp.Schedule.steps([0.0], [[GRIP, GRIP]]))
    sims = sp.VectorSimulator(free, COMPARED, PERIOD, DT, threads=threads)
    periods = 100

    def work() -> None:
        seen, turned = sims.observations, np.zeros((periods, COMPARED, 1))
        integral = np.zeros((COMPARED, 1))
        for k in range(periods):
            turned[k] = seen.q[:, 2:3]
            if k % frame == 0 and k >= late:
                integral += frame * PERIOD * turned[k - late]
            wanted = targets + gain * integral * apart.T
            seen = sims.step(
                np.clip(4.0 * (wanted - seen.q[:, 3:5]) - 0.05 * seen.p[:, 3:5], -3, 3)
            )
        if (seen.status != "running").any():
            raise RuntimeError("an environment has ended")

    name = f"the same camera and PD in NumPy, {COMPARED} environments"
    return [in_core, Work(name, sims.reset, work, periods * COMPARED, threads=threads)]


def ensemble(scene: sp.Scene, what: str, threads: int, n: int = COMPARED) -> Work:
    """One `monte_carlo`."""
    periods = 100
    whole = replace(scene, duration=periods * PERIOD)
    work = partial(
        sp.monte_carlo, whole, runs=n, dt=DT, summaries=(), threads=threads, progress=False
    )
    name = f"one `monte_carlo` of {n} runs of {1e3 * periods * PERIOD:g} ms, for each ms{what}"
    return Work(name, lambda: None, work, n * periods, threads=threads)


def vector(quick: bool) -> list[Timed]:
    """Many environments; the first row is what the ratios refer to."""
    scene = held_grasp()
    numbers = (8, COMPARED) if quick else NUMBERS
    # Enough for the clock, and so few that torques without feedback do not lose the object.
    actions = {n: torques(2 if quick else min(max(4, 2048 // n), 200), n) for n in numbers}
    works = []
    for threads in sorted({1, THREADS}):
        works += [
            many(scene, actions[COMPARED], threads),
            many(scene, actions[COMPARED], threads, by_core=True),
            *(many(scene, actions[n], threads) for n in numbers if n != COMPARED),
            *ensembles(scene, threads),
        ]
        for integrator in () if without_mujoco() else stepping_peers.INTEGRATORS:
            few = actions[COMPARED][: 1 if quick else 2]
            begin, work = stepping_peers.many(integrator, DT, EACH, few, threads)
            name = f"MuJoCo, {integrator}, `rollout` of {COMPARED}"
            works.append(Work(name, begin, work, len(few) * COMPARED, threads=threads))
    return timed(works, 3 if quick else 21)


def table(rows: Sequence[Timed]) -> str:
    """A line for each name, with columns for each number of threads."""
    counts = sorted({each.work.threads for each in rows})
    names = list(dict.fromkeys(each.work.name for each in rows))
    columns = "".join(
        f" us, {count} thread{'s' * (count > 1)} | quartiles | ratio |" for count in counts
    )
    lines = [f"| |{columns} target |", "|---" * (3 * len(counts) + 2) + "|"]
    for name in names:
        found = [each for each in rows if each.work.name == name]
        target, first = found[0].work.target, ", 1 thread" if len(found) > 1 else ""
        aim = "" if target is None else f"below {target:g}{first}"
        cells = " | ".join(each.cells() for each in found)
        lines.append(f"| {name} | {cells} | {aim} |")
    return "\n".join(lines)


def overhead(rows: Sequence[Timed]) -> str:
    """Parts of a step's time, from the rows of one environment."""
    whole, core, bare = (each.median for each in rows[:3])
    return (
        f"Of the {whole:.2f} us of `Simulator.step`, {bare:.2f} us are the {EACH} steps; "
        f"{core - bare:.2f} us are the core's for the start and the end of a period, its "
        f"multipliers and the arrays that it returns; {whole - core:.2f} us are Python's."
    )


def main() -> None:
    given = parser(__doc__, PARTS).parse_args()
    quick, parts = given.quick, given.part or PARTS
    missing = without_mujoco()
    machine = describe(
        f"1 thread and {THREADS}", libraries=[] if missing else ["mujoco"], missing=missing
    )
    print(machine)
    print(
        f"scene      a held grasp; torques that change every {1e3 * PERIOD:g} ms, "
        f"dt = {1e3 * DT:g} ms\n\n"
        "us for one period of one environment: median, quartiles, and the median of the ratios\n"
        "to the first row in the same round\n"
    )
    texts = [f"```\n{machine}\n```"]
    facts: dict[str, object] = {"machine": machine, "period": PERIOD, "dt": DT}
    for part in parts:
        rows = {"alone": alone, "vector": vector}[part](quick)
        text = table(rows) + (f"\n\n{overhead(rows)}" if part == "alone" else "")
        print(f"{text}\n", flush=True)
        texts.append(text)
        facts[part] = [
            {"name": each.work.name, "threads": each.work.threads, "us": each.times.tolist()}
            for each in rows
        ]
    if quick or set(parts) != set(PARTS):
        return
    with folders(quick) as (_, data):
        (data / "stepping.json").write_text(json.dumps(facts, indent=1), encoding="utf-8")
    put("stepping", "\n\n".join(texts))


if __name__ == "__main__":
    main()
