"""The one description of a study: what `monte_carlo` is asked for, checked once.

Study files and manifests are read into it and written from it, `Study.resume` and `Study.extend`
make it again, and workers get its `setup`.
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
    """A scene, what differs in it from run to run, and how the runs are made.

    Who computes the runs and where their rows are kept is not part of it.

    Attributes:
        setup: What all runs have in common: scene, paths, seed, options, summaries.
        vary: Path, or paths that are drawn together -> array, distribution or function.
        runs: How many.
        sampler: How numbers are drawn.
        stop_when: What can happen -> half width of its interval at which runs are enough.
        check_dt: Whether some runs are computed again with smaller steps.
        trajectories: The runs whose paths are kept.
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
        """The arguments of `monte_carlo` that describe a study, checked.

        Args:
            scene: What all runs share.
            options: How each run is simulated.
            runs: As for `monte_carlo`, like all that follow.
            seed: Of the draws and of held noise.
            vary: What differs.
            summaries: What is computed along the way.
            summaries_after: From when on, s.
            settling_band: Of the settling time, m/s.
            sampler: How numbers are drawn.
            stop_when: Half widths.
            check_dt: Whether steps are checked.
            trajectories: Runs whose paths are kept.

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
            trajectories=_kept(trajectories, runs),
        )
        spec.plan  # noqa: B018, it checks the sampler and what is drawn
        return spec

    @cached_property
    def plan(self) -> Plan:
        """Where the numbers of the runs come from."""
        return Plan(self.vary, self.runs, self.setup.seed, self.sampler, shapes=self.setup.shapes)

    def to_dict(self) -> dict[str, Any]:
        """As plain data: the tables `study`, `vary` and `scene` of a study file.

        Arrays and functions in `vary` are named, not contained.
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


def _kept(trajectories: Sequence[int], runs: int) -> tuple[int, ...]:
    """The runs whose paths are kept."""
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
            "stop_when: only a whole Latin hypercube is a fair sample, none that stops early; take "
            'sampler="random" or "sobol"'
        )
    return {
        checked_event("stop_when", name, scene, varied): checks.positive(
            f"stop_when[{checks.shown(name)}]", width
        )
        for name, width in stop_when.items()
    }
