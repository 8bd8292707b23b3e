"""The derivatives of the summaries of many runs by numbers of their scenes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from .. import _core
from ..run.options import names
from ..scene.directions import directions, listed, move_inputs, require_derivatives, shapes
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats, read_only
from .rows import Rows
from .setup import Setup

GRADIENTS = ("final_state", *_core.GRADIENTS)
_STATE = 18
# Runs that are computed in one call, between which there is time for Ctrl-C in a slow one.
_BLOCK = 1024


@dataclass(frozen=True)
class GradientRequest:
    """The arguments `gradients` and `sensitivities` of `monte_carlo`, checked.

    Attributes:
        summaries: The summaries to differentiate, in the order of `GRADIENTS`.
        shapes: Path -> the shape of the value there.
    """

    summaries: tuple[str, ...]
    shapes: Mapping[str, tuple[int, ...]]

    @classmethod
    def checked(
        cls,
        scene: Scene,
        gradients: str | Sequence[str],
        sensitivities: str | Sequence[str],
        varied: Iterable[str],
        **others: object,
    ) -> Self | None:
        """Checks the arguments; None if no gradients are wanted.

        Args:
            scene: The scene that all runs share.
            gradients: The summaries to differentiate.
            sensitivities: Paths; if empty, `varied`.
            varied: The paths that differ between runs.
            others: Name -> value of arguments with which there are no gradients, unless None.

        Raises:
            ValueError: A name is unknown or has no derivative, there is no path or a wrong one, the
                scene has no derivatives, or one of `others` is given.
            TypeError: An argument is of the wrong kind.
        """
        summaries = names("gradients", gradients, GRADIENTS)
        paths = listed(sensitivities)
        if not summaries:
            if paths:
                raise ValueError(
                    "sensitivities: goes with gradients, the summaries to differentiate"
                )
            return None
        for name, value in others.items():
            if value is not None:
                raise ValueError(
                    f"gradients and {name}: give one of them; gradients are computed on threads of "
                    "this process and kept in memory"
                )
        require_derivatives(scene)
        paths = paths or list(varied)
        if not paths:
            raise ValueError(
                "gradients: give sensitivities, the paths to differentiate by, or vary"
            )
        return cls(summaries, shapes(scene, paths))

    def compute(self, setup: Setup, rows: Rows, threads: int) -> Gradients:
        """Computes the gradients of all runs with these rows, which have their varied values.

        Raises:
            KeyboardInterrupt: Ctrl-C.
            ValueError: A run's number has no derivative.
        """
        wanted = [name for name in self.summaries if name != "final_state"]
        # Directions of the inputs depend on each run's own inputs.
        block = 1 if move_inputs(list(self.shapes)) else _BLOCK
        shared = directions(setup.scene, list(self.shapes)) if block > 1 else None
        parts = []
        for first in range(0, len(rows), block):
            some = slice(first, first + block)
            columns = {name: column[some] for name, column in rows.columns.items()}
            values = {path: columns[path] for path in setup.shapes}
            own = shared
            if own is None:
                one = {path: value[0] for path, value in values.items()}
                scene = setup.varied.at(one, int(columns["run"][0]))
                own = directions(scene, list(self.shapes))
            batch = setup.batch(columns["run"], values, summaries=wanted)
            until = np.ascontiguousarray(columns["end_time"])
            parts.append(_core.gradients(batch, own, until, wanted, threads))
        widths = [_STATE, *[1] * len(wanted)]
        count = sum(int(np.prod(shape, dtype=int)) for shape in self.shapes.values())
        whole = np.concatenate(parts) if parts else np.zeros((0, count, sum(widths)))
        return Gradients(self, whole)


class Gradients(Mapping[str, Mapping[str, Floats]]):
    """The derivatives of summaries: `gradients[summary][path]`, (runs, ...), a row for each run.

    The last axes are those of the value at the path; "final_state" has 18 columns before them, q
    and p. They are the derivatives of the numbers that the runs computed, as in `Sensitivity`, at
    the instant of each run's own peak or end. A run that ended early has those at its end. NaN
    marks a summary that is not finite or saw no instant.
    """

    def __init__(self, request: GradientRequest, whole: Floats) -> None:
        """Takes the numbers (runs, directions, 18 + summaries); users get them from ensembles."""
        self._request = request
        self._whole = read_only(whole)

    def __getitem__(self, summary: str) -> dict[str, Floats]:
        """Returns path -> the derivatives of a summary.

        Raises:
            KeyError: The summary was not asked for.
        """
        asked = self._request.summaries
        if summary not in asked:
            raise KeyError(f"{summary!r}: there are gradients of {checks.quoted(asked)}")
        others = [name for name in asked if name != "final_state"]
        columns = slice(0, _STATE) if summary == "final_state" else _STATE + others.index(summary)
        own = self._whole[:, :, columns]
        found, first = {}, 0
        for path, shape in self._request.shapes.items():
            last = first + int(np.prod(shape, dtype=int))
            part = np.moveaxis(own[:, first:last], 1, -1)
            found[path] = part.reshape(*part.shape[:-1], *shape)
            first = last
        return found

    def __iter__(self) -> Any:
        """Iterates over the summaries."""
        return iter(self._request.summaries)

    def __len__(self) -> int:
        """Returns the number of summaries."""
        return len(self._request.summaries)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles through the constructor, because an unpickled array would be writable."""
        return Gradients, (self._request, self._whole)

    def __repr__(self) -> str:
        """Shows the summaries, the paths and the number of runs."""
        request = self._request
        return (
            f"<Gradients of {', '.join(request.summaries)} by {', '.join(request.shapes)}: "
            f"{len(self._whole)} runs>"
        )
