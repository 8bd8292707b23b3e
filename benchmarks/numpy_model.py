"""The paper's system as one would write it in NumPy for `solve_ivp`: (24), block-solved.

For equal fingers. `terms` is written so that Numba takes it, too.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from null_space import INPUTS, by_pieces, scipy_end

Floats = NDArray[np.float64]
SIGN = np.array([-1.0, 1.0])
# How large each of (q, p, integral) gets: lengths, angles, speeds and rates differ by decades, and
# so must what is negligible of each.
SIZE = np.array(
    [0.02, 0.08, 0.2, 0.2, 0.2, *(4 * [8e-3]), 0.3, 0.3, 3, 6, 6, *(4 * [0.3]), 0.01, 0.01]
)


def numbers(scene: sp.Scene, alpha: float, beta: float) -> Floats:
    """Parameters of `terms`: the scene's, and the gains of (19) and (20).

    Raises:
        ValueError: The fingers differ.
    """
    finger, tip, body, pid = scene.hand.right, scene.hand.tip, scene.grasped, scene.control
    if finger != scene.hand.left or isinstance(tip, tuple) or isinstance(pid, tuple):
        raise ValueError("this model is of equal fingers")
    m_n = body.mass if tip.normal_mass is None else tip.normal_mass
    m_t = body.mass if tip.tangential_mass is None else tip.tangential_mass
    geometry = (finger.length, finger.half_thickness, finger.root_offset, tip.radius)
    masses = [body.mass, body.mass, body.inertia, finger.inertia, finger.inertia]
    return np.array(
        [
            *(*geometry, np.pi * tip.youngs_modulus, tip.tilt_coupling, finger.mass),
            *(tip.normal_viscosity, tip.tangential_viscosity, body.width, body.com_offset),
            *(pid.kp, pid.kd, pid.ki, scene.gravity, alpha, beta),
            *(*masses, m_n, m_n, m_t, m_t),
        ]
    )


def terms(q, p, integral, u, c):  # type: ignore[no-untyped-def]
    """Masses (9,), Phi (4, 9), force (9,) and gamma (4,) of (24); u as null_space's `INPUTS`."""
    length, half, offset, a, stiffness, kappa, finger_mass = (
        c[0],
        c[1],
        c[2],
        c[3],
        c[4],
        c[5],
        c[6],
    )
    c_n, c_t, width, com, kp, kd, ki, gravity = c[7], c[8], c[9], c[10], c[11], c[12], c[13], c[14]
    alpha, beta, masses = c[15], c[16], c[17:26]
    face = width / 2 + SIGN * com
    theta, angle, d_n, d_t = q[2], q[3:5], q[5:7], q[7:9]
    cos, sin = np.cos(theta), np.sin(theta)
    tilt, tilt_rate = angle + SIGN * theta, p[3:5] + SIGN * p[2]
    cos_t, sin_t = np.cos(tilt), np.sin(tilt)
    normal, across = length * sin_t + half * cos_t, length * cos_t - half * sin_t
    # Tip centres (7, 8) and where the centre of gravity is from them, in the object's frame.
    ox = SIGN * (-offset + length * np.sin(angle) + half * np.cos(angle))
    oy = length * np.cos(angle) - half * np.sin(angle)
    x, g = (q[0] - ox) * cos + (q[1] - oy) * sin, (q[1] - oy) * cos - (q[0] - ox) * sin
    along, up = p[0] * cos + p[1] * sin, p[1] * cos - p[0] * sin

    phi = np.zeros((4, 9))
    phi[:2, 0], phi[:2, 1], phi[2:, 0], phi[2:, 1] = SIGN * cos, SIGN * sin, -sin, cos
    phi[:2, 2], phi[2:, 2] = SIGN * g, -x + SIGN * (a - d_n)
    phi[0, 3], phi[1, 4] = -across[0], -across[1]
    phi[2, 3], phi[3, 4] = normal[0] + (a - d_n[0]), normal[1] + (a - d_n[1])
    phi[:, 5:] = np.eye(4)
    drift = phi @ p
    g_rate = up - x * p[2] + normal * p[3:5]
    x_rate = along + g * p[2] - SIGN * across * p[3:5]
    gamma = np.empty(4)
    gamma[:2] = SIGN * (up + g_rate) * p[2] + normal * tilt_rate * p[3:5]
    gamma[:2] += 2 * alpha * drift[:2] + alpha**2 * (SIGN * x - (a - d_n) - face)
    gamma[2:] = -(along + x_rate + SIGN * p[5:7]) * p[2]
    gamma[2:] += (across * tilt_rate - p[5:7]) * p[3:5] + beta * drift[2:]

    tangent = sin_t / cos_t
    area = (d_n / cos_t) ** 2
    twist = stiffness * area * (2 / 3 * d_n * tangent + kappa * d_t)
    coupling = kappa * tangent
    force = np.empty(9)
    force[0], force[1] = u[2], u[3] - masses[0] * gravity
    force[2] = u[4] - (SIGN * twist).sum()
    torque = -kp * (angle - u[:2]) - kd * p[3:5] - ki * integral
    force[3:5] = torque - twist + finger_mass * gravity * length * np.sin(angle)
    force[5:7] = -stiffness * (area + 2 * coupling * d_n * d_t + d_t**2) - c_n * p[5:7]
    force[7:] = -stiffness * (coupling * d_n**2 + 2 * d_n * d_t) - c_t * p[7:]
    return masses, phi, force, gamma


def right_hand_side(scene: sp.Scene, alpha: float, beta: float) -> Callable[..., Any]:
    """f(t, y, u) for y = (q, p, integral); u as null_space's `INPUTS`."""
    c = numbers(scene, alpha, beta)

    def derivative(t: float, y: Floats, u: Floats) -> Floats:
        p = y[9:18]
        masses, phi, force, gamma = terms(y[:9], p, y[18:], u, c)
        weighted = phi / masses
        multipliers = np.linalg.solve(weighted @ phi.T, -gamma - weighted @ force)
        return np.concatenate([p, (force + phi.T @ multipliers) / masses, y[3:5] - u[:2]])

    return derivative


def start(scene: sp.Scene) -> Floats:
    """(q, p, integral) (20,)."""
    at = scene.start()
    return np.concatenate([at.q, at.p, at.integral])


def by_scipy(scene: sp.Scene, method: str, alpha: float, beta: float) -> Callable[[float], Floats]:
    """rtol -> (q, p, integral) at the end by `solve_ivp`, which starts anew at each switch."""
    slope = right_hand_side(scene, alpha, beta)

    def advance(y: Floats, c: Floats, duration: float, rtol: float) -> Floats:
        return scipy_end(slope, y, duration, method, rtol, SIZE, c[-len(INPUTS) :])

    return by_pieces(scene, start(scene), advance)
