"""What the runs of a study have in common."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self

import numpy as np

from .. import _core
from ..run.options import MOST_STEPS, Options, names
from ..run.run import Run
from ..run.simulate import simulate
from ..scene.scene import Scene
from ..scene.template import SceneTemplate
from ..support import checks
from ..support.arrays import Floats
from .columns import Schema
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

    @classmethod
    def checked(
        cls,
        scene: Scene,
        paths: Iterable[str],
        seed: int,
        options: Options,
        *,
        summaries: str | Sequence[str],
        summaries_after: float | None,
        settling_band: float,
    ) -> Self:
        """Some arguments of `monte_carlo`, checked; `paths` are those in `vary`.

        Raises:
            ValueError: An argument breaks its rule; a path leads nowhere.
            TypeError: An argument is of the wrong kind.
        """
        seed = checks.integer("seed", seed, 0, 2**64 - 1)
        after = summaries_after
        return cls(
            scene=scene,
            shapes=SceneTemplate(scene, paths, seed).shapes,
            seed=seed,
            options=options,
            summaries=names("summaries", summaries, SUMMARIES),
            after=-np.inf if after is None else checks.finite("summaries_after", after),
            band=checks.positive("settling_band", settling_band),
        )

    def to_dict(self) -> dict[str, Any]:
        """As plain data, with the names of `monte_carlo`'s arguments; without scene and paths."""
        return {
            "seed": self.seed,
            **self.options.to_dict(),
            "summaries": list(self.summaries),
            "summaries_after": self.after if np.isfinite(self.after) else None,
            "settling_band": self.band,
        }

    @property
    def refined(self) -> int:
        """How much smaller the steps or the tolerance are that `check_dt` compares with."""
        return 2 if self.options.tolerance is None else 10

    @cached_property
    def varied(self) -> SceneTemplate:
        """Where the values go."""
        return SceneTemplate(self.scene, self.shapes, self.seed)

    @cached_property
    def schema(self) -> Schema:
        """The entries of the study's results."""
        return Schema(self.summaries, self.shapes)

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
        after = self.after if np.isfinite(self.after) else None
        return simulate(
            scene, **self.options.numerics(), record=record, every=every, summaries_after=after
        )

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
        columns = self.schema.empty()
        del columns["failure_time"]  # follows from the others
        return Rows(columns=columns)
