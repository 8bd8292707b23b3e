"""A scene that is stepped from outside, under pushes of all kinds."""

import numpy as np

import softpinch as sp

PERIOD, DT = 1e-3, 2e-4
PUSHES = (
    sp.Noise(force_std=0.5, moment_std=0.01, rate_hz=700.0),
    sp.Impulse(time=0.012, impulse=(0.02, 0.0)),
    sp.Sine(frequency_hz=30.0, force=(2.0, 1.0)),
)
SCENE = sp.Scene(control=sp.Torque(), disturbances=PUSHES, duration=0.03)


def torques(periods: int, seed: int = 0) -> np.ndarray:
    """Torques (periods, 2) about a grip, N m."""
    return 1.2 + 0.1 * np.random.default_rng(seed).standard_normal((periods, 2))
