"""What a simulation that is not in this repository says of unilateral contact, to compare with.

It is event-driven, with exact events and a relative tolerance of 1e-11, and shares no code with the
core or with tests/oracle. The scenes have the paper's parameters and faces 49 mm high. Where the
pushes and the friction that smooth moves need were sought, it is not known how finely.
"""

from typing import TypeAlias

import softpinch as sp

Direction: TypeAlias = tuple[float, float, float]

HEIGHT = 0.049
BILATERAL = None

# The paper's eight operations in steps of the targets, degrees, one a second.
OPERATIONS = [(6, 6), (20, -10), (-2, 13), (-10, 20), (-7, 17), (17, -7), (-15, 25), (5, 5)]
# By friction: theta in degrees / y in mm at the end of each operation.
ENDS: dict[float | None, str] = {
    BILATERAL: "0.000/74.020 -9.427/71.893 5.879/73.896 10.547/72.182 "
    "8.586/73.089 -7.766/73.367 13.657/71.029 0.271/75.692",
    0.3: "0.000/74.020 -8.709/71.438 2.859/71.242 7.615/69.499 "
    "5.573/70.404 -5.504/67.546 7.151/59.216 0.673/59.615",
    0.5: "0.000/74.020 -8.830/71.515 3.206/71.601 7.983/69.877 "
    "5.949/70.782 -5.848/68.362 7.484/60.991 -0.664/62.352",
    0.8: "0.000/74.020 -8.886/71.551 3.482/71.835 8.261/70.119 "
    "6.233/71.024 -6.021/68.878 8.044/61.973 -1.374/64.070",
    1.0: "0.000/74.020 -8.895/71.556 3.583/71.905 8.361/70.192 "
    "6.336/71.097 -6.054/69.031 8.239/62.270 -1.645/64.638",
}
FRICTIONS = [friction for friction in ENDS if friction is not BILATERAL]
# Tips open at the switches into operations 2, 3, 4, 6, 7 and 8, for 0.2 to 4 ms.
OPENINGS = [1, 2, 3, 5, 6, 7]

# Move times of minimum-jerk moves in ms, with friction at which a tip slips or opens, and at which
# none does. The hardest is the switch into operation 7.
SMOOTH = [(30, 0.298, 0.302), (20, 0.302, 0.305), (10, 0.84, 0.86), (7, 5.8, 6.0)]

# The target of both fingers in degrees, by the paper's disturbance.
DEGREES = {"i": 6, "ii": 6, "iii": 3, "iv": 2}
# theta in degrees at the end of those that slip and are held.
SLIPPED = {("iii", 0.3): "3.59", ("iv", 0.3): "0.98"}

# Direction (N, N, N m) -> by friction the largest push of 10 ms that is held; see `push`. A
# bilateral run holds if its tips stay compressed.
PUSHES: dict[Direction, dict[float | None, float]] = {
    (1, 0, 0): {BILATERAL: 271, 0.3: 233, 0.5: 232, 0.8: 232, 1.0: 232},
    (0, 1, 0): {BILATERAL: 565, 0.3: 64, 0.5: 90, 0.8: 125, 1.0: 147},
    (0, -1, 0): {BILATERAL: 805, 0.3: 63, 0.5: 94, 0.8: 143, 1.0: 178},
    (0, 0, 1): {BILATERAL: 59, 0.3: 11.4, 0.5: 16.5, 0.8: 27.6, 1.0: 35.4},
    # By its component along x.
    (1, 1, 5 / 130): {0.5: 156, 0.8: 358, 1.0: 216},
}


def push(direction: Direction, size: float) -> sp.Pulse:
    """A push at t = 1 s. It is held if no finger is free 0.5 s after it has ended."""
    x, y, turn = (size * part for part in direction)
    return sp.Pulse(time=1.0, duration=0.01, force=(x, y), moment=turn)
