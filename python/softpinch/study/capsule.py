"""`Capsule`: one run of a study, with everything needed to replay it alone, also from a file.

    >>> lost = study.failures()[0]
    >>> Path("lost.toml").write_text(lost.to_toml())
    >>> Capsule.from_toml(Path("lost.toml")).replay().message == lost.message
    True

The shell command `softpinch run lost.toml` replays the run too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from .. import _core
from ..run import Request, Run
from ..run.options import ALWAYS, NUMERICS, Options
from ..scene import Scene, SceneTemplate
from ..scene.paths import at_path
from ..support import ByValue, Recordable, ShownTable, checks, plain, read_only, text_of, toml
from .estimates import number_or_array

_TABLES = ("capsule", "simulate", "scene")
_FACTS = ("run", "seed", "status", "time", "message", "softpinch", "results_version")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Capsule(ByValue):
    """A run of a study: its outcome, and the data to replay it alone. Its pickle is small.

    Capsules come from `Ensemble.failures`, `from_dict` and `from_toml`. Two capsules are equal if
    their runs, scenes and settings are equal, also if one was read from a file.

    Attributes:
        run: Number of the run in the study.
        status: Final status of the run; see `Run.status`.
        time: Time at which the run ended, s.
        message: The status in words, with numbers.
        parameters: Path -> varied value of this run, a number or an array.
        varied: The study's scene, and the paths whose values this run's scene takes from
            `parameters`.
        options: Numerical options of the run.
        version: Version of softpinch that computed the run.
        results_version: Results version of its core. A core with another one may give other bits.
    """

    run: int
    status: str
    time: float
    message: str
    parameters: Mapping[str, Any]
    varied: SceneTemplate
    options: Options
    version: str = _core.__version__
    results_version: int = _core.RESULTS_VERSION

    def __repr__(self) -> str:
        names = ("run", "status", "time", "message")
        return text_of("Capsule", {**{n: getattr(self, n) for n in names}, **self.parameters})

    def _tables(self) -> Iterator[ShownTable]:
        yield ShownTable(("path", "value"), tuple(self.parameters.items()))

    def __post_init__(self) -> None:
        for value in self.parameters.values():
            if isinstance(value, np.ndarray):
                read_only(value)

    @property
    def seed(self) -> int:
        """The seed of the study."""
        return self.varied.seed

    # The scene is made on access, because a study may have thousands of failures.
    @cached_property
    def scene(self) -> Scene:
        """The scene of this run with its varied values, for `simulate`."""
        values = {path: self.parameters[path] for path in self.varied.shapes}
        return self.varied.at(values, self.run)

    def replay(
        self, record: Recordable | Sequence[Recordable] = _core.RECORDABLE, every: int = 1
    ) -> Run:
        """Simulates the run again, with the same bits; the arguments are those of `simulate`."""
        options = Options.checked(**self.options.numerics(), record=record, every=every)
        return Run(self.scene, options, Request(self.scene, options).compute())

    def agrees(self, run: Run) -> bool:
        """Whether a replay has the status and the last instant of the study's run."""
        checks.instance("run", run, Run)
        return run.status == self.status and run.t[-1:].tolist() == [self.time]

    def to_dict(self) -> dict[str, Any]:
        """Converts to plain data: `capsule`, `simulate`, and the full `scene` of this run."""
        return {
            "capsule": {
                "run": self.run,
                "seed": self.seed,
                "status": self.status,
                "time": self.time,
                "message": self.message,
                "softpinch": self.version,
                "results_version": self.results_version,
                "parameters": {path: plain(v) for path, v in self.parameters.items()},
            },
            "simulate": self.options.to_dict(),
            "scene": self.scene.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Makes a capsule from the result of `to_dict`; refuses parameters unlike the scene's."""
        checks.refuse_unknown("Capsule", data, _TABLES, "", needed=_TABLES)
        facts, how = data["capsule"], data["simulate"]
        known = (*_FACTS, "parameters")
        checks.refuse_unknown("Capsule", facts, known, "capsule", needed=_FACTS)
        checks.refuse_unknown("Capsule", how, NUMERICS, "simulate", needed=ALWAYS)
        for name in ("message", "softpinch"):
            checks.instance(f"Capsule.{name}", facts[name], str, "text")
        scene = Scene._parse(data["scene"], "scene")
        if "dt" not in how and "tolerance" not in how:
            raise ValueError("Capsule.dt (in simulate): is missing; give it or tolerance")
        with checks.reworded(after=" (in simulate)"):
            options = Options.from_dict(how)
        run = checks.integer("Capsule.run", facts["run"], 0, 2**64 - 1)
        seed = checks.integer("Capsule.seed", facts["seed"], 0, 2**64 - 1)
        capsule = cls(
            run=run,
            status=checks.choice("Capsule.status", facts["status"], _core.STATUSES),
            time=checks.finite("Capsule.time", facts["time"]),
            message=facts["message"],
            parameters=_parameters(facts.get("parameters", {}), scene),
            # This scene already has the varied values, so no path remains.
            varied=SceneTemplate(scene, (), seed),
            options=options,
            version=facts["softpinch"],
            results_version=checks.integer("Capsule.results_version", facts["results_version"], 0),
        )
        if capsule.scene != scene:
            rule = f"must have the seed = {seed} and run = {run} of the capsule"
            raise ValueError(f"Scene.disturbances (in scene): a noise {rule}")
        return capsule

    def to_toml(self) -> str:
        """Converts to TOML for `softpinch run`, with exact numbers. Needs the extra `cli`."""
        return toml.dumps(self.to_dict(), "capsule, one run of a study")

    @classmethod
    def from_toml(cls, source: str | Path) -> Self:
        """Makes a capsule from the text of `to_toml`, or from the file at a `Path`.

        A capsule with another `results_version` than this core's is not an error.

        Raises:
            ValueError: The text is not TOML or not a capsule. The message has file, field, value
                and rule.
            OSError: The file cannot be read.
        """
        data = toml.read(source)
        name = f"{source}: " if isinstance(source, Path) else ""
        with checks.reworded(name, kind=ValueError):
            return cls.from_dict(data)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Capsule):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash((self.run, self.seed, self.status, self.time))


def _parameters(data: Any, scene: Scene) -> dict[str, Any]:
    """The varied values of the run; one that differs from its place in the scene is refused."""
    checks.instance("Capsule.parameters", data, Mapping, "a table from paths to numbers")
    result: dict[str, Any] = {}
    for path, value in data.items():
        where = f"Capsule.parameters[{path!r}]"
        with checks.reworded(f"{where}: ", drop="vary: "):
            there = at_path(scene, path)
        for one in there:
            if plain(one) != plain(value):
                raise ValueError(f"{where} = {value}: must equal the scene's value, {plain(one)}")
        result[path] = number_or_array(there[0])
    return result
