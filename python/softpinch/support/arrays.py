"""Arrays of numbers, as descriptions and results hold them."""

from __future__ import annotations

from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Array = TypeVar("Array", bound=NDArray[Any])


def read_only(value: Array) -> Array:
    """The same array, no longer writable."""
    value.setflags(write=False)
    return value
