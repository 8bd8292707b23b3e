"""The hand of benchmarks/carry.py in MuJoCo and in Drake.

Both have the planar hand of benchmarks/creep.py: a cube between two balls on position-driven
fingers. A carriage, much heavier than all that it carries, moves the fingers. The force on it is
that of the motion, so that the carriage moves as each simulator integrates an acceleration: a
position given from outside would differ from it by a step's error, and would rub the object.
"""

import math
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np

import creep

CARRIAGE = 1000.0  # kg
FINGER, RADIUS = 0.1, 0.02  # of MuJoCo's and Drake's fingers, as `creep.pinch` has them; kg, m
DRAKE_STEP = 0.001  # s, the default of Drake's MultibodyPlantConfig


class Peer(Protocol):
    """A simulator with a grasp, after its last step.

    Attributes:
        step: s.
    """

    step: float

    def advance(self, x: float, y: float, steps: int = 1) -> None:
        """Takes steps in which the hand has this acceleration, m/s^2."""

    def height(self) -> float:
        """Of the object in the hand, m."""

    def forces(self) -> list[tuple[float, float]]:
        """Normal force and size of the friction force of each contact, N."""

    def press(self, change: float) -> None:
        """Moves the targets of both fingers inwards, m."""

    def throw(self, speed: float) -> None:
        """Gives hand and object this velocity upwards, m/s."""


def without_drake() -> dict[str, str]:
    """For `missing` of `machine.describe`: Drake and why it does not take part, or nothing."""
    return {} if find_spec("pydrake") else {"Drake": "not installed"}


def mujoco_integrators(names: Sequence[str]) -> list[str]:
    """Those of these integrators that the installed version has."""
    import mujoco

    known = mujoco.mjtIntegrator.__members__
    return [name for name in names if f"mjINT_{name.upper()}" in known]


class MuJoCo:
    """The hand of `creep.pinch` on a carriage.

    The friction of its contacts is 1.6 times firmer than with fingers on a base that is fixed,
    because MuJoCo takes the mean over all directions in which a body can move for its inertia.
    """

    def __init__(
        self,
        options: dict[str, str],
        time_constant: float,
        step: float = creep.STEP,
        text: str | None = None,
        impedance: tuple[float, float] | None = None,
    ) -> None:
        import mujoco

        if text is None:
            text = creep.pinch(options, time_constant, CARRIAGE)
        self._mujoco = mujoco
        self._model = mujoco.MjModel.from_xml_string(text)
        self._data = mujoco.MjData(self._model)
        self._mass = float(self._model.body_mass.sum())
        self._model.opt.timestep = self.step = step
        if impedance is not None:
            self._model.geom_solimp[:, :2] = impedance

    def advance(self, x: float, y: float, steps: int = 1) -> None:
        # The object's weight and inertia are carried by the carriage, too.
        self._data.ctrl[2:] = self._mass * x, self._mass * (y + creep.GRAVITY)
        self._mujoco.mj_step(self._model, self._data, steps)

    def height(self) -> float:
        return float(self._data.qpos[1] - self._data.qpos[4])

    def forces(self) -> list[tuple[float, float]]:
        found, force = [], np.zeros(6)
        for k in range(self._data.ncon):
            self._mujoco.mj_contactForce(self._model, self._data, k, force)
            found.append((float(force[0]), math.hypot(force[1], force[2])))
        return found

    def press(self, change: float) -> None:
        self._data.ctrl[:2] += change

    def throw(self, speed: float) -> None:
        self._data.qvel[[1, 4]] = speed


class Drake:
    """The same hand. Its contacts are points with Drake's default stiffness and dissipation.

    With an accuracy, Drake's integrator with error control, CENIC, chooses the steps, up to the
    longest; the force on the hand changes at multiples of `step`.
    """

    def __init__(
        self,
        config: dict[str, Any],
        step: float = DRAKE_STEP,
        accuracy: float | None = None,
        longest: float = 0.1,
    ) -> None:
        from pydrake.geometry import AddContactMaterial, Box, ProximityProperties, Sphere
        from pydrake.math import RigidTransform
        from pydrake.multibody.plant import (
            AddMultibodyPlant,
            CoulombFriction,
            MultibodyPlantConfig,
        )
        from pydrake.multibody.tree import (
            PdControllerGains,
            PlanarJoint,
            PrismaticJoint,
            SpatialInertia,
            UnitInertia,
        )
        from pydrake.systems.analysis import Simulator
        from pydrake.systems.framework import DiagramBuilder

        # MuJoCo's z is Drake's y, because a planar joint moves in x and y.
        builder = DiagramBuilder()
        # Ports that are computed when they are read only save time.
        settings = MultibodyPlantConfig(
            time_step=0.0 if accuracy else step, use_sampled_output_ports=False, **config
        )
        plant, _ = AddMultibodyPlant(settings, builder)
        plant.mutable_gravity_field().set_gravity_vector([0.0, -creep.GRAVITY, 0.0])
        surface = ProximityProperties()
        friction = CoulombFriction(creep.FRICTION, creep.FRICTION)
        AddContactMaterial(friction=friction, properties=surface)

        def body(name: str, mass: float, moment: float) -> Any:
            about = UnitInertia(*[moment / mass] * 3)
            return plant.AddRigidBody(name, SpatialInertia(mass, [0.0, 0.0, 0.0], about))

        beam, hand = body("beam", CARRIAGE, 1.0), body("hand", CARRIAGE, 1.0)
        cube = body("cube", creep.MASS, creep.MASS * creep.FACE**2 / 6)
        world = plant.world_frame()
        sides = (("right", -1), ("left", 1))
        fingers = [body(name, FINGER, 1e-4) for name, _ in sides]
        # Actuators and coordinates are in the order of these joints.
        drives = [
            plant.AddJoint(PrismaticJoint("x", world, beam.body_frame(), [1, 0, 0])),
            plant.AddJoint(PrismaticJoint("y", beam.body_frame(), hand.body_frame(), [0, 1, 0])),
        ]
        for (name, side), finger in zip(sides, fingers, strict=True):
            way = [side, 0, 0]
            slide = PrismaticJoint(name, hand.body_frame(), finger.body_frame(), way)
            drives.append(plant.AddJoint(slide))
            place = RigidTransform([-side * (creep.FACE / 2 + RADIUS), 0.0, 0.0])
            plant.RegisterCollisionGeometry(finger, place, Sphere(RADIUS), name, surface)
        plant.AddJoint(PlanarJoint("cube", world, cube.body_frame()))
        box = Box(creep.FACE, creep.FACE, creep.FACE)
        plant.RegisterCollisionGeometry(cube, RigidTransform(), box, "box", surface)
        actuators = [plant.AddJointActuator(joint.name(), joint) for joint in drives]
        for actuator in actuators[2:]:
            actuator.set_controller_gains(PdControllerGains(p=creep.STIFFNESS, d=30.0))
        plant.Finalize()

        self._plant = plant
        self._simulator = Simulator(builder.Build())
        if accuracy is not None:
            from pydrake.systems.analysis import ApplySimulatorConfig, SimulatorConfig

            control = SimulatorConfig(
                integration_scheme="cenic",
                accuracy=accuracy,
                max_step_size=longest,
                use_error_control=True,
            )
            ApplySimulatorConfig(control, self._simulator)
        self._root = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(self._root)
        self._force = plant.get_actuation_input_port().FixValue(self._context, [0.0] * 4)
        self._desired = plant.get_desired_state_input_port(cube.model_instance())
        self._targets = [0.0] * 8
        self._carried = CARRIAGE + 2 * FINGER + creep.MASS
        self.step = step
        self._steps = 0
        self.press(0.0)

    def advance(self, x: float, y: float, steps: int = 1) -> None:
        force = self._force.GetMutableData().get_mutable_value()
        force.SetAtIndex(0, (self._carried + CARRIAGE) * x)
        force.SetAtIndex(1, self._carried * (y + creep.GRAVITY))
        self._steps += steps
        self._simulator.AdvanceTo(self._steps * self.step)

    def height(self) -> float:
        q = self._plant.GetPositions(self._context)
        return float(q[5] - q[1])

    def forces(self) -> list[tuple[float, float]]:
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        found = []
        for k in range(results.num_point_pair_contacts()):
            contact = results.point_pair_contact_info(k)
            force, normal = contact.contact_force(), contact.point_pair().nhat_BA_W
            along = abs(float(force @ normal))
            found.append((along, math.sqrt(max(float(force @ force) - along**2, 0.0))))
        return found

    def press(self, change: float) -> None:
        self._targets[2] += change
        self._targets[3] += change
        self._desired.FixValue(self._context, self._targets)

    def throw(self, speed: float) -> None:
        self._plant.SetVelocities(self._context, [0.0, speed, 0.0, 0.0, 0.0, speed, 0.0])
