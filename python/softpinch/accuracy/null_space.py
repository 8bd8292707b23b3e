"""The null-space form (14 states), written once for all types of numbers that have a sine.

The formulation `nullspace` of docs/integrators.md (Maggi's equations): the compressions follow from
C^H = 0 (9), their rates and the shears' from Phi p = 0 (25). No gain is to be chosen, nothing
drifts. Plain floats, complex numbers, NumPy, Numba, JAX and heyoka take the same source.

State y (14): x, y, theta, theta_1, theta_2, d_t1, d_t2, the two integrals of (39), and the rates of
the first five. Parameters c (35): `PARAMETERS`. Inputs u (5): theta_1^d, theta_2^d, F_x, F_y and
the moment.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from .. import _core
from ..scene.parts import refuse_others
from ..scene.scene import Scene
from ..support import checks

STATES = 14


def _of(side: str) -> tuple[str, ...]:
    finger = ("length", "root_offset", "half_thickness", "mass", "inertia")
    tip: tuple[str, ...] = ("radius", "youngs_modulus", "normal_viscosity", "tangential_viscosity")
    tip += ("tilt_coupling", "normal_mass", "tangential_mass")
    return (
        *(f"hand.{side}.{name}" for name in finger),
        *(f"hand.tip.{side}.{name}" for name in tip),
        *(f"control.{side}.{name}" for name in ("kp", "kd", "ki")),
    )


# Paths of the parameters c in their order, fifteen of each finger, four of the object, and g.
PARAMETERS = (
    *(*_of("right"), *_of("left")),
    *("grasped.width", "grasped.mass", "grasped.inertia", "grasped.com_offset", "gravity"),
)
# The parameters of the forces that act on a hand at rest without inputs.
_FORCES = ("youngs_modulus", "viscosity", "kp", "kd", "ki", "gravity")


class Equations(NamedTuple):
    """The equations of motion; every function returns a tuple.

    Attributes:
        rates: (y, c, u) -> the rates of y (14).
        followers: (y, c) -> d_n1, d_n2, the rates of both, the rates of d_t1 and d_t2 (6).
        multipliers: (y, c, u) -> lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N (4), N.
    """

    rates: Callable[..., Any]
    followers: Callable[..., Any]
    multipliers: Callable[..., Any]


def parameters(scene: Scene) -> tuple[float, ...]:
    """The scene's numbers in the order of `PARAMETERS` (35,), SI."""
    checks.instance("scene", scene, Scene)
    refuse_others(scene, "a reference solution")
    numbers = dict(zip(_core.PARAMETERS, scene.parameters().tolist(), strict=True))
    return tuple(numbers[name] for name in PARAMETERS)


def right_hand_side(
    sin: Callable[[Any], Any] = math.sin,
    cos: Callable[[Any], Any] = math.cos,
    compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = lambda f: f,
) -> Equations:
    """The equations of motion in terms of a sine, a cosine, sums, products and quotients.

    Args:
        sin, cos: The sine and the cosine of one number of the states' type.
        compiled: A decorator for each function, such as `numba.njit`.
    """
    for name, function in (("sin", sin), ("cos", cos), ("compiled", compiled)):
        checks.function(name, function)

    @compiled
    def contact(s, k, y, f, face, cosine, sine):  # type: ignore[no-untyped-def]
        """Finger k's rows of Phi (25) in the object's frame, b = (rate of Phi) p, d_n and rates."""
        length, half, r = f[0], f[2], f[5]
        angle, turn, rate = y[3 + k], y[11], y[12 + k]
        u, v = y[9] * cosine + y[10] * sine, y[10] * cosine - y[9] * sine
        sin_a, cos_a = sin(angle), cos(angle)
        # r_i, from the tip's centre (7, 8) to the centre of gravity; turned, (X_i, G_i) of (11).
        x = y[0] - s * (length * sin_a + half * cos_a - f[1])
        z = y[1] - (length * cos_a - half * sin_a)
        x, g = x * cosine + z * sine, z * cosine - x * sine
        # C^H = 0 (9).
        d_n = r + face - s * x
        # sin and cos of theta_p by the addition theorem, which saves two sines.
        sin_p, cos_p = sin_a * cosine + s * cos_a * sine, cos_a * cosine - s * sin_a * sine
        normal, across = length * sin_p + half * cos_p, length * cos_p - half * sin_p
        # A_i, B_i, E_i and F_i; E_i is the constant of (30).
        a, b, e, h = s * g, -across, -s * face, normal + r - d_n
        d_n_rate = -(s * u + a * turn + b * rate)
        d_t_rate = -(v + e * turn + h * rate)
        g_rate, x_rate = v - x * turn + normal * rate, u + g * turn - s * across * rate
        tilt_rate = rate + s * turn
        bias_h = s * (v + g_rate) * turn + normal * tilt_rate * rate
        bias_n = -(u + x_rate + s * d_n_rate) * turn + (across * tilt_rate - d_n_rate) * rate
        shape = (d_n, sin_p / cos_p, 1.0 / cos_p, sin_a)
        return (a, b, e, h), (d_n_rate, d_t_rate), (bias_h, bias_n), shape

    @compiled
    def loads(s, k, y, f, face, cosine, sine, gravity, target):  # type: ignore[no-untyped-def]
        """Finger k's rows, moments on theta_i and theta, f_d + M_d b of its tip, slip and lag."""
        rows, slip, bias, shape = contact(s, k, y, f, face, cosine, sine)
        d_n, tangent, secant, sin_a = shape
        d_t, stiffness, kappa = y[5 + k], math.pi * f[6], f[9]
        area = (d_n * secant) * (d_n * secant)
        # The gradient of P (5): by theta_p, d_n and d_t; (44) and (45) for the viscosity.
        twist = stiffness * area * (2.0 / 3.0 * d_n * tangent + kappa * d_t)
        press = stiffness * (area + 2.0 * kappa * tangent * d_n * d_t + d_t * d_t)
        shear = stiffness * (kappa * tangent * d_n * d_n + 2.0 * d_n * d_t)
        along_n = f[10] * bias[0] - press - f[7] * slip[0]
        along_t = f[11] * bias[1] - shear - f[8] * slip[1]
        lag = y[3 + k] - target
        # (39), and the finger's weight by (16).
        torque = -f[12] * lag - f[13] * y[12 + k] - f[14] * y[7 + k]
        torque = torque - twist + f[3] * gravity * f[0] * sin_a
        return rows, (torque, -s * twist), (along_n, along_t), slip[1], lag

    @compiled
    def finger(s, k, y, f, face, cosine, sine, gravity, target):  # type: ignore[no-untyped-def]
        """Finger k's share of the 3 x 3 system of (u', v', theta''), its own angle eliminated."""
        rows, acting, tip, slip, lag = loads(s, k, y, f, face, cosine, sine, gravity, target)
        a, b, e, h = rows
        m_n, m_t = f[10], f[11]
        torque = acting[0] - (b * tip[0] + h * tip[1])
        # The arrow's shaft: the row of theta_i in M_5 + Phi_5^T M_d Phi_5, and its pivot.
        row_u, row_v, row_w = m_n * s * b, m_t * h, m_n * a * b + m_t * e * h
        pivot = 1.0 / (f[4] + m_n * b * b + m_t * h * h)
        share_u, share_v, share_w = row_u * pivot, row_v * pivot, row_w * pivot
        matrix = (
            m_n - row_u * share_u,
            -row_u * share_v,
            m_n * s * a - row_u * share_w,
            m_t - row_v * share_v,
            m_t * e - row_v * share_w,
            m_n * a * a + m_t * e * e - row_w * share_w,
        )
        right = (
            -s * tip[0] - share_u * torque,
            -tip[1] - share_v * torque,
            acting[1] - (a * tip[0] + e * tip[1]) - share_w * torque,
        )
        return matrix, right, (share_u, share_v, share_w, torque * pivot), slip, lag

    @compiled
    def rates(y, c, u):  # type: ignore[no-untyped-def]
        """The rates of y; (M_5 + Phi_5^T M_d Phi_5) v' = f_5 - Phi_5^T (f_d + M_d b)."""
        cosine, sine = cos(y[2]), sin(y[2])
        face1, face2, gravity = 0.5 * c[30] - c[33], 0.5 * c[30] + c[33], c[34]
        one, two = c[0:15], c[15:30]
        m1, r1, back1, slip1, lag1 = finger(-1.0, 0, y, one, face1, cosine, sine, gravity, u[0])
        m2, r2, back2, slip2, lag2 = finger(1.0, 1, y, two, face2, cosine, sine, gravity, u[1])
        force_x, force_y = u[2], u[3] - c[31] * gravity
        uu, uv, uw = c[31] + m1[0] + m2[0], m1[1] + m2[1], m1[2] + m2[2]
        vv, vw, ww = c[31] + m1[3] + m2[3], m1[4] + m2[4], c[32] + m1[5] + m2[5]
        ru = r1[0] + r2[0] + force_x * cosine + force_y * sine
        rv = r1[1] + r2[1] + force_y * cosine - force_x * sine
        rw = r1[2] + r2[2] + u[4]
        # L D L^T of the symmetric 3 x 3.
        inverse = 1.0 / uu
        l_v, l_w = uv * inverse, uw * inverse
        vv, vw, ww = vv - l_v * uv, vw - l_v * uw, ww - l_w * uw
        rv, rw = rv - l_v * ru, rw - l_w * ru
        l_vw = vw / vv
        w = (rw - l_vw * rv) / (ww - l_vw * vw)
        v = rv / vv - l_vw * w
        across = ru * inverse - l_v * v - l_w * w
        a1 = back1[3] - back1[0] * across - back1[1] * v - back1[2] * w
        a2 = back2[3] - back2[0] * across - back2[1] * v - back2[2] * w
        moves = (y[9], y[10], y[11], y[12], y[13], slip1, slip2, lag1, lag2)
        return (*moves, across * cosine - v * sine, across * sine + v * cosine, w, a1, a2)

    @compiled
    def followers(y, c):  # type: ignore[no-untyped-def]
        cosine, sine = cos(y[2]), sin(y[2])
        half, off = 0.5 * c[30], c[33]
        _, slip1, _, shape1 = contact(-1.0, 0, y, c[0:15], half - off, cosine, sine)
        _, slip2, _, shape2 = contact(1.0, 1, y, c[15:30], half + off, cosine, sine)
        return shape1[0], shape2[0], slip1[0], slip2[0], slip1[1], slip2[1]

    @compiled
    def multipliers(y, c, u):  # type: ignore[no-untyped-def]
        """lambda = -M_d (Phi_5 v' + b) - f_d."""
        cosine, sine = cos(y[2]), sin(y[2])
        half, off, gravity = 0.5 * c[30], c[33], c[34]
        one, two = c[0:15], c[15:30]
        k1, _, tip1, _, _ = loads(-1.0, 0, y, one, half - off, cosine, sine, gravity, u[0])
        k2, _, tip2, _, _ = loads(1.0, 1, y, two, half + off, cosine, sine, gravity, u[1])
        rate = rates(y, c, u)
        across, v = rate[9] * cosine + rate[10] * sine, rate[10] * cosine - rate[9] * sine
        w, a1, a2 = rate[11], rate[12], rate[13]
        return (
            -one[10] * (-across + k1[0] * w + k1[1] * a1) - tip1[0],
            -two[10] * (across + k2[0] * w + k2[1] * a2) - tip2[0],
            -one[11] * (v + k1[2] * w + k1[3] * a1) - tip1[1],
            -two[11] * (v + k2[2] * w + k2[3] * a2) - tip2[1],
        )

    return Equations(rates, followers, multipliers)


def carried(y: Any, c: Any, u: Any, functions: Any = math) -> tuple[Any, Any, Any]:
    """States, parameters and inputs of a hand at rest on which a moving hand's forces act.

    u (10) has after the five inputs the acceleration of the frame along fixed axes, its tilt, and
    the two derivatives of the tilt. The forces are those of docs/moving-hand.md, gravity included.
    Those on a finger are put into the integral of (39), which no other term contains. `functions`
    has sine and cosine. Five inputs are returned as they are.
    """
    if len(u) == 5:
        return y, c, u
    *inputs, accelerates_x, accelerates_y, phi, omega, turn = u
    sine, cosine = functions.sin(phi), functions.cos(phi)
    along = accelerates_x * cosine + (accelerates_y + c[34]) * sine
    upward = (accelerates_y + c[34]) * cosine - accelerates_x * sine
    force_x = inputs[2] * cosine + inputs[3] * sine
    force_y = inputs[3] * cosine - inputs[2] * sine
    force_x = force_x - c[31] * (along - turn * y[1] - 2 * omega * y[10] - omega**2 * y[0])
    force_y = force_y - c[31] * (upward + turn * y[0] + 2 * omega * y[9] - omega**2 * y[1])
    y, c = [*y], [*c]
    for k, s in ((0, -1.0), (1, 1.0)):
        length, root, _, mass, inertia, *_, ki = c[15 * k : 15 * k + 15]
        lever, sin_a, cos_a = mass * length, functions.sin(y[3 + k]), functions.cos(y[3 + k])
        torque = lever * (upward * sin_a - s * along * cos_a) - omega**2 * lever * root * cos_a
        torque = torque + s * turn * (inertia - lever * root * sin_a)
        y[7 + k], c[15 * k + 14] = ki * y[7 + k] - torque, 1.0
    c[34] = 0.0
    moment = inputs[4] - c[32] * turn
    return tuple(y), tuple(c), (inputs[0], inputs[1], force_x, force_y, moment)


def jump(y: list[float], c: tuple[float, ...], impulse: tuple[float, ...]) -> list[float]:
    """The state just after an ideal impulse (J_x, J_y, J_theta), N s and N m s.

    The velocities change by the accelerations that a force J alone gives to a hand at rest.
    """
    alone = tuple(
        0.0 if any(name.endswith(force) for force in _FORCES) else value
        for name, value in zip(PARAMETERS, c, strict=True)
    )
    still = [*y[:9], 0.0, 0.0, 0.0, 0.0, 0.0]
    change = PLAIN.rates(still, alone, (0.0, 0.0, *impulse))[9:]
    return [*y[:9], *(p + more for p, more in zip(y[9:], change, strict=True))]


# The equations for floats.
PLAIN = right_hand_side()
