"""The measured ensembles: many runs of one scene, and references of a few of them.

`grasp()` is 0.2 s from point contact to 6 degrees under a constant push, `manipulation()` the
paper's 8 s with its eight switches. Peers get them as arrays with the runs last: states (14, runs)
and parameters (40, runs), null_space's `NAMES`; and as segments of constant targets.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import null_space
import softpinch as sp
from null_space import Floats
from softpinch import reference

SEED = 4
MODULUS, FORCE, MOMENT = "hand.tip.youngs_modulus", "disturbances.0.force", "disturbances.0.moment"


@dataclass(frozen=True, eq=False)
class Work:
    """Runs of a scene, each with its own drawn values.

    Attributes:
        name: For the report.
        scene: What does not vary.
        vary: For `sp.monte_carlo`: dotted path -> an array with one entry a run.
        probes: Which runs have a reference.
    """

    name: str
    scene: sp.Scene
    vary: dict[str, Floats]
    probes: Sequence[int]

    @property
    def runs(self) -> int:
        return len(self.vary[MODULUS])

    @property
    def segments(self) -> list[tuple[float, tuple[float, float]]]:
        """Duration and the two target angles, switch by switch."""
        schedule = self.scene.schedule
        lengths = np.diff([*schedule.times, self.scene.duration])
        return [(float(h), (a, b)) for h, (a, b) in zip(lengths, schedule.angles, strict=True)]

    @property
    def states(self) -> Floats:
        """The peers' start, (14, runs)."""
        return np.repeat(null_space.start(self.scene)[:, None], self.runs, axis=1)

    @property
    def parameters(self) -> Floats:
        """The peers' parameters, (40, runs), with the first segment's targets."""
        table = np.repeat(null_space.parameters(self.scene)[:, None], self.runs, axis=1)
        for side in ("right", "left"):
            row = null_space.NAMES.index(f"hand.tip.{side}.youngs_modulus")
            table[row] = self.vary[MODULUS]
        if FORCE in self.vary:
            table[-3:-1], table[-1] = self.vary[FORCE].T, self.vary[MOMENT]
        return table

    def only(self, runs: Sequence[int]) -> "Work":
        """The same of some runs, all of them probes if all of those were."""
        chosen = list(runs)
        probes = [k for k, run in enumerate(chosen) if run in set(self.probes)]
        vary = {path: values[chosen] for path, values in self.vary.items()}
        return replace(self, vary=vary, probes=probes)

    def scene_of(self, run: int) -> sp.Scene:
        """One run's own scene, put together without the code that is measured."""
        hand = self.scene.hand
        tip = replace(hand.tip, youngs_modulus=float(self.vary[MODULUS][run]))  # type: ignore[type-var]
        scene = replace(self.scene, hand=replace(hand, tip=tip))
        if FORCE in self.vary:
            push = replace(
                scene.disturbances[0],
                force=self.vary[FORCE][run],
                moment=float(self.vary[MOMENT][run]),
            )
            scene = replace(scene, disturbances=(push,))
        return scene

    @cached_property
    def truth(self) -> "Truth":
        return Truth(self)

    def spread(self, states: Floats) -> Floats:
        """(runs, 18), q then p, from a peer's (14, runs)."""
        c = self.parameters
        rows = [np.concatenate(null_space.spread(y, k)) for y, k in zip(states.T, c.T, strict=True)]
        return np.array(rows)


class Truth:
    """Ends of the probes and the largest size of each component, by softpinch.reference."""

    def __init__(self, work: Work) -> None:
        ends, sizes = [], []
        for run in work.probes:
            known = reference.solve(work.scene_of(run), [work.scene.duration])
            ends.append(np.concatenate([known.q[-1], known.p[-1]]))
            sizes.append(np.concatenate([known.scales["q"], known.scales["p"]]))
        self.ends, self.scales, self.method = np.array(ends), np.array(sizes), known.method

    def error(self, ends: Floats) -> float:
        """Error of q and p at the end (probes, 18), each against its largest size along the run.

        The worst of the probes; inf where something is not finite.
        """
        worst = float((np.abs(ends - self.ends) / self.scales).max())
        return worst if np.isfinite(worst) else np.inf


def grasp(runs: int = 2048, probes: int = 24, duration: float = 0.2) -> Work:
    """From point contact to 6 degrees: E from 0.2 to 0.4 MPa, a push of up to 5 N and 0.05 N m."""
    draw = np.random.default_rng(SEED)
    vary = {
        MODULUS: draw.uniform(0.2e6, 0.4e6, runs),
        FORCE: draw.uniform(-5.0, 5.0, (runs, 2)),
        MOMENT: draw.uniform(-0.05, 0.05, runs),
    }
    finger = sp.Finger(inertia=2e-4)
    tip = sp.Fingertip(normal_viscosity=20, tangential_viscosity=20, youngs_modulus=0.3e6)
    scene = sp.Scene(
        hand=sp.Hand(right=finger, left=finger, tip=tip),
        control=sp.Pid(kp=50, kd=0.5, ki=500),
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 6]])),
        # From the start on, so constant over the run.
        disturbances=(sp.Step(time=0.0, force=(0.0, 0.0), moment=0.0),),
        duration=duration,
    )
    name = f"{duration:g} s from point contact to 6 degrees, pushed"
    return Work(name, scene, vary, _spaced(runs, probes))


def manipulation(runs: int = 64, probes: int = 8) -> Work:
    """The paper's eight operations, E from 0.2 to 0.4 MPa."""
    vary: dict[str, Any] = {MODULUS: np.random.default_rng(SEED).uniform(0.2e6, 0.4e6, runs)}
    name = "the paper's manipulation, 8 s, eight switches"
    return Work(name, sp.paper.manipulation(), vary, _spaced(runs, probes))


def _spaced(runs: int, probes: int) -> list[int]:
    return [k * runs // probes for k in range(probes)]
