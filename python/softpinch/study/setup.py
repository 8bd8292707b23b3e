"""The part of a study that all its runs share."""

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
from ..support.choices import Recordable
from .columns import Schema
from .rows import Rows
from .spans import Numbers

SUMMARIES = ("final_state", *_core.SUMMARIES)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A scene, the paths that vary in it, and how the runs are simulated. It is sent to workers.

    Attributes:
        scene: The scene that all runs share, apart from the varied values.
        shapes: Path -> shape of the varied value of one run.
        seed: Seed of the draws and of held noise.
        options: Numerical options of every run.
        summaries: Names of the summaries to compute.
        after: Instant from which summaries are computed, s; minus infinity is the start.
        band: Speed of the faces below which the object counts as settled, m/s.
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
        """Checks some arguments of `monte_carlo`; `paths` are the keys of `vary`.

        Raises:
            ValueError: An argument breaks its rule, or a path does not exist.
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
        """Plain data with the names of `monte_carlo`'s arguments, without scene and paths."""
        return {
            "seed": self.seed,
            **self.options.to_dict(),
            "summaries": list(self.summaries),
            "summaries_after": self.after if np.isfinite(self.after) else None,
            "settling_band": self.band,
        }

    @property
    def refined(self) -> int:
        """Factor by which `check_dt` reduces the steps or the tolerance."""
        return 2 if self.options.tolerance is None else 10

    @cached_property
    def varied(self) -> SceneTemplate:
        """The template that takes the varied values."""
        return SceneTemplate(self.scene, self.shapes, self.seed)

    @cached_property
    def schema(self) -> Schema:
        """The columns of the study's results."""
        return Schema(self.summaries, self.shapes, self.scene.law)

    def __getstate__(self) -> dict[str, Any]:
        """The fields only: workers compute the cached properties again."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def replay(
        self,
        run: int,
        values: Mapping[str, Any],
        record: Sequence[Recordable] = _core.RECORDABLE,
        every: int = 1,
    ) -> Run:
        """Simulates one run again, with the same bits; `values` are its varied values."""
        scene = self.varied.at(values, run)
        after = self.after if np.isfinite(self.after) else None
        return simulate(
            scene,
            **self.options.numerics(),
            record=record,
            every=every,
            summaries_after=after,
        )

    def batch(self, numbers: Numbers, values: Mapping[str, Floats], refine: int = 1) -> _core.Batch:
        """The core's batch of some runs, with steps or tolerance smaller by the factor `refine`.

        The largest number of steps grows by this factor, which is enough for a smaller tolerance.
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
        """Rows without runs."""
        columns = self.schema.empty()
        del columns["failure_time"]  # computed from the other columns
        return Rows(columns=columns)
