"""The paper's system as one would write it in NumPy for `solve_ivp`: (24), block-solved."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import softpinch as sp

Floats = NDArray[np.float64]
SIGN = np.array([-1.0, 1.0])


def right_hand_side(
    scene: sp.Scene, alpha: float, beta: float
) -> Callable[[float, Floats, Floats], Floats]:
    """f(t, y, target) for y = (q, p, integral), of equal fingers without disturbances."""
    finger, tip, body, pid = scene.hand.right, scene.hand.tip, scene.grasped, scene.control
    assert isinstance(tip, sp.Fingertip)
    assert isinstance(pid, sp.Pid)
    length, half, offset = finger.length, finger.half_thickness, finger.root_offset
    a, stiffness = tip.radius, np.pi * tip.youngs_modulus
    tip_mass = body.mass
    masses = np.array(
        [body.mass, body.mass, body.inertia, finger.inertia, finger.inertia] + 4 * [tip_mass]
    )
    face = body.width / 2 + SIGN * body.com_offset
    drag = np.repeat([tip.normal_viscosity, tip.tangential_viscosity], 2)
    gravity = scene.gravity

    def derivative(t: float, y: Floats, target: Floats) -> Floats:
        q, p, integral = y[:9], y[9:18], y[18:]
        theta, angle, d_n, d_t = q[2], q[3:5], q[5:7], q[7:9]
        cos, sin = np.cos(theta), np.sin(theta)
        tilt, tilt_rate = angle + SIGN * theta, p[3:5] + SIGN * p[2]
        cos_t, sin_t = np.cos(tilt), np.sin(tilt)
        normal, across = length * sin_t + half * cos_t, length * cos_t - half * sin_t
        # Tip centres (7, 8) and where the centre of gravity is from them, in the object's frame.
        ox = SIGN * (-offset + length * np.sin(angle) + half * np.cos(angle))
        oy = length * np.cos(angle) - half * np.sin(angle)
        x, g = (q[0] - ox) * cos + (q[1] - oy) * sin, (q[1] - oy) * cos - (q[0] - ox) * sin
        u, v = p[0] * cos + p[1] * sin, p[1] * cos - p[0] * sin

        phi = np.zeros((4, 9))
        phi[:2, 0], phi[:2, 1], phi[2:, 0], phi[2:, 1] = SIGN * cos, SIGN * sin, -sin, cos
        phi[:2, 2], phi[2:, 2] = SIGN * g, -x + SIGN * (a - d_n)
        phi[[0, 1], [3, 4]], phi[[2, 3], [3, 4]] = -across, normal + (a - d_n)
        phi[:, 5:] = np.eye(4)
        drift = phi @ p
        g_rate = v - x * p[2] + normal * p[3:5]
        x_rate = u + g * p[2] - SIGN * across * p[3:5]
        bias_h = SIGN * (v + g_rate) * p[2] + normal * tilt_rate * p[3:5]
        bias_n = -(u + x_rate + SIGN * p[5:7]) * p[2] + (across * tilt_rate - p[5:7]) * p[3:5]
        holonomic = SIGN * x - (a - d_n) - face
        gamma_h = bias_h + 2 * alpha * drift[:2] + alpha**2 * holonomic
        gamma = np.concatenate([gamma_h, bias_n + beta * drift[2:]])

        tangent = sin_t / cos_t
        area = (d_n / cos_t) ** 2
        twist = stiffness * area * (2 / 3 * d_n * tangent + tip.tilt_coupling * d_t)
        coupling = tip.tilt_coupling * tangent
        press = stiffness * (area + 2 * coupling * d_n * d_t + d_t**2)
        shear = stiffness * (coupling * d_n**2 + 2 * d_n * d_t)
        torque = -pid.kp * (angle - target) - pid.kd * p[3:5] - pid.ki * integral
        force = np.empty(9)
        force[:3] = 0.0, -body.mass * gravity, -(SIGN * twist).sum()
        force[3:5] = torque - twist + finger.mass * gravity * length * np.sin(angle)
        force[5:] = -np.concatenate([press, shear]) - drag * p[5:]

        weighted = phi / masses
        multipliers = np.linalg.solve(weighted @ phi.T, -gamma - weighted @ force)
        return np.concatenate([p, (force + phi.T @ multipliers) / masses, angle - target])

    return derivative
