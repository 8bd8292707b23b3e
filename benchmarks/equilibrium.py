"""Time of an equilibrium and of a linear model from Python, beside SciPy's `root` on `sp.evaluate`.

make bench-equilibrium
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

import softpinch as sp
from command import parser
from document import put
from machine import clock, describe
from softpinch.analysis.states import OUTPUTS

Floats = NDArray[np.float64]
# The targets, us.
REST, LINEAR = 200.0, 100.0
# Sizes of the pose and of the shears, and of forces, moment and grip.
UNITS = np.array([1e-2, 1e-2, 1.0, 1e-2, 1e-2])
ROWS = np.array([10.0, 10.0, 0.1, 1e-2, 1e-2])
# The start's distance from rest, in these sizes.
AWAY = 0.05


def grasp() -> sp.Scene:
    """Two fingers at different angles, which turn the object."""
    return sp.Scene(schedule=sp.Schedule.steps([0.0], np.radians([[9.0, 3.0]])))


def by_scipy(scene: sp.Scene, rest: sp.Equilibrium) -> Callable[[], object]:
    """SciPy's `root` for the balance of forces and the grip, from a start beside the solution."""
    assert rest.state is not None
    angles, radius = rest.state.q[3:5], sp.Fingertip().radius

    def left_over(z: Floats) -> Floats:
        x, y, theta, *shear = z * UNITS
        state = sp.State.consistent(scene, x=x, y=y, rotation=theta, fingers=angles, shear=shear)
        terms = sp.evaluate(scene, 0.0, state.q, state.p, formulation="nullspace")
        forces, phi = terms.forces.total, terms.constraint_matrix
        tilt = angles + np.array([-theta, theta])
        grip = phi[:2, 2] * [-1.0, 1.0] + (radius - state.q[5:7]) * tilt + state.q[7:]
        return np.concatenate([forces[:3] - phi[:, :3].T @ forces[5:], grip]) / ROWS

    start = rest.state.q[[0, 1, 2, 7, 8]] / UNITS + AWAY

    def work() -> object:
        found = root(left_over, start, tol=1e-12)
        if np.abs(found.x * UNITS - rest.state.q[[0, 1, 2, 7, 8]]).max() > 1e-9:
            raise RuntimeError("SciPy found another state")
        return found

    return work


def works() -> list[tuple[str, Callable[[], object], float | None]]:
    """Name, work and target of each row; the ratios refer to the first."""
    scene = grasp()
    rest = sp.equilibrium(scene)
    assert rest.state is not None
    here = partial(sp.linearize, scene, rest.state)
    everything = partial(here, inputs=("targets", "force"), outputs=OUTPUTS)
    directions = np.column_stack([np.cos(a := np.linspace(0, 6, 72)), np.sin(a), np.zeros(72)])
    return [
        ("`sp.equilibrium(scene)`", partial(sp.equilibrium, scene), REST),
        (
            "`sp.equilibrium(scene, near=state)`",
            partial(sp.equilibrium, scene, near=rest.state),
            None,
        ),
        ("SciPy's `root` on `sp.evaluate`", by_scipy(scene, rest), None),
        ("`sp.linearize(scene, state)`", here, LINEAR),
        ("the same with forces as inputs too, and all outputs", everything, None),
        ("`sp.linearize(scene)`, with its equilibrium", partial(sp.linearize, scene), None),
        (
            "`sp.wrench_limits(rest, ...)` in 72 directions",
            partial(sp.wrench_limits, rest, directions),
            None,
        ),
    ]


def main() -> None:
    quick = parser(__doc__).parse_args().quick
    machine = describe(libraries=["scipy"])
    print(f"{machine}\n\nus: median, quartiles, and the median of the ratios to the first row\n")
    rows = works()
    times = clock([work for _, work, _ in rows], 3 if quick else 101, 1.0 if quick else 30.0)
    lines = ["| | us | quartiles | ratio | target |", "|---|---|---|---|---|"]
    for (name, _, target), own in zip(rows, times, strict=True):
        low, middle, high = 1e6 * np.quantile(own, [0.25, 0.5, 0.75])
        ratio = np.median(own / times[0])
        aim = "" if target is None else f"below {target:g}"
        lines.append(f"| {name} | {middle:.3g} | {low:.3g} to {high:.3g} | {ratio:.3g} | {aim} |")
    table = "\n".join(lines)
    print(table)
    if not quick:
        put("equilibrium", f"```\n{machine}\n```\n\n{table}")


if __name__ == "__main__":
    main()
