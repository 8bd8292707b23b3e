"""Quantiles of the normal distribution, whole and between bounds, from uniform numbers."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from ..support.arrays import Floats
from ..support.extras import require

# What `ppf` makes of 0 and of numbers too close to 1: the quantiles of these are finite.
LEAST = 2.0**-54
MOST = 1.0 - 2.0**-53


def inside(u: Floats) -> Floats:
    """Uniform numbers clipped to [2^-54, 1 - 2^-53], so that no quantile of theirs is infinite."""
    clipped: Floats = np.clip(u, LEAST, MOST)
    return clipped


def normal(u: Floats, owner: str) -> Floats:
    """Standard normal quantiles, finite for 0; `owner` is what errors call the distribution.

    Raises:
        ImportError: SciPy is not installed.
    """
    quantiles: Floats = _special(owner).ndtri(inside(u))
    return quantiles


def truncated(
    u: Floats, mean: Floats, std: Floats, low: Floats, high: Floats, *, owner: str
) -> Floats:
    """Normal quantiles, given that they lie between two bounds, all of one shape.

    `scipy.stats.truncnorm.ppf` has the same formula from the same functions of `scipy.special`. It
    rounds half of the draws otherwise, takes three times as long, and a second to import.

    Raises:
        ImportError: SciPy is not installed.
    """
    special = _special(owner)
    with np.errstate(over="ignore"):
        bottom, top = (low - mean) / std, (high - mean) / std
    # An interval above the mean is taken by its mirror image: the small tail has the digits.
    mirrored = bottom > 0.0
    near, far = np.where(mirrored, -bottom, top), np.where(mirrored, -top, bottom)
    inner = inside(u)
    from_near, from_far = np.log1p(-inner), np.log(inner)
    weight_near = np.where(mirrored, from_near, from_far)
    weight_far = np.where(mirrored, from_far, from_near)
    log_p = np.logaddexp(special.log_ndtr(near) + weight_near, special.log_ndtr(far) + weight_far)
    # Rounding may carry the sum of the two above 1.
    z = special.ndtri_exp(np.minimum(log_p, -LEAST))
    quantiles: Floats = np.clip(mean + std * np.where(mirrored, -z, z), low, high)
    return quantiles


def _special(owner: str) -> ModuleType:
    return require("scipy.special", extra="study", purpose=f"quantiles of {owner} (SciPy)")
