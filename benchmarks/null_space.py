"""The null-space form (14 states), written once for whatever can add, multiply and take a sine.

Numba, JAX and heyoka get the same source: `right_hand_side(sin, cos, compiled)`. For equal fingers
held at constant targets, under a constant push where `pushed` says so. The state is (x, y, theta,
theta_1, theta_2, d_t1, d_t2, the two integrals of (39), and the five rates).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import softpinch as sp

Floats = NDArray[np.float64]
# The order of `parameters`.
NAMES = (
    *("length", "offset", "half", "finger_mass", "finger_inertia", "radius", "stiffness"),
    *("c_n", "c_t", "coupling", "m_n", "m_t", "width", "mass", "inertia", "com"),
    *("kp", "kd", "ki", "gravity", "target_1", "target_2"),
)
# What follows them where the object is pushed.
PUSH = ("force_x", "force_y", "moment")
# How large each state gets: what is negligible of it, for solvers that want to know.
SIZE = np.array([0.02, 0.08, 0.2, 0.2, 0.2, 8e-3, 8e-3, 0.01, 0.01, 0.3, 0.3, 3, 6, 6])


def parameters(scene: sp.Scene) -> Floats:
    """The numbers of `NAMES`; the fingers must be equal and the targets constant."""
    finger, tip, body, pid = scene.hand.right, scene.hand.tip, scene.grasped, scene.control
    assert isinstance(tip, sp.Fingertip) and isinstance(pid, sp.Pid)
    m_n = body.mass if tip.normal_mass is None else tip.normal_mass
    m_t = body.mass if tip.tangential_mass is None else tip.tangential_mass
    elastic = (tip.radius, np.pi * tip.youngs_modulus, tip.normal_viscosity)
    return np.array(
        [
            *(finger.length, finger.root_offset, finger.half_thickness),
            *(finger.mass, finger.inertia, *elastic, tip.tangential_viscosity),
            *(tip.tilt_coupling, m_n, m_t, body.width, body.mass, body.inertia, body.com_offset),
            *(pid.kp, pid.kd, pid.ki, scene.gravity, *np.asarray(scene.schedule.angles)[0]),
        ]
    )


def start(scene: sp.Scene) -> Floats:
    state = scene.start()
    return np.array([*state.q[:5], *state.q[7:], *state.integral, *state.p[:5]])


def right_hand_side(
    sin: Callable[[Any], Any],
    cos: Callable[[Any], Any],
    compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = lambda f: f,
    pushed: bool = False,
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Two functions of (state, parameters): the state's rates (14), and (d_n, its rates) (4).

    `pushed`: the parameters go on with `PUSH`.
    """

    @compiled
    def contact(s, y, c, k, cosine, sine):  # type: ignore[no-untyped-def]
        """Of finger k: its rows of Phi, in the object's frame, and d_n, and how both change."""
        length, half, r = c[0], c[2], c[5]
        angle, u, v = y[3 + k], y[9] * cosine + y[10] * sine, y[10] * cosine - y[9] * sine
        turn, rate = y[11], y[12 + k]
        sin_a, cos_a = sin(angle), cos(angle)
        x = y[0] - s * (length * sin_a + half * cos_a - c[1])
        z = y[1] - (length * cos_a - half * sin_a)
        x, g = x * cosine + z * sine, z * cosine - x * sine
        face = 0.5 * c[12] + s * c[15]
        d_n = r + face - s * x
        # Of theta_p = angle + s theta, by the sum of angles: two sines less.
        sin_p, cos_p = sin_a * cosine + s * cos_a * sine, cos_a * cosine - s * sin_a * sine
        normal, across = length * sin_p + half * cos_p, length * cos_p - half * sin_p
        a, b, e, f = s * g, -across, -s * face, normal + r - d_n
        d_n_rate = -(s * u + a * turn + b * rate)
        d_t_rate = -(v + e * turn + f * rate)
        g_rate, x_rate = v - x * turn + normal * rate, u + g * turn - s * across * rate
        tilt_rate = rate + s * turn
        bias_h = s * (v + g_rate) * turn + normal * tilt_rate * rate
        bias_n = -(u + x_rate + s * d_n_rate) * turn + (across * tilt_rate - d_n_rate) * rate
        return (
            a,
            b,
            e,
            f,
            d_n,
            d_n_rate,
            d_t_rate,
            bias_h,
            bias_n,
            sin_p / cos_p,
            1.0 / cos_p,
            sin_a,
        )

    @compiled
    def finger(s, y, c, k, cosine, sine):  # type: ignore[no-untyped-def]
        """Of finger k: what it adds to the 3 x 3 system once its angle is eliminated, and that."""
        a, b, e, f, d_n, d_n_rate, d_t_rate, bias_h, bias_n, tangent, secant, sin_a = contact(
            s, y, c, k, cosine, sine
        )
        d_t, kappa, m_n, m_t = y[5 + k], c[9], c[10], c[11]
        area = (d_n * secant) * (d_n * secant)
        twist = c[6] * area * (2.0 / 3.0 * d_n * tangent + kappa * d_t)
        press = c[6] * (area + 2.0 * kappa * tangent * d_n * d_t + d_t * d_t)
        shear = c[6] * (kappa * tangent * d_n * d_n + 2.0 * d_n * d_t)
        h = m_n * bias_h - press - c[7] * d_n_rate
        t = m_t * bias_n - shear - c[8] * d_t_rate
        lag = y[3 + k] - c[20 + k]
        torque = -c[16] * lag - c[17] * y[12 + k] - c[18] * y[7 + k]
        torque = torque - twist + c[3] * c[19] * c[0] * sin_a - (b * h + f * t)
        # The arrow's shaft: this angle's row and its pivot.
        row_u, row_v, row_w = m_n * s * b, m_t * f, m_n * a * b + m_t * e * f
        pivot = 1.0 / (c[4] + m_n * b * b + m_t * f * f)
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
            -s * h - share_u * torque,
            -t - share_v * torque,
            -s * twist - (a * h + e * t) - share_w * torque,
        )
        return matrix, right, (share_u, share_v, share_w, torque * pivot), d_t_rate, lag

    @compiled
    def rates(y, c):  # type: ignore[no-untyped-def]
        cosine, sine = cos(y[2]), sin(y[2])
        m1, r1, back1, slip1, lag1 = finger(-1.0, y, c, 0, cosine, sine)
        m2, r2, back2, slip2, lag2 = finger(1.0, y, c, 1, cosine, sine)
        weight = c[13] * c[19]
        uu, uv, uw = c[13] + m1[0] + m2[0], m1[1] + m2[1], m1[2] + m2[2]
        vv, vw, ww = c[13] + m1[3] + m2[3], m1[4] + m2[4], c[14] + m1[5] + m2[5]
        ru, rv, rw = r1[0] + r2[0] - weight * sine, r1[1] + r2[1] - weight * cosine, r1[2] + r2[2]
        if pushed:
            ru, rv = ru + c[22] * cosine + c[23] * sine, rv + c[23] * cosine - c[22] * sine
            rw = rw + c[24]
        # L D L^T of the symmetric 3 x 3.
        inverse = 1.0 / uu
        l_v, l_w = uv * inverse, uw * inverse
        vv, vw, ww = vv - l_v * uv, vw - l_v * uw, ww - l_w * uw
        rv, rw = rv - l_v * ru, rw - l_w * ru
        l_vw = vw / vv
        w = (rw - l_vw * rv) / (ww - l_vw * vw)
        v = rv / vv - l_vw * w
        u = ru * inverse - l_v * v - l_w * w
        a1 = back1[3] - back1[0] * u - back1[1] * v - back1[2] * w
        a2 = back2[3] - back2[0] * u - back2[1] * v - back2[2] * w
        moves = (y[9], y[10], y[11], y[12], y[13], slip1, slip2, lag1, lag2)
        return (*moves, u * cosine - v * sine, u * sine + v * cosine, w, a1, a2)

    @compiled
    def followers(y, c):  # type: ignore[no-untyped-def]
        cosine, sine = cos(y[2]), sin(y[2])
        one = contact(-1.0, y, c, 0, cosine, sine)
        two = contact(1.0, y, c, 1, cosine, sine)
        return one[4], two[4], one[5], two[5], one[6], two[6]

    return rates, followers


def spread(state: Any, c: Floats) -> tuple[Floats, Floats]:
    """The nine coordinates and their rates from the fourteen states."""
    y = [float(value) for value in state]
    d_n1, d_n2, *tips = _FOLLOWERS(y, c.tolist())
    return np.array([*y[:5], d_n1, d_n2, *y[5:7]]), np.array([*y[9:], *tips])


_FOLLOWERS = right_hand_side(np.sin, np.cos)[1]
