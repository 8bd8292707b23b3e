"""The runs behind the paper's figures and the verdicts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .. import paper
from ..run import Options, Request, Run, computed
from ..run.simulate import warn_of_steps
from ..scene import Fingertip, Hand, Impulse, Pulse, Scene, Schedule
from ..support import checks
from .energy_minimum import Rest, rests

# Called with a description of the current work, and the completed share of all work (0 to 1).
Progress = Callable[[str, float], None]

_EVERYTHING = ("state", "multipliers", "residuals", "energy")
# Coefficients of friction of the runs with unilateral contact.
FRICTIONS = (0.3, 0.5, 0.8, 1.0)
# Height of the object's faces in these runs, m: its default inertia is that of such a block.
HEIGHT = 0.049
# Moments for the step (40), N m: the paper's, none, and the opposite of the paper's.
_MOMENTS = (5.0, 0.0, -5.0)


def quietly(what: str, share: float) -> None:
    """A progress function that does nothing."""


@dataclass(frozen=True, kw_only=True)
class Runs:
    """All runs behind the figures and the verdicts, recorded at every step."""

    operations: Run  # the eight operations of VI-A
    coarse: Run  # the eight operations with twice the step
    direct: Run  # the last operation's angles as the only target, from the start
    cases: Mapping[str, Run]  # case of Fig. 7 -> its run
    held: Mapping[str, Run]  # case -> its run without the disturbance
    moments: Mapping[float, Run]  # moment in N m -> case (i) with this moment
    ideal: Run  # case (ii) with its amplitudes read as an ideal impulse in N s and N m s
    other_operations: Run  # the eight operations with kappa = -1
    other_cases: Mapping[str, Run]  # case -> its run with kappa = -1
    real: Mapping[float, Run]  # friction -> the eight operations with unilateral contact
    real_cases: Mapping[str, Mapping[float, Run]]  # case -> friction -> its run with that contact

    @cached_property
    def rests(self) -> list[Rest]:
        """The rests after all operations that the run has reached."""
        return rests(self.operations)


def simulate_all(dt: float, progress: Progress = quietly) -> Runs:
    """Simulates all scenes with the longest step dt, s; calls `progress` before each of them."""
    dt = checks.positive("dt", dt)
    checks.function("progress", progress)
    # The simulations are this share of the progress, the figures the rest.
    share, done, count = 0.4, 0, 6 + 3 * len(paper.CASES) + len(_MOMENTS)
    count += (1 + len(paper.CASES)) * len(FRICTIONS)
    bare = ("state",)

    def run(scene: Scene, what: str, record: Sequence[str] = _EVERYTHING, long: float = 1.0) -> Run:
        nonlocal done
        progress(f"simulating {what}", share * done / count)
        request = Request(scene, Options.checked(dt=long * dt, record=record))
        result = computed(request)
        warn_of_steps(request, result._result)
        done += 1
        return result

    def all_cases(what: str, record: Sequence[str] = _EVERYTHING, **changes: Any) -> dict[str, Run]:
        scenes = {case: paper.disturbance(case, **changes) for case in paper.CASES}
        return {case: run(scene, f"({case}){what}", record) for case, scene in scenes.items()}

    def frictions(scene: Scene, what: str) -> dict[float, Run]:
        return {mu: run(_real(scene, mu), f"{what}, mu = {mu:g}", bare) for mu in FRICTIONS}

    operations, step = paper.manipulation(), paper.disturbance("i")
    other = Hand(tip=Fingertip(tilt_coupling=-1.0))
    last = Schedule.steps([0.0], np.deg2rad(paper.OPERATIONS[-1:]))
    (pulse,) = paper.disturbance("ii").disturbances
    assert isinstance(pulse, Pulse)
    blow = Impulse(time=pulse.time, impulse=pulse.force, angular_impulse=pulse.moment)
    ideal = paper.disturbance("ii", disturbances=(blow,))
    moments = {moment: step.with_({"disturbances.0.moment": moment}) for moment in _MOMENTS}
    return Runs(
        operations=run(operations, "the eight operations"),
        coarse=run(operations, "the operations with twice the step", long=2.0),
        direct=run(Scene(schedule=last, duration=paper.OPERATION_TIME), "the last operation alone"),
        cases=all_cases(""),
        held=all_cases(" undisturbed", bare, disturbances=()),
        moments={k: run(scene, f"(i) with {k:g} N m", bare) for k, scene in moments.items()},
        ideal=run(ideal, "(ii) as an ideal impulse", bare),
        other_operations=run(paper.manipulation(hand=other), "the operations with kappa = -1"),
        other_cases=all_cases(" with kappa = -1", hand=other),
        real=frictions(operations, "the operations"),
        real_cases={case: frictions(paper.disturbance(case), f"({case})") for case in paper.CASES},
    )


def _real(scene: Scene, mu: float) -> Scene:
    """The scene with tips that only push, slip where friction mu allows it, and open."""
    faces = replace(scene.grasped, height=HEIGHT)
    return replace(scene, grasped=faces, contact="unilateral", friction=mu)
