"""Linear models without the core: the independent Python equations, with the complex step.

A function f of real numbers has the derivative Im f(x + ih) / h, without cancellation, so h can be
so small that nothing is left of the second order: exact to round-off.
"""

import cmath
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from softpinch.accuracy import null_space

Floats = NDArray[np.float64]
STEP = 1e-40
EVERY_OUTPUT = (
    *("pose", "fingers", "compressions", "shears"),
    *("multipliers", "torque", "rates"),
)
_EQUATIONS = null_space.right_hand_side(cmath.sin, cmath.cos)
# The places of a model's states among those of the equations.
_ORDER = [0, 1, 2, 3, 4, 9, 10, 11, 12, 13, 5, 6, 7, 8]
_GAINS = [12, 13, 14, 27, 28, 29]


def actuated(scene: sp.Scene, law: str) -> Callable[[Any, Any], tuple[list[Any], list[Any]]]:
    """(states, inputs) -> their rates and all outputs, of fingers that a PID or torques turn."""
    c = list(null_space.parameters(scene))
    if law == "torque":
        # A PID with K_P = 1 alone gives the torque that the target exceeds the angle by.
        for k, gain in zip(_GAINS, [1.0, 0.0, 0.0] * 2, strict=True):
            c[k] = gain

    def evaluate(x: Any, u: Any) -> tuple[list[Any], list[Any]]:
        y: list[Any] = [0.0] * 14
        for place, value in zip(_ORDER, x, strict=False):
            y[place] = value
        targets = [u[i] + y[3 + i] for i in range(2)] if law == "torque" else u[:2]
        inputs = (*targets, *u[2:])
        # Tuples, since the equations take slices of them.
        rates = _EQUATIONS.rates(tuple(y), tuple(c), inputs)
        d_n1, d_n2, *_ = _EQUATIONS.followers(tuple(y), tuple(c))
        torque = [
            -c[12 + 15 * i] * (y[3 + i] - targets[i])
            - c[13 + 15 * i] * y[12 + i]
            - c[14 + 15 * i] * y[7 + i]
            for i in range(2)
        ]
        multipliers = _EQUATIONS.multipliers(tuple(y), tuple(c), inputs)
        outputs = [*y[:5], d_n1, d_n2, *y[5:7], *multipliers, *torque, *y[9:]]
        return [rates[place] for place in _ORDER[: len(x)]], outputs

    return evaluate


def driven(scene: sp.Scene) -> Callable[[Any, Any], tuple[list[Any], list[Any]]]:
    """The same of driven fingers: torques are found that give them the wanted accelerations."""
    fed = actuated(scene, "torque")

    def evaluate(x: Any, u: Any) -> tuple[list[Any], list[Any]]:
        angles, rates, wanted, force = u[:2], u[2:4], u[4:6], u[6:]
        full = [*x[:3], *angles, *x[3:6], *rates, *x[6:8]]

        def acceleration(*torque: Any) -> NDArray[Any]:
            return np.array(fed(full, [*torque, *force])[0][8:10])

        # They are linear in the torques.
        free = acceleration(0.0, 0.0)
        per_torque = np.array([acceleration(1.0, 0.0) - free, acceleration(0.0, 1.0) - free]).T
        torque = np.linalg.solve(per_torque, np.array(wanted) - free)
        moved, outputs = fed(full, [*torque, *force])
        return [*moved[:3], *moved[5:8], *moved[10:12]], outputs

    return evaluate


def linearized(scene: sp.Scene, law: str, x: Floats, u: Floats) -> tuple[Any, Any, Floats]:
    """Rates and outputs at these states and inputs, and their derivatives [[A, B], [C, D]].

    `law` moves the fingers, whatever the scene says.
    """
    evaluate = driven(scene) if law == "driven" else actuated(scene, law)
    point = np.concatenate([x, u]).astype(complex)
    columns = []
    for k in range(len(point)):
        moved = point.copy()
        moved[k] += 1j * STEP
        rates, outputs = evaluate(moved[: len(x)].tolist(), moved[len(x) :].tolist())
        columns.append(np.imag([*rates, *outputs]) / STEP)
    return np.real(rates), np.real(outputs), np.transpose(columns)


def whole(model: sp.LinearModel) -> Floats:
    """[[A, B], [C, D]] of a model."""
    return np.block([[model.A, model.B], [model.C, model.D]])


def sizes(scene: sp.Scene, units: tuple[str, ...]) -> Floats:
    """Typical magnitudes of quantities with these units, by `Motion::typical_magnitudes`."""
    tips = scene.hand.tips
    length = max(tip.radius for tip in tips)
    stiffness = max(tip.youngs_modulus for tip in tips) * length
    pace = float(np.sqrt(stiffness / scene.grasped.mass))
    force = stiffness * length
    known = {
        **{"m": length, "rad": 1.0, "rad s": 1.0 / pace, "N": force, "N m": force * length},
        **{"m/s": length * pace, "rad/s": pace, "rad/s^2": pace**2},
    }
    return np.array([known[unit] for unit in units])


def off(ours: Floats, theirs: Floats, columns: Floats) -> float:
    """The largest difference, each as a share of the largest effect on its row.

    The effect of a column is its entry times its typical magnitude, `columns`.
    """
    effect = np.abs(theirs * columns)
    largest = effect.max(axis=1, keepdims=True)
    difference = np.abs((ours - theirs) * columns)
    return float(np.max(difference / np.where(largest == 0.0, 1.0, largest)))


def inputs_of(law: str, scene: sp.Scene) -> tuple[str, ...]:
    """Every group of inputs of a scene that is linearised with this law."""
    return ("targets" if law == scene.law else "torque", "force")
