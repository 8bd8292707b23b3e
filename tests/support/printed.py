"""The equations of the paper, typed from it with SymPy, in the readings that they may have."""

from types import SimpleNamespace
from typing import Any

import sympy as sp

from oracle import SIDES, model

PI = sp.pi
SYSTEM = model()
X, Y, THETA = SYSTEM.q[:3]
THETAS, DNS, DTS = SYSTEM.q[3:5], SYSTEM.q[5:7], SYSTEM.q[7:9]
X_RATE, Y_RATE, THETA_RATE = SYSTEM.p[:3]
SECOND = sp.symbols(
    "x2 y2 theta2nd theta1_2nd theta2_2nd dn1_2nd dn2_2nd dt1_2nd dt2_2nd", real=True
)
M, INERTIA = SYSTEM.parameters["grasped.mass"], SYSTEM.parameters["grasped.inertia"]
WIDTH, OFFSET = SYSTEM.parameters["grasped.width"], SYSTEM.parameters["grasped.com_offset"]
GRAVITY = SYSTEM.parameters["gravity"]
LAMBDA_H = sp.symbols("lambdaH1 lambdaH2", real=True)
LAMBDA_N = sp.symbols("lambdaN1 lambdaN2", real=True)
S, C = sp.sin(THETA), sp.cos(THETA)
# The paper's tips have one modulus, the object's mass and kappa = 1.
E = sp.Symbol("E", real=True)
TIPS = {
    SYSTEM.parameters[f"hand.tip.{side}.{name}"]: value
    for side, _ in SIDES
    for name, value in (
        ("youngs_modulus", E),
        ("tilt_coupling", sp.Integer(1)),
        ("normal_mass", M),
        ("tangential_mass", M),
    )
}
U = sp.symbols("uIN1 uIN2", real=True)


def finger(i: int) -> SimpleNamespace:
    """(6), (7), (8), (11) and the short names of finger i."""
    tip, s = SYSTEM.tip(i), SIDES[i][1]
    length, w_f, d_f = (tip[f"finger_{n}"] for n in ("length", "root_offset", "half_thickness"))
    sine, cosine = sp.sin(THETAS[i]), sp.cos(THETAS[i])
    ox = -s * w_f + s * length * sine + s * d_f * cosine
    oy = length * cosine - d_f * sine
    tilt = THETAS[i] + s * THETA
    return SimpleNamespace(
        s=s,
        ox=ox,
        oy=oy,
        gq=-(X - ox) * S + (Y - oy) * C,
        along=(X - ox) * C + (Y - oy) * S,
        tilt=tilt,
        a=tip["radius"],
        length=length,
        w_f=w_f,
        d_f=d_f,
        mass=tip["finger_mass"],
        inertia=tip["finger_inertia"],
        theta_rate=tip["angle_rate"],
        dn_rate=tip["dn_rate"],
        dt_rate=tip["dt_rate"],
        turning=tip["angle_rate"] + s * THETA_RATE,
        c_n=tip["normal_viscosity"],
        c_t=tip["tangential_viscosity"],
        # (26) to (29), the last with the right index.
        a_c=-s * (X - ox) * S + s * (Y - oy) * C,
        b_c=-length * sp.cos(tilt) + d_f * sp.sin(tilt),
        e_c=-(X - ox) * C - (Y - oy) * S + s * (tip["radius"] - DNS[i]),
        f_c=length * sp.sin(tilt) + d_f * sp.cos(tilt) + (tip["radius"] - DNS[i]),
    )


ONE, TWO = finger(0), finger(1)


def holonomic(i: int, sign: int) -> Any:
    """(9): sign +1 is printed, -1 is right."""
    f = finger(i)
    return f.s * f.along - (f.a - DNS[i]) + sign * (WIDTH / 2 + f.s * OFFSET)


def nonholonomic(i: int, radius: Any = None) -> Any:
    """(10) in (12), which is differentiated; printed (10) has another radius."""
    f = finger(i)
    rolling = -((f.a - DNS[i]) if radius is None else radius) * f.turning
    return SYSTEM.rate(f.gq) - rolling + f.dt_rate


def elastic() -> Any:
    """(5) with (6), as the oracle has it."""
    return SYSTEM.terms["elastic_energy"][0].subs(TIPS)


def weight() -> Any:
    """(16), as the oracle has it."""
    return SYSTEM.terms["gravity_energy"][0]


def euler_lagrange(j: int) -> Any:
    """Left minus right side of (18) as printed, row j, of the oracle's own terms."""
    inertia = SYSTEM.matrix("mass_matrix").subs(TIPS)[j, j] * SECOND[j]
    forces = SYSTEM.terms["elastic"][j].subs(TIPS) + SYSTEM.terms["gravity"][j]
    column = SYSTEM.matrix("constraint_matrix")[:, j]
    return inertia - forces - column.dot(sp.Matrix([*LAMBDA_H, *LAMBDA_N]))


def finger_equation(i: int, first: int = 1) -> Any:
    """(43), left minus right side; `first` is the sign of its first elastic term, -1 as printed."""
    f = finger(i)
    sine, cosine = sp.sin(f.tilt), sp.cos(f.tilt)
    return (
        f.inertia * SECOND[3 + i]
        + first * 2 * PI * E * DNS[i] ** 3 * sine / (3 * cosine**3)
        + PI * E * DNS[i] ** 2 * DTS[i] / cosine**2
        - LAMBDA_H[i] * f.b_c
        - LAMBDA_N[i] * f.f_c
        - f.mass * GRAVITY * f.length * sp.sin(THETAS[i])
        - U[i]
    )


def normal_equation(i: int, d_l: Any = None) -> Any:
    """(44); `d_l` as it is printed, d_t where it is not given."""
    f = finger(i)
    d_l = DTS[i] if d_l is None else d_l
    return (
        M * SECOND[5 + i]
        + PI * E * DNS[i] ** 2 / sp.cos(f.tilt) ** 2
        + 2 * PI * E * DNS[i] * d_l * sp.tan(f.tilt)
        + PI * E * d_l**2
        - LAMBDA_H[i]
        + f.c_n * f.dn_rate
    )


def tangential_equation(i: int, second: Any = None) -> Any:
    """(45); `second` is the rate of the printed d_l's rate."""
    f = finger(i)
    return (
        M * (SECOND[7 + i] if second is None else second)
        + PI * E * DNS[i] ** 2 * sp.tan(f.tilt)
        + 2 * PI * E * DNS[i] * DTS[i]
        - LAMBDA_N[i]
        + f.c_t * f.dt_rate
    )


def moment_a(sign: int) -> Any:
    """(34); sign +1 as printed."""
    one, two = (
        dn**3 * sp.sin(f.tilt) / sp.cos(f.tilt) ** 3 for f, dn in zip((ONE, TWO), DNS, strict=True)
    )
    return sign * 2 * PI * E / 3 * (one - two)


def moment_b() -> Any:
    """(35)."""
    one, two = (
        dn**2 * dt / sp.cos(f.tilt) ** 2 for f, dn, dt in zip((ONE, TWO), DNS, DTS, strict=True)
    )
    return PI * E * (-one + two)
