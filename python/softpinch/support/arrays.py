"""Array types that records and results use."""

from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Complexes: TypeAlias = NDArray[np.complex128]
Bools: TypeAlias = NDArray[np.bool_]
Texts: TypeAlias = NDArray[np.str_]
Array = TypeVar("Array", bound=NDArray[Any])


def read_only(value: Array) -> Array:
    """Makes an array read-only in place and returns it."""
    value.setflags(write=False)
    return value
