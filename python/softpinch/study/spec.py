"""`StudySpec`, the checked description of a study.

All parts of the package use it: `monte_carlo` makes it from its arguments, study files and
manifests are converted to it and from it, and workers and results have it without the sources.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Self

from .. import _core
from ..run.options import MOST_STEPS, NUMERICS, Options, names
from ..scene import Scene, SceneTemplate, jaws, shapes_of
from ..support import Floats, checks, plain
from .rows import Numbers, Rows, Schema, checked_event
from .sampling import Draws
from .sources import Key

SUMMARIES = ("final_state", *_core.SUMMARIES)
# Which rows of trajectories are kept, and which quantities.
RECORDING = ("record", "every", "times")
# The names in the table `study` of `StudySpec.to_dict`; of which these are arguments of `Options`.
RUN_OPTIONS = (*NUMERICS, "summaries_after")
SETTINGS = (
    *("runs", "seed", "sampler", *RUN_OPTIONS, *RECORDING, "summaries", "settling_band"),
    *("stop_when", "check_dt", "trajectories"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class StudySpec:
    """A study without its executor and its storage; `monte_carlo` explains the fields."""

    scene: Scene
    draws: Draws
    options: Options  # of every run; `RECORDING` is that of the trajectories
    summaries: tuple[str, ...]
    band: float  # `settling_band`, m/s
    stop_when: Mapping[str, float]
    check_dt: bool
    trajectories: tuple[int, ...]

    @classmethod
    def checked(
        cls,
        scene: Scene,
        options: Options,
        *,
        runs: int | None = None,
        seed: int = 0,
        vary: Mapping[Key, Any] | None = None,
        summaries: str | Sequence[str] = ("final_state",),
        settling_band: float = 1e-3,
        sampler: str = "random",
        stop_when: Mapping[str, float] | None = None,
        check_dt: bool = False,
        trajectories: Sequence[int] = (),
    ) -> Self:
        """Checks the arguments of `monte_carlo` that describe a study; errors are those there."""
        checks.instance("scene", scene, Scene)
        vary = {} if vary is None else vary
        seed = checks.integer("seed", seed, 0, 2**64 - 1)
        draws = Draws(vary, runs, seed, sampler, shapes=lambda paths: shapes_of(scene, paths))
        if stop_when is not None and not isinstance(stop_when, Mapping):
            shown = checks.shown(stop_when)
            raise TypeError(f"stop_when = {shown}: must map statuses to half widths")
        if stop_when is not None and sampler == "latin_hypercube":
            rule = 'so a study that may stop early needs sampler="random" or "sobol"'
            raise ValueError(f"stop_when: only a whole Latin hypercube is a fair sample, {rule}")
        half_widths = {}
        for name, width in (stop_when or {}).items():
            event = checked_event("stop_when", name, scene, draws.shapes)
            half_widths[event] = checks.positive(f"stop_when[{checks.shown(name)}]", width)
        spec = cls(
            scene=scene,
            draws=draws,
            options=options,
            summaries=names("summaries", summaries, SUMMARIES),
            band=checks.positive("settling_band", settling_band),
            stop_when=half_widths,
            check_dt=checks.boolean("check_dt", check_dt),
            trajectories=tuple(
                checks.integer("trajectories", run, 0, draws.runs - 1)
                for run in checks.several("trajectories", trajectories, "numbers such as (3, 17)")
            ),
        )
        # A caller without trajectories leaves `record` empty.
        if options.record and spec._recorded() and not spec.trajectories:
            given = " and ".join(spec._recorded())
            raise ValueError(f"{given}: for the runs in trajectories, and there are none")
        return spec

    @property
    def shapes(self) -> Mapping[str, tuple[int, ...]]:
        """Path -> shape of the varied value of one run."""
        return self.draws.shapes

    def finer(self) -> Self:
        """The study with half the steps or a tenth of the tolerance, and room for more steps."""
        dt, tolerance = self.options.dt, self.options.tolerance
        factor = 2 if tolerance is None else 10
        options = replace(
            self.options,
            dt=None if dt is None else dt / factor,
            tolerance=None if tolerance is None else tolerance / factor,
            max_steps=min(self.options.max_steps * factor, MOST_STEPS),
        )
        return replace(self, options=options)

    @cached_property
    def varied(self) -> SceneTemplate:
        """The template that takes the varied values."""
        return SceneTemplate(self.scene, self.shapes, self.draws.seed)

    @cached_property
    def schema(self) -> Schema:
        """The columns of the study's results."""
        return Schema(self.summaries, self.shapes, self.scene.law, jaws(self.scene))

    def described(self) -> Self:
        """The description for workers and results, which have the values and draw none."""
        return replace(self, draws=self.draws.described())

    def __getstate__(self) -> dict[str, Any]:
        # Without the cached properties, which workers compute again.
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def to_dict(self) -> dict[str, Any]:
        """Converts to plain data: the tables `study`, `vary` and `scene` of a study file."""
        settings = {
            "runs": self.draws.runs,
            "sampler": self.draws.sampler,
            "seed": self.draws.seed,
            **self.options.to_dict(),
            "summaries": list(self.summaries),
            "summaries_after": self.options.summaries_after,
            "settling_band": self.band,
            "stop_when": dict(self.stop_when) or None,
            "check_dt": self.check_dt,
            "trajectories": sorted(self.trajectories) or None,
            **(self._recorded() if self.trajectories else {}),
        }
        return {
            "study": {name: value for name, value in settings.items() if value is not None},
            "vary": self.draws.describe()["vary"],
            "scene": self.scene.to_dict(),
        }

    def _recorded(self) -> dict[str, Any]:
        """The settings in `RECORDING` that are not the default, as plain data."""
        given = {name: plain(getattr(self.options, name)) for name in RECORDING}
        default = {"record": list(_core.RECORDABLE), "every": 1, "times": None}
        return {name: value for name, value in given.items() if value != default[name]}

    def block(self, numbers: Numbers) -> Rows:
        """Draws the varied values of some runs, increasing."""
        return Rows(columns={"run": numbers, **self.draws.rows(numbers)})

    def values(self, rows: Rows) -> dict[str, Floats]:
        """The varied values of some rows: path -> (k, ...)."""
        return {path: rows.columns[path] for path in self.shapes}

    def batch(self, block: Rows) -> _core.Batch:
        """The core's batch of the runs of a block, which has their varied values."""
        return self.varied.batch(
            self.values(block),
            block.run,
            summaries=[name for name in self.summaries if name != "final_state"],
            band=self.band,
            options=self.options.core,
        )

    def empty(self) -> Rows:
        """Rows without runs."""
        columns = self.schema.empty()
        del columns["failure_time"]  # computed from the other columns
        return Rows(columns=columns)
