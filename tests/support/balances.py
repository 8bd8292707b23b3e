"""The balance of forces of an object at rest, from `sp.evaluate`, for general solvers."""

import numpy as np

import softpinch as sp

Floats = np.ndarray
# x, y, theta, d_t1 and d_t2 in q: what the balance and the grips determine while the fingers stand.
UNKNOWNS = [0, 1, 2, 7, 8]
# What is divided out of them.
SIZES = np.array([1e-2, 1e-2, 1.0, 1e-2, 1e-2])


def left_over(
    scene: sp.Scene, grip: Floats, z: Floats, push: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """What the balance (3) and the grips (2) lack, with a force beside those of the scene.

    Args:
        scene: The scene, whose fingers stand at their first targets.
        grip: The wanted grips (2,), m.
        z: The unknowns in parts of their sizes (5,).
        push: The force in x and y, N.
    """
    x, y, theta, *shear = z * SIZES
    angles = scene.schedule.angles[0]
    state = sp.State.consistent(scene, x=x, y=y, rotation=theta, fingers=angles, shear=shear)
    terms = sp.evaluate(scene, 0.0, state.q, state.p, formulation="nullspace")
    forces = terms.forces.total
    balance = forces[:3] - terms.constraint_matrix[:, :3].T @ forces[5:] + [*push, 0.0]
    grips = []
    for i, sign in enumerate((-1.0, 1.0)):
        place = sign * terms.constraint_matrix[i, 2]
        tilt = state.q[3 + i] + sign * theta
        grips.append(place + (scene.hand.tips[i].radius - state.q[5 + i]) * tilt + state.q[7 + i])
    return np.array([*(balance / [10.0, 10.0, 0.1]), *((np.array(grips) - grip) / 1e-2)])
