"""The compiled form of a disturbance: arrays for the core, of one run or of many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..support.arrays import Floats
from .piecewise import Piecewise, padded


class Compiled(NamedTuple):
    """A compiled disturbance. For many runs every array has the runs as its first axis.

    Attributes:
        forces: Piecewise polynomials of F_x and F_y, N, and moment, N m.
        sines: Arrays (7,): start and end, s; angular frequency, 1/s; phase, rad; amplitudes of F_x
            and F_y, N, and of the moment, N m.
        impulses: Arrays (4,): time, s; J_x and J_y, N s; J_theta, N m s.
        noises: (array (6,), seed, run) each. The array has the standard deviations of F_x and F_y,
            N, and of the moment, N m; the sample rate, Hz; start and end, s.
    """

    forces: tuple[Piecewise, ...] = ()
    sines: tuple[Floats, ...] = ()
    impulses: tuple[Floats, ...] = ()
    noises: tuple[tuple[Floats, int, int], ...] = ()


def stacked(runs: Sequence[Compiled], owner: str) -> Compiled:
    """Stacks the compiled disturbances of many runs along a new first axis.

    Args:
        runs: The same disturbance, compiled for each run.
        owner: The class of the disturbance, for error messages.

    Raises:
        ValueError: The runs differ in the number of forces, sines, impulses or noises.
    """
    counts = [tuple(map(len, run)) for run in runs]
    for k, count in enumerate(counts):
        if count != counts[0]:
            raise ValueError(
                f"run {k}: {owner}.compile gave {_counted(count)}, but "
                f"{_counted(counts[0])} in another run: must give equal numbers in all runs"
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
