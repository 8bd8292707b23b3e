"""Arguments and options that several commands share, with their help texts."""

from pathlib import Path
from typing import Annotated

import typer

from .. import _core
from ..scene.stabilization import Stabilization
from ..support.files import FORMATS

SceneFile = Annotated[
    Path, typer.Argument(help="The scene, a TOML file: SI units, angles in radians.")
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Change the scene at a dotted path, as friction=0.3 or "
        '"disturbances.0.force=[5, 0]"; the value is written as in TOML. May be given several '
        "times.",
    ),
]
Out = Annotated[Path, typer.Option(help="The directory for tables and figures, made if needed.")]
Format = Annotated[str, typer.Option(metavar="|".join(FORMATS), help="Format of the figures.")]
Dt = Annotated[
    float | None, typer.Option(help="The longest step, s; the default without --tolerance is 1e-4.")
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="Instead of --dt: the largest error of a step, as a share of each state's size "
        f"({', '.join(_core.ADAPTIVE_METHODS)})."
    ),
]
Method = Annotated[
    str | None,
    typer.Option(metavar="|".join(_core.METHODS), help="Integration method; the default is rk4."),
]
Formulation = Annotated[
    str | None,
    typer.Option(
        metavar="|".join(_core.FORMULATIONS),
        help="How the constraints are enforced; the default is csm.",
    ),
]
_GAINS = Stabilization()
_OF = "Gain of the {} constraints ({}), 1/s, of csm; the default is {:g}."
Alpha = Annotated[float | None, typer.Option(help=_OF.format("holonomic", 19, _GAINS.alpha))]
Beta = Annotated[float | None, typer.Option(help=_OF.format("nonholonomic", 20, _GAINS.beta))]
Threads = Annotated[int | None, typer.Option(help="Largest number of threads; all if left out.")]


def separated(text: str) -> tuple[str, ...]:
    """Splits a comma-separated list into names."""
    return tuple(name for name in text.replace(" ", "").split(",") if name)
