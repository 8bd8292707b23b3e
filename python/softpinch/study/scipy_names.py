"""SciPy distributions in study files and manifests.

An entry may be {kind = "scipy", name = "gamma", args = [2.0]}. Files come from other people, so an
entry must not be able to run other code: the name must be that of a distribution, and the arguments
must be numbers for its parameters. Both are checked before any function of SciPy is called.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from types import ModuleType
from typing import Any

import numpy as np

from ..support import checks, extras
from ..support.interrupt import by_handler

# The multivariate distributions that a file may name, and their parameters. Each of them keeps its
# parameters when it is frozen and draws real arrays, so a manifest can hold it.
MULTIVARIATE: dict[str, tuple[str, ...]] = {
    "dirichlet": ("alpha",),
    "invwishart": ("df", "scale"),
    "matrix_normal": ("mean", "rowcov", "colcov"),
    "multinomial": ("n", "p"),
    "multivariate_hypergeom": ("m", "n"),
    "multivariate_normal": ("mean", "cov", "allow_singular"),
    "multivariate_t": ("loc", "shape", "df", "allow_singular"),
    "ortho_group": ("dim",),
    "special_ortho_group": ("dim",),
    "uniform_direction": ("dim",),
    "vonmises_fisher": ("mu", "kappa"),
    "wishart": ("df", "scale"),
}
# The most numbers to which the parameters of a univariate distribution may broadcast.
_MOST_NUMBERS = 2**20
# The longest axis of a multivariate parameter: a covariance of this size takes 8 MB.
_LONGEST = 1024
# Drawing takes memory in proportion to these parameters, so a file may not make them huge.
_COUNTS = {("irwinhall", "n"), ("nhypergeom", "M")}
_MOST_COUNT = 10_000


def known(stats: ModuleType | None, name: object) -> Any:
    """The distribution of this name in `scipy.stats`; None if files may not use the name."""
    if stats is None or not isinstance(name, str) or name.startswith("_"):
        return None
    # Use the module's dictionary, because getattr might run the module's `__getattr__`.
    found = vars(stats).get(name)
    univariate = isinstance(found, stats.rv_continuous | stats.rv_discrete)
    return found if univariate or name in MULTIVARIATE else None


def described(value: Any, name: str) -> bool:
    """Whether a frozen distribution is SciPy's own distribution `name`, which a file can name."""
    frozen = getattr(value, "dist", getattr(value, "_dist", value))
    # Without an imported SciPy the distribution cannot be SciPy's.
    return type(known(sys.modules.get("scipy.stats"), name)) is type(frozen)


def frozen(where: str, data: Mapping[str, Any]) -> Any:
    """Makes the frozen distribution that a table of a file describes.

    Args:
        where: The table's name, for error messages.
        data: The table: `name`, and optionally `args` and `kwds`.

    Raises:
        ValueError: The name is not that of a distribution, or an argument breaks its rule.
        TypeError: An argument is of the wrong kind.
        ImportError: SciPy is not installed.
    """
    stats = extras.require("scipy.stats", extra="study", purpose=f"{where} (SciPy)")
    name = data.get("name")
    distribution = known(stats, name)
    if distribution is None:
        allowed = [each for each in vars(stats) if known(stats, each) is not None]
        hint = checks.hint(name, allowed) if isinstance(name, str) else ""
        raise ValueError(
            f"{where}: name = {checks.shown(name)}: must be a distribution of scipy.stats, such "
            f'as "gamma" or "multivariate_normal"{hint}'
        )
    args, kwds = data.get("args", []), data.get("kwds", {})
    if not isinstance(args, list | tuple):
        raise TypeError(f"{where}: args = {checks.shown(args)}: must be an array of numbers")
    if not isinstance(kwds, Mapping):
        raise TypeError(f"{where}: kwds = {checks.shown(kwds)}: must be a table of numbers")
    univariate = name not in MULTIVARIATE
    check = _check_univariate if univariate else _check_multivariate
    check(f"{where}: {name}", str(name), distribution, args, kwds)
    try:
        made = distribution(*args, **kwds)
        # If parameters are outside of its domain, a univariate distribution's support is NaN.
        valid = not (univariate and np.isnan(made.support()).any())
    except Exception as error:
        if by_handler(error):
            raise
        raise ValueError(f"{where}: SciPy cannot make {name}: {error}") from None
    if not valid:
        given = ", ".join([*map(checks.shown, args), *(f"{k} = {v}" for k, v in kwds.items())])
        raise ValueError(f"{where}: {name}({given}): is outside of the distribution's domain")
    return made


def _check_univariate(
    where: str, name: str, distribution: Any, args: Iterable[Any], kwds: Mapping[str, Any]
) -> None:
    """Refuses arguments that are not numbers for the shape parameters, loc or scale."""
    shapes = distribution.shapes.replace(",", " ").split() if distribution.shapes else []
    names = [*shapes, "loc", *(["scale"] if hasattr(distribution, "pdf") else [])]
    given = list(args)
    if len(given) > len(names):
        raise ValueError(f"{where} has {len(given)} args: must be at most {len(names)}")
    checks.refuse_unknown(where, kwds, names, "")
    found = {**dict(zip(names, given, strict=False)), **kwds}
    arrays = {each: _numbers(f"{where}.{each}", value) for each, value in found.items()}
    try:
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError:
        raise ValueError(f"{where}: the shapes of its arguments must broadcast") from None
    if math.prod(shape) > _MOST_NUMBERS:
        raise ValueError(f"{where} has shape {shape}: must be at most {_MOST_NUMBERS} numbers")
    for each, array in arrays.items():
        if (name, each) in _COUNTS and (array > _MOST_COUNT).any():
            raise ValueError(f"{where}.{each} = {array.max()}: must be at most {_MOST_COUNT}")


def _check_multivariate(
    where: str, name: str, distribution: Any, args: Iterable[Any], kwds: Mapping[str, Any]
) -> None:
    """Refuses unknown parameters, and values other than numbers, vectors and small matrices."""
    if list(args):
        raise ValueError(f"{where}: args: must be empty; give its parameters by name, in kwds")
    checks.refuse_unknown(where, kwds, MULTIVARIATE[name], "")
    for each, value in kwds.items():
        if each == "allow_singular":
            if not isinstance(value, bool):
                raise TypeError(f"{where}.{each} = {checks.shown(value)}: must be true or false")
        elif each == "dim":
            checks.integer(f"{where}.dim", value, 1, _LONGEST)
        else:
            array = _numbers(f"{where}.{each}", value)
            if array.ndim > 2 or max(array.shape, default=0) > _LONGEST:
                raise ValueError(
                    f"{where}.{each} has shape {array.shape}: must be a number, a vector or a "
                    f"matrix with at most {_LONGEST} entries a side"
                )


def _numbers(where: str, value: Any) -> np.ndarray[Any, Any]:
    """Converts a value of a file to an array of numbers, which may be infinite but not NaN."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise ValueError(f"{where} is ragged: must be a number or an array") from None
    checks.require_few_axes(where, array)
    if array.dtype.kind not in "iuf" or isinstance(value, str):
        raise TypeError(f"{where} = {checks.shown(value)}: must be a number or an array of them")
    if array.size == 0 or np.isnan(array).any():
        raise ValueError(f"{where} = {checks.shown(value)}: must be numbers, and none of them NaN")
    return array
