"""`StudySpec`, the checked description of a study.

All parts of the package use it: `monte_carlo` makes it from its arguments, study files and
manifests are converted to it and from it, `Study.resume` and `Study.extend` make it from the
manifest, and workers receive its `setup`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

from ..run.options import NUMERICS, Options
from ..scene.scene import Scene
from ..support import checks
from .rows import checked_event
from .sampling import Plan, count_runs
from .setup import Setup
from .sources import Key

# The names in the table `study` of `StudySpec.to_dict`.
SETTINGS = (
    "runs",
    "seed",
    "sampler",
    *NUMERICS,
    "summaries",
    "summaries_after",
    "settling_band",
    "stop_when",
    "check_dt",
    "trajectories",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class StudySpec:
    """The description of a study: a scene, the values that vary between runs, and all settings.

    The executor that computes the runs, and the storage of their rows, are not part of it.

    Attributes:
        setup: The part that all runs share: scene, varied paths, seed, options, summaries.
        vary: Path, or paths that are drawn together -> array, distribution or function.
        runs: The number of runs.
        sampler: How numbers are drawn.
        stop_when: Event -> half width of its interval below which no more runs are computed.
        check_dt: Whether some runs are computed again with smaller steps.
        trajectories: The runs whose trajectories are recorded.
    """

    setup: Setup
    vary: Mapping[Key, Any]
    runs: int
    sampler: str
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
        summaries_after: float | None = None,
        settling_band: float = 1e-3,
        sampler: str = "random",
        stop_when: Mapping[str, float] | None = None,
        check_dt: bool = False,
        trajectories: Sequence[int] = (),
    ) -> Self:
        """Checks the arguments of `monte_carlo` that describe a study.

        Args:
            scene: The scene that all runs share, apart from the varied values.
            options: The numerical options of every run.
            runs: As for `monte_carlo`, like all following arguments.
            seed: Seed of the draws and of held noise.
            vary: The varied paths, and the sources of their values.
            summaries: Names of the summaries to compute.
            summaries_after: Instant from which summaries are computed, s.
            settling_band: Speed below which the object counts as settled, m/s.
            sampler: How numbers are drawn.
            stop_when: Event -> half width.
            check_dt: Whether to estimate the error due to the steps.
            trajectories: Runs whose trajectories to record.

        Raises:
            ValueError: An argument breaks its rule.
            TypeError: An argument is of the wrong kind.
        """
        checks.instance("scene", scene, Scene)
        vary = {} if vary is None else vary
        if not isinstance(vary, Mapping):
            raise TypeError(
                f"vary = {checks.shown(vary)}: must map paths to arrays, distributions or functions"
            )
        runs = count_runs(vary, runs)
        setup = Setup.checked(
            scene,
            [path for key in vary for path in ((key,) if isinstance(key, str) else key)],
            seed,
            options,
            summaries=summaries,
            summaries_after=summaries_after,
            settling_band=settling_band,
        )
        spec = cls(
            setup=setup,
            vary=vary,
            runs=runs,
            sampler=sampler,
            stop_when=_stop_when(stop_when, sampler, scene, setup.shapes),
            check_dt=checks.boolean("check_dt", check_dt),
            trajectories=_trajectories(trajectories, runs),
        )
        spec.plan  # noqa: B018, it checks `vary` and the sampler
        return spec

    @cached_property
    def plan(self) -> Plan:
        """The draws of the varied values."""
        return Plan(self.vary, self.runs, self.setup.seed, self.sampler, shapes=self.setup.shapes)

    def to_dict(self) -> dict[str, Any]:
        """Converts to plain data: the tables `study`, `vary` and `scene` of a study file.

        For arrays it has only the shape, and for functions only the name.
        """
        settings = {
            "runs": self.runs,
            "sampler": self.sampler,
            **self.setup.to_dict(),
            "stop_when": dict(self.stop_when) or None,
            "check_dt": self.check_dt,
            "trajectories": sorted(self.trajectories) or None,
        }
        return {
            "study": {name: value for name, value in settings.items() if value is not None},
            "vary": self.plan.describe()["vary"],
            "scene": self.setup.scene.to_dict(),
        }


def _trajectories(trajectories: Sequence[int], runs: int) -> tuple[int, ...]:
    """Checks the numbers of the runs whose trajectories are recorded."""
    given = checks.several(
        "trajectories", trajectories, "the numbers of runs, such as (3, 17)", runs
    )
    return tuple(checks.integer("trajectories", run, 0, runs - 1) for run in given)


def _stop_when(
    stop_when: Mapping[str, float] | None, sampler: str, scene: Scene, varied: Iterable[str]
) -> dict[str, float]:
    if stop_when is None:
        return {}
    if not isinstance(stop_when, Mapping):
        raise TypeError(f"stop_when = {checks.shown(stop_when)}: must map statuses to half widths")
    if sampler == "latin_hypercube":
        raise ValueError(
            "stop_when: only a whole Latin hypercube is a fair sample, so a study that may stop "
            'early needs sampler="random" or "sobol"'
        )
    return {
        checked_event("stop_when", name, scene, varied): checks.positive(
            f"stop_when[{checks.shown(name)}]", width
        )
        for name, width in stop_when.items()
    }
