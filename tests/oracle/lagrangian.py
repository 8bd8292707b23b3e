"""The equations of motion from first principles: SymPy differentiates, nothing is typed in.

What is written down here is the geometry (7, 8, and the distance of a tip's centre from its face),
the condition of rolling (12), the energies (5, 16) and the dissipation. Generalised forces, mass
matrix, constraint matrix and its rate come out of these by differentiation. Finger 1 is the right
one, s = -1; finger 2 the left, s = +1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from random import Random
from typing import Any

import sympy as sp
from mpmath import mp, mpf

SIDES = (("right", -1), ("left", 1))
COORDINATES = ("x", "y", "theta", "theta1", "theta2", "dn1", "dn2", "dt1", "dt2")

PARAMETERS = (
    *(
        f"hand.{side}.{name}"
        for side, _ in SIDES
        for name in ("length", "root_offset", "half_thickness", "mass", "inertia")
    ),
    *(
        f"hand.tip.{side}.{name}"
        for side, _ in SIDES
        for name in (
            "radius",
            "youngs_modulus",
            "normal_viscosity",
            "tangential_viscosity",
            "tilt_coupling",
            "normal_mass",
            "tangential_mass",
        )
    ),
    *(f"grasped.{name}" for name in ("width", "mass", "inertia", "com_offset")),
    *(f"control.{side}.{name}" for side, _ in SIDES for name in ("kp", "kd", "ki")),
    "gravity",
)

# What `Model.terms` has, with the shapes.
SHAPES: dict[str, tuple[int, ...]] = {
    "mass_matrix": (9, 9),
    "constraint_matrix": (4, 9),
    "constraint_rate": (4,),
    "residuals": (4,),
    "residual_rates": (2,),
    "elastic": (9,),
    "gravity": (9,),
    "viscous": (9,),
    "control": (9,),
    "external": (9,),
    "kinetic_energy": (),
    "elastic_energy": (),
    "gravity_energy": (),
}
FORCES = ("elastic", "gravity", "viscous", "control", "external")


@dataclass(frozen=True)
class Model:
    """The system in symbols.

    Attributes:
        parameters: Symbol of each dotted name of `PARAMETERS`.
        q: The nine coordinates.
        p: Their rates.
        integral: Of the two angles' errors.
        target: The two desired angles.
        external: F_x, F_y and moment on the object.
        centers: The two tips' centres (7, 8).
        terms: Name -> flat list of expressions, row by row, of the shape in `SHAPES`.
    """

    parameters: dict[str, Any]
    q: tuple[Any, ...]
    p: tuple[Any, ...]
    integral: tuple[Any, ...]
    target: tuple[Any, ...]
    external: tuple[Any, ...]
    centers: tuple[Any, Any]
    terms: dict[str, list[Any]]

    @property
    def state(self) -> tuple[Any, ...]:
        """Every symbol but the parameters, in the order that `compiled` takes them."""
        return (*self.q, *self.p, *self.integral, *self.target, *self.external)

    def rate(self, expression: Any) -> Any:
        """d/dt of a function of q alone."""
        return sum(sp.diff(expression, x) * v for x, v in zip(self.q, self.p, strict=True))

    def matrix(self, name: str) -> Any:
        """A term as a SymPy matrix; a vector is a column."""
        shape = (*SHAPES[name], 1, 1)[:2]
        return sp.Matrix(*shape, self.terms[name])

    def tip(self, i: int) -> dict[str, Any]:
        """Finger i = 0, 1 under short names.

        s, angle, dn, dt, angle_rate and so on, finger_length and so on, radius, ..., kp, kd, ki.
        """
        side, s = SIDES[i]
        records = {f"hand.{side}.": "finger_", f"hand.tip.{side}.": "", f"control.{side}.": ""}
        numbers = {
            short + name.removeprefix(record): symbol
            for record, short in records.items()
            for name, symbol in self.parameters.items()
            if name.startswith(record)
        }
        motion = {
            name + suffix: symbols[3 + 2 * k + i]
            for suffix, symbols in (("", self.q), ("_rate", self.p))
            for k, name in enumerate(("angle", "dn", "dt"))
        }
        return {"s": s, **numbers, **motion}


def turn(vector: Any) -> Any:
    """A vector in the plane turned by 90 degrees, counter-clockwise."""
    return sp.Matrix([-vector[1], vector[0]])


@cache
def model() -> Model:
    """Derives the system: about a second, once."""
    # Real, no more: SymPy would leave the bars off |kappa| were it said to be positive.
    parameters = {name: sp.Symbol(name.replace(".", "_"), real=True) for name in PARAMETERS}
    q = sp.symbols(COORDINATES, real=True)
    p = sp.symbols([f"{name}_rate" for name in COORDINATES], real=True)
    integral = sp.symbols("integral1 integral2", real=True)
    target = sp.symbols("target1 target2", real=True)
    external = sp.symbols("force_x force_y moment", real=True)
    result = Model(parameters, q, p, integral, target, external, (None, None), {})

    x, y, theta, *_ = q
    face_normal = sp.Matrix([sp.cos(theta), sp.sin(theta)])  # out of the right face
    face_up = turn(face_normal)
    gravity_center = sp.Matrix([x, y])
    offset = parameters["grasped.com_offset"]
    middle = gravity_center - offset * face_normal
    g = parameters["gravity"]

    mass, inertia = parameters["grasped.mass"], parameters["grasped.inertia"]
    kinetic = (mass * (p[0] ** 2 + p[1] ** 2) + inertia * p[2] ** 2) / 2
    weight = mass * g * y
    elastic, dissipation = sp.Integer(0), sp.Integer(0)
    holonomic, nonholonomic, centers = [], [], []
    torques = []
    for i, (_, s) in enumerate(SIDES):
        tip = result.tip(i)
        angle, dn, dt = tip["angle"], tip["dn"], tip["dt"]

        # Turning inward tilts the finger from the vertical towards the other one.
        along = sp.Matrix([s * sp.sin(angle), sp.cos(angle)])
        inward = sp.Matrix([s * sp.cos(angle), -sp.sin(angle)])
        root = sp.Matrix([-s * tip["finger_root_offset"], 0])
        center = root + tip["finger_length"] * along + tip["finger_half_thickness"] * inward
        centers.append(center)

        # The face is flat: how far the tip's centre stands before it, less the pressed radius.
        outward = -s * face_normal
        distance = (center - middle).dot(outward) - parameters["grasped.width"] / 2
        radius = tip["radius"] - dn
        holonomic.append(sp.expand(distance - radius))

        along_face = (gravity_center - center).dot(face_up)
        rolling = radius * (tip["angle_rate"] + s * p[2])
        nonholonomic.append(sp.expand(result.rate(along_face) + rolling + tip["dt_rate"]))

        tilt = angle + s * theta
        coupling = tip["tilt_coupling"] * dn**2 * dt * sp.tan(tilt)
        elastic += (
            sp.pi
            * tip["youngs_modulus"]
            * (dn**3 / (3 * sp.cos(tilt) ** 2) + coupling + dn * dt**2)
        )
        weight += tip["finger_mass"] * g * tip["finger_length"] * sp.cos(angle)
        kinetic += (
            tip["finger_inertia"] * tip["angle_rate"] ** 2
            + tip["normal_mass"] * tip["dn_rate"] ** 2
            + tip["tangential_mass"] * tip["dt_rate"] ** 2
        ) / 2
        dissipation += (
            tip["normal_viscosity"] * tip["dn_rate"] ** 2
            + tip["tangential_viscosity"] * tip["dt_rate"] ** 2
        ) / 2
        torques.append(
            -tip["kp"] * (angle - target[i])
            - tip["kd"] * tip["angle_rate"]
            - tip["ki"] * integral[i]
        )

    holonomic_rates = [sp.expand(result.rate(c)) for c in holonomic]
    matrix = sp.Matrix([*holonomic_rates, *nonholonomic]).jacobian(p)
    matrix_rate = sp.Matrix(4, 9, [result.rate(entry) for entry in matrix])
    zero = sp.Integer(0)
    terms = {
        "mass_matrix": sp.hessian(kinetic, p),
        "constraint_matrix": matrix,
        "constraint_rate": (matrix_rate * sp.Matrix(p)).applyfunc(sp.expand),
        "residuals": [*holonomic, *nonholonomic],
        "residual_rates": holonomic_rates,
        "elastic": [-sp.diff(elastic, c) for c in q],
        "gravity": [-sp.diff(weight, c) for c in q],
        "viscous": [-sp.diff(dissipation, c) for c in p],
        "control": [zero, zero, zero, *torques, zero, zero, zero, zero],
        "external": [*external, *[zero] * 6],
        "kinetic_energy": [kinetic],
        "elastic_energy": [elastic],
        "gravity_energy": [weight],
    }
    return Model(
        parameters,
        q,
        p,
        integral,
        target,
        external,
        (centers[0], centers[1]),
        {name: list(value) for name, value in terms.items()},
    )


def magnitude(expression: Any) -> Any:
    """The sum of the absolute values of the additive terms, had one multiplied out.

    A sum becomes the sum of its terms' magnitudes, a product the product of its factors', a
    positive whole power that power of its base's; whatever else, such as a sine or a negative
    power, its own absolute value.
    """
    if expression.is_Add:
        return sp.Add(*map(magnitude, expression.args))
    if expression.is_Mul:
        return sp.Mul(*map(magnitude, expression.args))
    if expression.is_Pow and expression.exp.is_Integer and expression.exp > 0:
        return magnitude(expression.base) ** expression.exp
    if expression.is_Pow and expression.base.is_Function:
        return sp.Abs(expression.base) ** expression.exp
    return sp.Abs(expression)


def vanishes(expression: Any) -> bool:
    """Whether an expression is zero at three random points, to 40 of 50 digits of its terms."""
    expression = sp.sympify(expression)
    symbols = sorted(expression.free_symbols, key=str)
    function = sp.lambdify(symbols, [expression, magnitude(expression)], "mpmath", cse=True)
    random = Random(1)
    with mp.workdps(50):
        for _ in range(3):
            value, size = map(mpf, function(*(mpf(random.uniform(0.1, 1.2)) for _ in symbols)))
            if abs(value) > mpf(10) ** -40 * size:
                return False
    return True


@cache
def compiled(modules: str, scales: bool = False) -> Callable[..., Sequence[Any]]:
    """One function for all of `SHAPES`, its common subexpressions taken once.

    Args:
        modules: "mpmath", "numpy" (arrays of states too) or "math" (plain floats, fastest).
        scales: Whether the magnitudes of all the terms follow after their values.

    Returns:
        A function of `Model.state` and the parameters in the order of `PARAMETERS`, as two
        sequences, that returns one flat list.
    """
    system = model()
    values = [entry for name in SHAPES for entry in system.terms[name]]
    if scales:
        values += [magnitude(entry) for entry in values]
    arguments = (system.state, tuple(system.parameters.values()))
    function: Callable[..., Sequence[Any]] = sp.lambdify(
        arguments, values, modules=modules, cse=True, docstring_limit=0
    )
    return function
