"""The stiffness of a grasp: beside a formula by hand, and beside simulations that settle."""

from dataclasses import replace

import numpy as np
import pytest

import scenes
import softpinch as sp

# Of forces, N, and moments, N m, that move the object by about a micrometre.
PUSH, TURN = 2e-2, 2e-5


def upright(angle: float, coupling: float = 1.0) -> sp.Scene:
    """A mirror-symmetric hand whose fingers hold an upright object at this angle."""
    return sp.Scene(
        hand=sp.Hand(tip=sp.Fingertip(tilt_coupling=coupling)),
        schedule=sp.Schedule.steps([0.0], [[angle, angle]]),
    )


def by_hand(scene: sp.Scene, q: np.ndarray) -> np.ndarray:
    """The stiffness of an upright symmetric grasp.

    Let e(d, t, p) be the energy (5) of a tip, d its compression, t its shear and p its tilt. The
    fingers are held. Along ways without slip, with s = (-1)^i, W the width, C and S cosine and sine
    of theta, and G = -r_x S + r_y C (11), the derivatives by (x, y, theta) are

        D d = (-s C, -s S, -s G),   D t = (S, -C, s W / 2),   D p = (0, 0, s),

    by (9), (12) with (30), and the definition of the tilt. The gradient of V = e_1 + e_2 + M g y is
    D_a V = sum of e_d D_a d + e_t D_a t + e_p D_a p + M g [a = y], and the stiffness is its
    derivative, K_ab = D_b D_a V. Beside the quadratic form of the second derivatives of e it has
    the terms e_d D_b D_a d and e_t D_b D_a t, of which the following are not zero at theta = 0:

        D_theta D_y d = D_y D_theta d = -s,   D_theta D_theta d = a - d + W / 2,
        D_theta D_x t = 1, but D_x D_theta t = 0.

    D G / D theta = -X (29) gives the second one, and the last line is why K is not symmetric. Both
    tips have the same d, t and p, so that terms odd in s cancel: x and theta are not coupled to y.
    With G = y - L cos(p) + d_f sin(p), the pressing force e_d = lambda^H and e_t = M g / 2:

        K_xx = 2 e_dd,   K_yy = 2 e_tt = 4 pi E d,
        K_x theta = 2 G e_dd - W e_dt - 2 e_dp + M g,   K_theta x = the same without M g,
        K_theta theta = 2 (G^2 e_dd + W^2 e_tt / 4 + e_pp - G W e_dt - 2 G e_dp + W e_tp)
                        + 2 e_d (a - d + W / 2).
    """
    tip, finger, grasped = scene.hand.tip, scene.hand.right, scene.grasped
    assert isinstance(tip, sp.Fingertip)
    d, t, p = q[5], q[7], q[3]
    tan, c = np.tan(p), 1.0 / np.cos(p) ** 2
    kappa, unit, width = tip.tilt_coupling, np.pi * tip.youngs_modulus, grasped.width
    e_d = unit * (d**2 * c + 2 * kappa * d * t * tan + t**2)
    e_dd = unit * (2 * d * c + 2 * kappa * t * tan)
    e_tt = unit * 2 * d
    e_dt = unit * (2 * kappa * d * tan + 2 * t)
    e_dp = unit * (2 * d**2 * c * tan + 2 * kappa * d * t * c)
    e_tp = unit * kappa * d**2 * c
    e_pp = unit * (d**3 / 3 * (2 * c**2 + 4 * c * tan**2) + 2 * kappa * d**2 * t * c * tan)
    height = q[1] - finger.length * np.cos(p) + finger.half_thickness * np.sin(p)
    both = 2 * height * e_dd - width * e_dt - 2 * e_dp
    turn = height**2 * e_dd + width**2 * e_tt / 4 + e_pp
    turn += -height * width * e_dt - 2 * height * e_dp + width * e_tp
    turn += e_d * (tip.radius - d + width / 2)
    weight = grasped.mass * scene.gravity
    return np.array([[2 * e_dd, 0, both + weight], [0, 2 * e_tt, 0], [both, 0, 2 * turn]])


@pytest.mark.parametrize("grip", [0.0, 0.004, -0.007])
@pytest.mark.parametrize("coupling", [1.0, 0.0, -1.0])
@pytest.mark.parametrize("angle", [0.04, 0.105, 0.2])
def test_an_upright_symmetric_grasp_has_the_stiffness_derived_by_hand(
    angle: float, coupling: float, grip: float
) -> None:
    scene = upright(angle, coupling)
    found = sp.equilibrium(scene, grip=(grip, grip))
    assert found.state is not None
    np.testing.assert_allclose(found.state.q[[0, 2]], 0.0, atol=1e-15)
    expected = by_hand(scene, found.state.q)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found.stiffness / scale, expected / scale, rtol=0, atol=1e-12)


def held(scene: sp.Scene, angles: tuple[float, float]) -> sp.Scene:
    """The scene with driven fingers that stand at these angles, deg."""
    schedule = sp.Schedule.minimum_jerk([0.0], np.deg2rad([angles]), move_time=1.0)
    return replace(scene, fingers="driven", schedule=schedule, initial=None)


HELD = {
    "upright": held(sp.Scene(), (6, 6)),
    "turned": held(sp.Scene(), (-6, 18)),
    "uneven": held(scenes.uneven(), (7, 6)),
}


@pytest.mark.parametrize("name", HELD)
def test_the_stiffness_is_that_of_simulations_that_settle_under_small_forces(name: str) -> None:
    scene = HELD[name]
    rest = sp.equilibrium(scene)
    assert rest.state is not None and rest.stable
    # Until the slowest motion has decayed to 1e-12 of the way.
    duration = 28.0 / np.abs(rest.eigenvalues[2:].real).min()
    start = replace(rest.state, time=0.0)
    sizes, displacements = np.array([PUSH, PUSH, TURN]), np.empty((3, 3))
    for k, size in enumerate(sizes):
        ends = []
        for way in (1.0, -1.0):
            x, y, moment = way * size * np.eye(3)[k]
            push = sp.Step(time=0.0, force=(x, y), moment=moment)
            pushed = replace(scene, disturbances=(push,), initial=start, duration=duration)
            run = sp.simulate(pushed, dt=5e-4, formulation="nullspace", every=100_000)
            assert run.success
            ends.append(run.q[-1, :3])
        displacements[:, k] = (ends[0] - ends[1]) / (2.0 * size)
    compliance = np.linalg.inv(rest.stiffness)
    scale = np.sqrt(np.outer(np.diag(compliance), np.diag(compliance)))
    np.testing.assert_allclose(displacements / scale, compliance / scale, rtol=0, atol=1e-7)
    # Precise enough to see that it is not symmetric.
    skew = np.linalg.inv(displacements) - np.linalg.inv(displacements).T
    carried = rest.multipliers[2:].sum()
    assert skew[0, 2] == pytest.approx(carried * np.cos(rest.state.q[2]), rel=2e-3)
