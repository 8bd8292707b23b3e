"""Quantiles of the normal distribution and the truncated normal distribution."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from ..support.arrays import Floats
from ..support.extras import require

# Limits of uniform numbers, so that quantiles are finite.
LEAST = 2.0**-54
MOST = 1.0 - 2.0**-53


def inside(u: Floats) -> Floats:
    """Clips uniform numbers to [2^-54, 1 - 2^-53], so that their quantiles are finite."""
    clipped: Floats = np.clip(u, LEAST, MOST)
    return clipped


def normal(u: Floats, owner: str) -> Floats:
    """Standard normal quantiles, always finite; `owner` names the distribution in errors.

    Raises:
        ImportError: SciPy is not installed.
    """
    quantiles: Floats = _special(owner).ndtri(inside(u))
    return quantiles


def truncated(
    u: Floats, mean: Floats, std: Floats, low: Floats, high: Floats, *, owner: str
) -> Floats:
    """Quantiles of the normal distribution truncated to an interval.

    `scipy.stats.truncnorm.ppf` uses this formula too, but takes three times as long, and a second
    to import. About half of its draws differ from these by rounding.

    Args:
        u: Uniform numbers (n, *shape).
        mean: Mean before truncation, of the shape of a draw, like all following parameters.
        std: Standard deviation before truncation.
        low: Lower bound.
        high: Upper bound.
        owner: The distribution's name in errors.

    Raises:
        ImportError: SciPy is not installed.
    """
    special = _special(owner)
    with np.errstate(over="ignore"):
        bottom, top = (low - mean) / std, (high - mean) / std
    # Mirror an interval above the mean, because only the lower tail has enough digits.
    mirrored = bottom > 0.0
    near, far = np.where(mirrored, -bottom, top), np.where(mirrored, -top, bottom)
    inner = inside(u)
    from_near, from_far = np.log1p(-inner), np.log(inner)
    weight_near = np.where(mirrored, from_near, from_far)
    weight_far = np.where(mirrored, from_far, from_near)
    log_p = np.logaddexp(special.log_ndtr(near) + weight_near, special.log_ndtr(far) + weight_far)
    # Rounding may raise the sum of both terms above 1.
    z = special.ndtri_exp(np.minimum(log_p, -LEAST))
    quantiles: Floats = np.clip(mean + std * np.where(mirrored, -z, z), low, high)
    return quantiles


def _special(owner: str) -> ModuleType:
    return require("scipy.special", extra="study", purpose=f"quantiles of {owner} (SciPy)")
