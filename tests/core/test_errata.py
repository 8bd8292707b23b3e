"""The misprints of the paper: each breaks an identity that the right form keeps.

They are those of docs/model.md, "Misprints of the paper". The printed equations are typed from the
paper, with SymPy (tests/support/printed.py); the core plays no part. Equations that are not in that
table are shown to hold as printed.
"""

from typing import Any

import numpy as np
import pytest
import sympy as sp

from oracle import SIDES, vanishes
from printed import (
    DNS,
    DTS,
    GRAVITY,
    INERTIA,
    LAMBDA_H,
    LAMBDA_N,
    OFFSET,
    ONE,
    PI,
    SECOND,
    SYSTEM,
    THETA,
    THETA_RATE,
    THETAS,
    TWO,
    WIDTH,
    X_RATE,
    Y_RATE,
    C,
    E,
    M,
    S,
    U,
    X,
    Y,
    elastic,
    euler_lagrange,
    finger,
    finger_equation,
    holonomic,
    moment_a,
    moment_b,
    nonholonomic,
    normal_equation,
    tangential_equation,
    weight,
)

FINGERS = pytest.mark.parametrize("i", [0, 1], ids=["right", "left"])


# The table


@FINGERS
def test_9_the_sign_of_width_and_offset_contradicts_30(i: int) -> None:
    """With C^H = 0 (28) must become the constant (30)."""
    f = finger(i)
    constant = -f.s * WIDTH / 2 - OFFSET

    def difference(sign: int) -> Any:
        depth = sp.solve(holonomic(i, sign), DNS[i])[0]
        return f.e_c.subs(DNS[i], depth) - constant

    assert vanishes(difference(-1))
    assert not vanishes(difference(+1))


@FINGERS
def test_9_the_sign_of_width_and_offset_contradicts_a_tip_that_touches(i: int) -> None:
    """A circle that touches the face from outside: centre at a from it, and d_n = 0."""
    f = finger(i)
    normal, along_face = sp.Matrix([C, S]), sp.Matrix([-S, C])
    anywhere = sp.Symbol("anywhere", real=True)
    gravity_center = sp.Matrix([X, Y])
    middle = gravity_center - OFFSET * normal
    center = middle - f.s * (WIDTH / 2 + f.a) * normal + anywhere * along_face
    along = (gravity_center - center).dot(normal)
    assert vanishes(holonomic(i, -1, along).subs(DNS[i], 0))
    assert not vanishes(holonomic(i, +1, along).subs(DNS[i], 0))


@FINGERS
@pytest.mark.parametrize("reading", ["a symbol of its own", "d_ti"])
def test_10_another_depth_than_d_n_contradicts_28_and_29(i: int, reading: str) -> None:
    """dC^N/dp (17) must have the printed entries E and F, with d_n."""
    f = finger(i)
    d = DTS[i] if reading == "d_ti" else sp.Symbol("d_i", real=True)
    for radius, holds in ((f.a - DNS[i], True), (f.a - d, False)):
        constraint = nonholonomic(i, radius)
        assert vanishes(sp.diff(constraint, THETA_RATE) - f.e_c) == holds
        assert vanishes(sp.diff(constraint, f.theta_rate) - f.f_c) == holds


@FINGERS
def test_12_gq_not_differentiated_contradicts_25(i: int) -> None:
    """dC^N/dp (17) must be the row of (25), so linear in the velocities."""
    f = finger(i)
    row = [-S, C, f.e_c, 0, 0, 0, 0, 0, 0]
    row[3 + i], row[7 + i] = f.f_c, 1
    right = nonholonomic(i)
    printed = right - SYSTEM.rate(f.gq) + f.gq

    def matches(constraint: Any) -> bool:
        at_rest = constraint.subs(dict.fromkeys(SYSTEM.p, 0))
        entries = [
            vanishes(sp.diff(constraint, rate) - entry)
            for rate, entry in zip(SYSTEM.p, row, strict=True)
        ]
        return all(entries) and vanishes(at_rest)

    assert matches(right)
    assert not matches(printed)
    assert vanishes(sp.diff(printed, X_RATE))


@pytest.mark.parametrize("reading", ["a symbol of its own", "theta_1, right", "theta_2"])
def test_29_the_index_r_contradicts_12(reading: str) -> None:
    """F_ci is dC_i^N/dtheta_i' (17), for both fingers."""
    theta_r = {"theta_1, right": THETAS[0], "theta_2": THETAS[1]}.get(
        reading, sp.Symbol("theta_r", real=True)
    )

    def fulfilled(i: int, index: Any) -> bool:
        f = finger(i)
        entry = f.length * sp.sin(index + f.s * THETA) + f.d_f * sp.cos(f.tilt) + f.a - DNS[i]
        return vanishes(sp.diff(nonholonomic(i), f.theta_rate) - entry)

    assert all(fulfilled(i, THETAS[i]) for i in range(2))
    assert not all(fulfilled(i, theta_r) for i in range(2))


@FINGERS
def test_18_without_control_and_viscosity_contradicts_43_to_45(i: int) -> None:
    f = finger(i)
    equations = (
        (3 + i, finger_equation(i), U[i]),
        (5 + i, normal_equation(i), -f.c_n * f.dn_rate),
        (7 + i, tangential_equation(i), -f.c_t * f.dt_rate),
    )
    for j, equation, added in equations:
        assert not vanishes(euler_lagrange(j) - equation)
        assert vanishes(euler_lagrange(j) - added - equation)


def test_18_without_external_force_contradicts_24() -> None:
    """Second row of (24): M p' - Phi^T lambda = -f_p + f_ext + u_IN, here for the object."""
    external = sp.symbols("f_ext1:4", real=True)
    for j, mass in enumerate((M, M, INERTIA)):
        second_row = (
            mass * SECOND[j]
            - sum(lam * sp.diff(holonomic(i, -1), SYSTEM.q[j]) for i, lam in enumerate(LAMBDA_H))
            - sum(lam * sp.diff(nonholonomic(i), SYSTEM.p[j]) for i, lam in enumerate(LAMBDA_N))
            + sp.diff(elastic() + weight(), SYSTEM.q[j])
            - external[j]
        )
        assert not vanishes(euler_lagrange(j) - second_row)
        assert vanishes(euler_lagrange(j) - external[j] - second_row)


@FINGERS
def test_24_without_viscosity_contradicts_44_and_45(i: int) -> None:
    """Second row of (24) for d_n and d_t, where u_IN and f_ext have nothing."""
    f = finger(i)
    for j, lam, equation, viscous in (
        (5 + i, LAMBDA_H[i], normal_equation(i), f.c_n * f.dn_rate),
        (7 + i, LAMBDA_N[i], tangential_equation(i), f.c_t * f.dt_rate),
    ):
        printed = M * SECOND[j] - lam + sp.diff(elastic() + weight(), SYSTEM.q[j])
        assert not vanishes(printed - equation)
        assert vanishes(printed + viscous - equation)


def test_32_without_weight_contradicts_16() -> None:
    s_y = [S, -S, -C, -C]
    product = sum(lam * s for lam, s in zip((*LAMBDA_H, *LAMBDA_N), s_y, strict=True))
    printed = M * SECOND[1] + product
    assert not vanishes(euler_lagrange(1) - printed)
    assert vanishes(euler_lagrange(1) - (printed + M * GRAVITY))


@FINGERS
def test_34_the_sign_of_a_leaves_the_force_without_a_potential(i: int) -> None:
    """The moment (33) changes with d_n as the force (44) changes with theta."""
    at_rest = {SECOND[5 + i]: 0, LAMBDA_H[i]: 0, finger(i).dn_rate: 0}
    force = normal_equation(i).subs(at_rest)
    for sign, holds in ((-1, True), (+1, False)):
        moment = moment_a(sign) + moment_b()
        curl = sp.diff(moment, DNS[i]) - sp.diff(force, THETA)
        assert vanishes(curl) == holds
        assert vanishes(moment - sp.diff(elastic(), THETA)) == holds


@FINGERS
def test_43_the_sign_of_the_first_term_leaves_the_force_without_a_potential(i: int) -> None:
    """The torque (43) changes with d_n as the force (44) changes with theta_i."""
    at_rest = {SECOND[5 + i]: 0, LAMBDA_H[i]: 0, finger(i).dn_rate: 0}
    force = normal_equation(i).subs(at_rest)
    others = {SECOND[3 + i]: 0, LAMBDA_H[i]: 0, LAMBDA_N[i]: 0, GRAVITY: 0, U[i]: 0}
    for first, holds in ((+1, True), (-1, False)):
        torque = finger_equation(i, first).subs(others)
        assert vanishes(sp.diff(torque, DNS[i]) - sp.diff(force, THETAS[i])) == holds
        assert vanishes(torque - sp.diff(elastic(), THETAS[i])) == holds


@FINGERS
def test_after_29_b_is_minus_the_tangential_component(i: int) -> None:
    """It is that of the vector from the finger's root to the tip's centre, along (-S, C)."""
    f = finger(i)
    root = sp.Matrix([-f.s * f.w_f, 0])
    arm = sp.Matrix([f.ox, f.oy]) - root
    tangential = arm.dot(sp.Matrix([-S, C]))
    assert not vanishes(f.b_c - tangential)
    assert vanishes(f.b_c + tangential)
    # What the same sentence says of F and A is right.
    assert vanishes(f.f_c - (f.s * arm.dot(sp.Matrix([C, S])) + f.a - DNS[i]))
    assert vanishes(f.a_c - f.s * f.gq)


@FINGERS
def test_44_and_45_another_displacement_than_d_t_is_no_gradient_of_5(i: int) -> None:
    """(44) and (45) are rows of Lagrange's equations, but for the viscous forces."""
    f = finger(i)
    d_l, d_l_second = sp.symbols("d_l d_l_second", real=True)
    normal = euler_lagrange(5 + i) + f.c_n * f.dn_rate
    tangential = euler_lagrange(7 + i) + f.c_t * f.dt_rate
    assert vanishes(normal - normal_equation(i))
    assert not vanishes(normal - normal_equation(i, d_l))
    assert vanishes(tangential - tangential_equation(i))
    assert not vanishes(tangential - tangential_equation(i, d_l_second))


# What is not in the table


def test_25_to_28_30_31_33_and_35_to_38_hold_as_printed() -> None:
    printed = sp.zeros(4, 9)
    for i, f in enumerate((ONE, TWO)):
        printed[i, 0], printed[i, 1], printed[i, 2] = f.s * C, f.s * S, f.a_c
        printed[2 + i, 0], printed[2 + i, 1], printed[2 + i, 2] = -S, C, f.e_c
        printed[i, 3 + i], printed[2 + i, 3 + i] = f.b_c, f.f_c
        printed[i, 5 + i] = printed[2 + i, 7 + i] = 1
    derived = SYSTEM.matrix("constraint_matrix")
    assert all(vanishes(a - b) for a, b in zip(printed, derived, strict=True))
    assert list(printed[0, :2]) == [-C, -S]

    multipliers = sp.Matrix([*LAMBDA_H, *LAMBDA_N])
    s_x = sp.Matrix([C, -C, S, S])
    s_theta = sp.Matrix([ONE.a_c, TWO.a_c, ONE.e_c, TWO.e_c])
    assert vanishes(euler_lagrange(0) - (M * SECOND[0] + multipliers.dot(s_x)))
    turning = INERTIA * SECOND[2] + moment_a(-1) + moment_b() - multipliers.dot(s_theta)
    assert vanishes(euler_lagrange(2) - turning)


def test_the_oracle_is_the_right_forms() -> None:
    """Lagrange's equations typed here and those that the oracle derives are the same."""
    tips = {
        SYSTEM.parameters[f"hand.tip.{side}.{name}"]: value
        for side, _ in SIDES
        for name, value in (
            ("youngs_modulus", E),
            ("tilt_coupling", sp.Integer(1)),
            ("normal_mass", M),
            ("tangential_mass", M),
        )
    }
    phi = SYSTEM.matrix("constraint_matrix")
    reaction = phi.T * sp.Matrix([*LAMBDA_H, *LAMBDA_N])
    forces = SYSTEM.matrix("elastic") + SYSTEM.matrix("gravity")
    motion = SYSTEM.matrix("mass_matrix") * sp.Matrix(SECOND) - forces - reaction
    for j in range(9):
        assert vanishes(motion[j].subs(tips) - euler_lagrange(j))


# The hemisphere: (4) from (3), and the sign of d_t


def test_4_is_the_sum_3_over_the_hemisphere() -> None:
    """Springs of E dA / length on the base; P as a function of d_n, d_t and theta_p.

    A point of the sphere is zeta n + sqrt(a^2 - zeta^2) (cos(phi) e + sin(phi) j), n the face's
    normal: it is pressed where zeta > a - d_n, a whole circle of phi as long as the cap lies within
    the hemisphere.
    """
    a, d_n, tilt, zeta = sp.symbols("a d_n theta_p zeta", positive=True)
    d_t, phi = sp.symbols("d_t phi", real=True)
    rim = sp.sqrt(a**2 - zeta**2)
    # Along the base in the plane of the tilt, across it, and up from the base.
    across = zeta * sp.sin(tilt) - rim * sp.cos(phi) * sp.cos(tilt)
    aside = rim * sp.sin(phi)
    up = zeta * sp.cos(tilt) + rim * sp.cos(phi) * sp.sin(tilt)
    # The face's plane above the same point of the base: n . r = a - d_n.
    face = (a - d_n - across * sp.sin(tilt)) / sp.cos(tilt)
    compression = sp.simplify(up - face)
    assert vanishes(compression - (zeta - (a - d_n)) / sp.cos(tilt))
    area = sp.diff(across, zeta) * sp.diff(aside, phi) - sp.diff(across, phi) * sp.diff(aside, zeta)
    # dA / length of the spring: by Archimedes an even density.
    density = sp.simplify(area / up)
    assert vanishes(density**2 - 1)
    # Nothing depends on phi.
    pressed = (zeta - (a - d_n)) / sp.cos(tilt)
    integrand = ((pressed + d_t * sp.sin(tilt)) ** 2 + d_t**2 * sp.cos(tilt) ** 2) / 2
    summed = E * sp.integrate(sp.expand(2 * PI * integrand), (zeta, a - d_n, a))
    printed = (
        PI * E * (d_n**3 / (3 * sp.cos(tilt) ** 2) + d_n**2 * d_t * sp.tan(tilt) + d_n * d_t**2)
    )
    assert vanishes(sp.expand(summed) - printed)


@pytest.mark.parametrize("share", [0.5, 0.99, 1.2, 1.5])
def test_4_fails_where_the_contact_reaches_the_rim(share: float) -> None:
    """(3) summed numerically over the hemisphere alone; the rim is at d_n = a (1 - sin theta_p)."""
    a, tilt, shear = 0.02, 0.5, 0.001
    depth = share * a * (1 - np.sin(tilt))
    n = 2000
    psi = (np.arange(n) + 0.5) * np.pi / 2 / n
    phi = (np.arange(n) + 0.5) * np.pi / n
    across = a * np.sin(psi)[:, None] * np.cos(phi)
    length = a * np.cos(psi)[:, None]
    face = (a - depth - across * np.sin(tilt)) / np.cos(tilt)
    pressed = length - face
    # dA / length = a sin(psi) dpsi dphi; phi from 0 to pi, twice.
    density = 2 * a * np.sin(psi)[:, None] * (np.pi / 2 / n) * (np.pi / n)
    energy = ((pressed + shear * np.sin(tilt)) ** 2 + (shear * np.cos(tilt)) ** 2) / 2
    summed = (density * energy * (pressed > 0)).sum()
    printed = np.pi * (
        depth**3 / (3 * np.cos(tilt) ** 2) + depth**2 * shear * np.tan(tilt) + depth * shear**2
    )
    off = abs(summed / printed - 1)
    assert off < 1e-5 if share < 1 else off > 1e-3, off


@FINGERS
def test_12_has_the_shear_minus_the_slip(i: int) -> None:
    """The slip is the object's velocity past the tip's at the contact, along (-S, C)."""
    f = finger(i)
    normal, along_face = sp.Matrix([C, S]), sp.Matrix([-S, C])
    center = sp.Matrix([f.ox, f.oy])
    contact = center + f.s * (f.a - DNS[i]) * normal

    def carried(origin: Any, velocity: Any, spin: Any) -> Any:
        arm = contact - origin
        return velocity + spin * sp.Matrix([-arm[1], arm[0]])

    object_ = carried(sp.Matrix([X, Y]), sp.Matrix([X_RATE, Y_RATE]), THETA_RATE)
    # Inward is counter-clockwise for the right finger.
    tip = carried(center, center.applyfunc(SYSTEM.rate), -f.s * f.theta_rate)
    slip = (object_ - tip).dot(along_face)
    assert vanishes(nonholonomic(i) - (slip + f.dt_rate))


@FINGERS
def test_the_springs_of_1_have_the_shear_plus_the_slip(i: int) -> None:
    """A spring along the finger's inward normal, its end carried by `slip` along the face.

    (1) says it is shortened by d_t sin(theta_p), (2) that it bends by d_t cos(theta_p): so d_t is
    +slip, against -slip of (12), and (5) with (12) has kappa = -1.
    """
    f = finger(i)
    slip = sp.Symbol("slip", real=True)
    inward = sp.Matrix([sp.diff(f.ox, f.d_f), sp.diff(f.oy, f.d_f)])
    carried = slip * sp.Matrix([-S, C])
    shortened = -carried.dot(inward)
    assert vanishes(shortened - slip * sp.sin(f.tilt))
    assert not vanishes(shortened + slip * sp.sin(f.tilt))
    bent = carried.dot(sp.Matrix([-inward[1], inward[0]]))
    assert vanishes(bent**2 - slip**2 * sp.cos(f.tilt) ** 2)

    tip = SYSTEM.tip(i)
    energy = SYSTEM.terms["elastic_energy"][0]
    springs = energy.subs({tip["tilt_coupling"]: 1, tip["dt"]: slip})
    for kappa, holds in ((-1, True), (1, False)):
        kinematics = energy.subs({tip["tilt_coupling"]: kappa, tip["dt"]: -slip})
        assert vanishes(kinematics - springs) == holds
