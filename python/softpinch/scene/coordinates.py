"""The generalised coordinates by name, in the order of `State.q`, and their units."""

from __future__ import annotations

COORDINATES = ("x", "y", "theta", "theta_1", "theta_2", "d_n1", "d_n2", "d_t1", "d_t2")
COORDINATE_UNITS = ("m", "m", "rad", "rad", "rad", "m", "m", "m", "m")
# The rates of the coordinates, in the order of `State.p`.
RATES = tuple(f"rate of {name}" for name in COORDINATES)
RATE_UNITS = tuple(f"{unit}/s" for unit in COORDINATE_UNITS)
