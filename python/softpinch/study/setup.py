"""What the runs of a study have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from .. import _core
from ..run.options import MOST_STEPS, Options, most_steps, names, steps
from ..run.run import Run
from ..run.simulate import simulate
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..scene.template import SceneTemplate
from ..support import checks
from ..support.arrays import Floats
from .rows import Rows
from .spans import Numbers

SUMMARIES = ("final_state", *_core.SUMMARIES)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A scene, what differs in it from run to run, and how it is simulated. It travels to workers.

    Attributes:
        scene: What all share.
        shapes: Path -> shape of what each run has of its own there.
        seed: Of the draws and of held noise.
        options: How each is simulated.
        summaries: What is computed along the way.
        after: From when on, s; minus infinity is from the start on.
        band: Of the settling time, m/s.
    """

    scene: Scene
    shapes: Mapping[str, tuple[int, ...]]
    seed: int
    options: Options
    summaries: tuple[str, ...]
    after: float
    band: float

    @property
    def refined(self) -> int:
        """How much smaller the steps or the tolerance are that `check_dt` compares with."""
        return 2 if self.options.tolerance is None else 10

    @cached_property
    def varied(self) -> SceneTemplate:
        """Where the values go."""
        return SceneTemplate(self.scene, self.shapes, self.seed)

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be made again: workers do."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def replay(
        self,
        run: int,
        values: Mapping[str, Any],
        record: Sequence[str] = _core.RECORDABLE,
        every: int = 1,
    ) -> Run:
        """One run again, to the same bits; `values` are its own."""
        scene = self.varied.at(values, run)
        return simulate(scene, **self.options.numerics(), record=record, every=every)

    def batch(self, numbers: Numbers, values: Mapping[str, Floats], refine: int = 1) -> _core.Batch:
        """Runs as the core takes them, with steps or tolerance smaller by `refine`.

        The limit to their steps grows as much: a smaller tolerance takes more of them, fewer than
        in proportion.
        """
        o = self.options
        return self.varied.batch(
            values,
            numbers,
            dt=None if o.dt is None else o.dt / refine,
            tolerance=None if o.tolerance is None else o.tolerance / refine,
            method=o.method,
            formulation=o.formulation,
            alpha=o.stabilization.alpha,
            beta=o.stabilization.beta,
            summaries=[name for name in self.summaries if name != "final_state"],
            after=self.after,
            band=self.band,
            stop_on=list(o.stop_on),
            max_steps=min(o.max_steps * refine, MOST_STEPS),
        )

    def empty(self) -> Rows:
        """No runs."""
        return Rows.empty(self.summaries, self.shapes)


def make_setup(
    scene: Scene,
    paths: Sequence[str],
    seed: int,
    *,
    dt: float | None,
    tolerance: float | None,
    method: str,
    formulation: str,
    stabilization: Stabilization,
    stop_on: str | Sequence[str],
    max_steps: int | None,
    summaries: str | Sequence[str],
    summaries_after: float | None,
    settling_band: float,
) -> Setup:
    """The arguments of `monte_carlo` that its runs have in common, checked."""
    seed = checks.integer("seed", seed, 0, 2**64 - 1)
    checks.instance("stabilization", stabilization, Stabilization)
    method = checks.choice("method", method, _core.METHODS)
    dt, tolerance = steps(dt, tolerance, method)
    after = summaries_after
    return Setup(
        scene=scene,
        shapes=SceneTemplate(scene, paths, seed).shapes,
        seed=seed,
        options=Options(
            dt=dt,
            tolerance=tolerance,
            method=method,
            formulation=checks.choice("formulation", formulation, _core.FORMULATIONS),
            stabilization=stabilization,
            record=(),
            every=1,
            stop_on=names("stop_on", stop_on, _core.STOPPABLE),
            max_steps=most_steps(tolerance, max_steps),
        ),
        summaries=names("summaries", summaries, SUMMARIES),
        after=-np.inf if after is None else checks.finite("summaries_after", after),
        band=checks.positive("settling_band", settling_band),
    )
