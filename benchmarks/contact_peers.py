"""Other simulators of contact with friction, at equal error: Siconos and MuJoCo.

Siconos integrates our equations as the tests call it (tests/oracle/moreau_jean.py); forces and
relations come from Python, which its time includes.
MuJoCo's contact is soft, a model of its own: its error is measured against itself at a small step.
"""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import creep
import softpinch as sp
from machine import median_time, without_mujoco

sys.path.append(str(Path(__file__).parent.parent / "tests"))

LEVELS = (1e-2, 1e-3, 1e-4)
FRICTION = 0.4
DURATION, ONSET, PULSE, FORCE = 0.05, 0.015, 0.01, -110.0  # s, s, s, N
# What makes MuJoCo's cube slip by a millimetre, N; its fingers' targets, m, which press with 58 N.
CUBE_FORCE, TARGET = -65.0, 0.02
# Where they start, and how often the steps are doubled.
OUR_STEPS, THEIR_STEPS = 50, 600
REPEATS = 15

Floats = NDArray[np.float64]
# What a simulator gives for a number of steps: states by kind at the end, its time, s, and a note.
End = tuple[list[Floats], float, str]
# Steps, error, time and note.
Rung = tuple[int, float, float, str]


def _oracle() -> Any:
    """The module that calls Siconos, or None where SymPy or Siconos is missing."""
    try:
        from oracle import moreau_jean
    except ImportError:
        return None
    return moreau_jean if moreau_jean.interpreter() else None


def missing() -> dict[str, str]:
    """Name -> why it does not take part."""
    absent = {} if _oracle() else {"Siconos": "not installed"}
    return {**absent, **without_mujoco()}


def libraries() -> list[str]:
    return [] if without_mujoco() else ["mujoco"]


def scene() -> sp.Scene:
    """A grasp whose object is pushed down; it slips between both tips, and stops."""
    return sp.Scene(
        hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 6]])),
        contact="unilateral",
        friction=FRICTION,
        disturbances=[sp.Pulse(time=ONSET, duration=PULSE, force=(0.0, FORCE), moment=0.0)],
        duration=DURATION,
    )


def _kinds(q: Floats, p: Floats) -> list[Floats]:
    """Lengths, angles, and the rates of both."""
    lengths, angles = [0, 1, 5, 6, 7, 8], [2, 3, 4]
    return [values[..., kind] for values in (q, p) for kind in (lengths, angles)]


def ours(steps: int) -> End:
    settings: dict[str, Any] = {"dt": DURATION / steps, "every": 10**9, "record": ("state",)}
    run = sp.simulate(scene(), **settings)
    work = partial(sp.simulate, scene(), **settings)
    return _kinds(run.q[-1], run.p[-1]), median_time(work, REPEATS, timer=time.process_time), ""


def siconos(steps: int) -> End:
    end = _oracle().stepped(scene(), (FRICTION, FRICTION), steps)
    total, terms = end.spent
    note = f"  of it {terms / total:.0%} in our forces, which are Python"
    return _kinds(end.q, end.p), total, note


def mujoco(steps: int) -> End:
    """A cube between stiff soft contacts, pushed down until it slips."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        creep.pinch({"cone": "elliptic", "impratio": "10"}, 0.004)
    )
    model.opt.timestep = DURATION / steps
    spent = []
    for _ in range(REPEATS if steps < 20_000 else 1):
        data = mujoco.MjData(model)
        data.ctrl[:] = TARGET
        begin = time.process_time()
        for name, until in (("rest", ONSET), ("push", ONSET + PULSE), ("after", DURATION)):
            data.xfrc_applied[1, 2] = CUBE_FORCE if name == "push" else 0.0
            mujoco.mj_step(
                model, data, round(until / DURATION * steps) - round(data.time * steps / DURATION)
            )
        spent.append(time.process_time() - begin)
    return [data.qpos[:2].copy(), data.qvel[:2].copy()], float(np.median(spent)), ""


def _rungs(
    solve: Callable[[int], End], first: int, most: int, exact: list[Floats], sizes: list[float]
) -> Iterator[Rung]:
    """The steps doubled until they are too many."""
    steps = first
    while steps <= most:
        end, spent, note = solve(steps)
        pairs = zip(end, exact, sizes, strict=True)
        yield steps, max(float(np.abs(a - b).max() / size) for a, b, size in pairs), spent, note
        steps *= 2


def _table(name: str, rungs: Iterator[Rung], levels: Sequence[float]) -> None:
    left = list(levels)
    for steps, error, spent, note in rungs:
        while left and error <= left[0]:
            label = f"{name:22s} {left.pop(0):8.0e}"
            print(f"  {label} {steps:8d} {error:9.1e} {1e3 * spent:10.3f}{note}", flush=True)
        if not left:
            return
    for level in left:
        print(f"  {name:22s} {level:8.0e}   does not get there", flush=True)


def peers(quick: bool) -> None:
    """Time at equal error of the end, the steps doubled until it is met."""
    levels, absent = LEVELS[:1] if quick else LEVELS, missing()
    dense = sp.simulate(scene(), dt=DURATION / 50_000)
    exact = _kinds(dense.q[-1], dense.p[-1])
    sizes = [float(np.abs(along).max()) for along in _kinds(dense.q, dense.p)]
    print(
        f"\n{DURATION:g} s in which a pushed object slips and stops, at equal error of the end; a "
        "state's error by\nthe largest of its kind along the run; MuJoCo's own model, against "
        "itself"
    )
    print(f"  {'':22s} {'below':>8s} {'steps':>8s} {'error':>9s} {'time, ms':>10s}")
    _table("softpinch, rk4", _rungs(ours, OUR_STEPS, 10**5, exact, sizes), levels)
    if "Siconos" not in absent:
        rungs = _rungs(siconos, THEIR_STEPS, 20_000, exact, sizes)
        _table("Siconos, Moreau-Jean", rungs, levels)
    if "MuJoCo" not in absent:
        exact, _, _ = mujoco(5_000 if quick else 2_000_000)
        sizes = [float(np.abs(part).max()) for part in exact]
        _table("MuJoCo", _rungs(mujoco, OUR_STEPS, 500_000, exact, sizes), levels)
