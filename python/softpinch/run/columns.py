"""The headers of the columns of a run's arrays, with units."""

from ..scene.coordinates import COORDINATE_UNITS, COORDINATES, RATE_UNITS, RATES
from .error_estimate import QUANTITIES

# Array -> the headers of its columns in a CSV file, with units.
COLUMNS: dict[str, tuple[str, ...]] = {
    "q": tuple(f"{c} [{u}]" for c, u in zip(COORDINATES, COORDINATE_UNITS, strict=True)),
    "p": tuple(f"{c} [{u}]" for c, u in zip(RATES, RATE_UNITS, strict=True)),
    "integral": ("integral_1 [rad s]", "integral_2 [rad s]"),
    "multipliers": tuple(f"lambda_{name} [N]" for name in ("1H", "2H", "1N", "2N")),
    "residuals": ("C_1H [m]", "C_2H [m]", "C_1N [m/s]", "C_2N [m/s]"),
    "torque": ("torque_1 [N m]", "torque_2 [N m]"),
    "contact": ("contact_1 [1]", "contact_2 [1]"),
}
RECORDED_ARRAYS = tuple(COLUMNS)
COLUMNS |= {
    f"error_{name}": tuple(f"error of {column}" for column in COLUMNS[name]) for name in QUANTITIES
}
