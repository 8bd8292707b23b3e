"""The symbols of the equations, for suggestions: "E" is "hand.tip.youngs_modulus"."""

from __future__ import annotations

# Symbol in plain text -> its path in a scene; the table of the page docs/symbols.md.
SYMBOLS: dict[str, str] = {
    "L": "hand.right.length",
    "W_f": "hand.right.root_offset",
    "d_f": "hand.right.half_thickness",
    "M_i": "hand.right.mass",
    "I_i": "hand.right.inertia",
    "a": "hand.tip.radius",
    "E": "hand.tip.youngs_modulus",
    "c_n": "hand.tip.normal_viscosity",
    "c_t": "hand.tip.tangential_viscosity",
    "kappa": "hand.tip.tilt_coupling",
    "m_n": "hand.tip.normal_mass",
    "m_t": "hand.tip.tangential_mass",
    "W": "grasped.width",
    "M": "grasped.mass",
    "I": "grasped.inertia",
    "w": "grasped.com_offset",
    "K_P": "control.kp",
    "K_D": "control.kd",
    "K_I": "control.ki",
    "g": "gravity",
    "mu": "friction",
}


def spelt_out(path: str) -> tuple[str, ...]:
    """Returns the paths that a path with a symbol in its last place may mean, the likeliest first.

    For "hand.tip.left.E" that is the same record's field, "hand.tip.left.youngs_modulus", then
    "hand.tip.youngs_modulus". A path without a symbol gives none.
    """
    owner, _, symbol = path.rpartition(".")
    if symbol not in SYMBOLS:
        return ()
    field = SYMBOLS[symbol].rpartition(".")[2]
    return (f"{owner}.{field}" if owner else field, SYMBOLS[symbol])
