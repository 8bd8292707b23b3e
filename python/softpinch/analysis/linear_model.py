"""`LinearModel`, the motion for small deviations from an operating point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene.scene import State
from ..support import extras
from ..support.arrays import Floats, read_only
from ..support.result import Result

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LinearModel(Result):
    """Small deviations from an operating point: dx/dt = A x + B u, y = C x + D u.

    States x, inputs u and outputs y are differences from `state_values`, `input_values` and
    `output_values`. If the operating point is no equilibrium, the motion leaves it at the rates
    `state_rates`, and x is the difference from that motion.

    Attributes:
        A: (N, N), the derivatives of the states' rates with respect to the states.
        B: (N, m), the same with respect to the inputs.
        C: (k, N), the derivatives of the outputs with respect to the states.
        D: (k, m), the same with respect to the inputs.
        states: Names of the states (N,); the rate of x is "rate of x".
        inputs: Names of the inputs (m,).
        outputs: Names of the outputs (k,).
        state_units: Units of the states (N,).
        input_units: Units of the inputs (m,).
        output_units: Units of the outputs (k,).
        state_values: The states at the operating point (N,).
        input_values: The inputs at the operating point (m,).
        output_values: The outputs at the operating point (k,).
        state_rates: The rates of the states at the operating point (N,).
        state: The operating point.
        neutral: Rows w, (2, N), of the combinations w x that no motion of the model changes: shear
            plus slip, d_ti + Phi_Ni (x, y, theta, theta_1, theta_2) with the rows N of (25). They
            belong to the two eigenvalues zero. With driven fingers the angles theta_i are inputs:
            w x changes only with them, by B's columns of their rates. (0, N) if the operating
            point moves, where no such combination exists, and in a reduced model.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    state_values: Floats
    input_values: Floats
    output_values: Floats
    state_rates: Floats
    state: State
    neutral: Floats

    @cached_property
    def poles(self) -> Complexes:
        """The eigenvalues of A (N,), 1/s.

        Zeros are those of `neutral`, and one for each integral of a PID with K_I = 0: it drives
        nothing, so the sign of the other poles tells whether the grasp is stable.
        """
        return read_only(np.linalg.eigvals(self.A).astype(complex))

    def to_control(self) -> Any:
        """Converts to a `control.StateSpace` with these names. Needs the extra `control`.

        Raises:
            ImportError: python-control is not installed.
        """
        control = extras.require("control", extra="control", purpose="LinearModel.to_control")
        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        return control.StateSpace(
            *self._matrices(), **{kind: list(own) for kind, own in names.items()}
        )

    def to_scipy(self) -> Any:
        """Converts to a `scipy.signal.StateSpace`, which has no names. Needs the extra `study`.

        Raises:
            ImportError: SciPy is not installed.
        """
        signal = extras.require("scipy.signal", extra="study", purpose="LinearModel.to_scipy")
        return signal.StateSpace(*self._matrices())

    def _matrices(self) -> list[Floats]:
        """The matrices, writable and separate from this model's."""
        return [matrix.copy() for matrix in (self.A, self.B, self.C, self.D)]

    def __repr__(self) -> str:
        """Shows the number of states, the inputs and outputs, and the time on one line."""
        return (
            f"<LinearModel at {self.state.time:.6g} s: {len(self.states)} states, "
            f"{_brief(self.inputs)} -> {_brief(self.outputs)}>"
        )


def _brief(names: tuple[str, ...]) -> str:
    shown = names if len(names) <= 6 else (*names[:2], "...", names[-1])
    return f"({', '.join(shown)})"
