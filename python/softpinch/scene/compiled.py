"""What the core makes of disturbances, one run's or many runs'."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..support.arrays import Floats
from .schedule import Piecewise, padded


class Compiled(NamedTuple):
    """What the core makes of a disturbance; of many runs every array has an axis in front.

    Attributes:
        forces: Piecewise polynomials of F_x, F_y and moment.
        sines: (7,) each: start and end, s, angular frequency, 1/s, phase, rad, amplitudes of F_x,
            F_y, N, and moment, N m.
        impulses: (4,) each: time, s, J_x, J_y, N s, and J_theta, N m s.
        noises: (6,) each: standard deviations of F_x, F_y, N, and moment, N m, samples a second,
            start and end, s; with seed and run.
    """

    forces: tuple[Piecewise, ...] = ()
    sines: tuple[Floats, ...] = ()
    impulses: tuple[Floats, ...] = ()
    noises: tuple[tuple[Floats, int, int], ...] = ()


def stacked(runs: Sequence[Compiled], owner: str) -> Compiled:
    """What many runs compiled to, an axis in front of every array; `owner` is what errors call it.

    Raises:
        ValueError: It is not as many in all runs.
    """
    counts = [tuple(map(len, run)) for run in runs]
    for k, count in enumerate(counts):
        if count != counts[0]:
            raise ValueError(
                f"run {k}: {owner}.compile gave {_counted(count)}, and "
                f"{_counted(counts[0])} in another run: must be as many"
            )
    return Compiled(
        forces=tuple(map(padded, zip(*(run.forces for run in runs), strict=True))),
        sines=tuple(map(np.stack, zip(*(run.sines for run in runs), strict=True))),
        impulses=tuple(map(np.stack, zip(*(run.impulses for run in runs), strict=True))),
        noises=tuple(
            (np.stack([rows for rows, _, _ in same]), same[0][1], same[0][2])
            for same in zip(*(run.noises for run in runs), strict=True)
        ),
    )


def _counted(counts: tuple[int, ...]) -> str:
    return ", ".join(f"{n} {name}" for n, name in zip(counts, Compiled._fields, strict=True) if n)
