"""MuJoCo's pinch for benchmarks/stepping.py: a grasp of as many degrees of freedom as ours.

Object x, z and rotation, two finger angles, and for each tip a normal and a tangential slide with
spring and damper: nine. Torques turn the fingers. Sizes, masses and the held pose are those of our
default scene; the springs are linear, with the stiffness of our tips under the same torques.
Friction holds the object by two contacts of a sphere with a box, which are soft and in space.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import softpinch as sp

# Of a tip that carries the grip of 1.2 N m; N/m and N s/m.
NORMAL, TANGENTIAL, VISCOSITY = 3900.0, 2000.0, 100.0
SETTLING = 0.5  # s
LOST = 0.01  # m, by how far an object that is held never sinks
INTEGRATORS = ("RK4", "implicitfast")

Floats = NDArray[np.float64]


def pinch(integrator: str, step: float) -> str:
    """The pinch as MJCF; x is to the right, z up."""
    finger, tip, body = sp.Finger(), sp.Fingertip(), sp.GraspedObject()
    half = body.width / 2
    offset = finger.root_offset - half - tip.radius
    inertia = finger.inertia - finger.mass * finger.length**2 / 4
    fingers = "".join(
        f"""
        <body pos="{-inward * finger.root_offset} 0 0">
          <joint name="{name}" type="hinge" axis="0 {inward} 0"/>
          <inertial pos="0 0 {finger.length / 2}" mass="{finger.mass}"
            diaginertia="{inertia} {inertia} {inertia}"/>
          <body pos="{inward * offset} 0 {finger.length}">
            <joint type="slide" axis="{-inward} 0 0" stiffness="{NORMAL}" damping="{VISCOSITY}"/>
            <joint type="slide" axis="0 0 1" stiffness="{TANGENTIAL}" damping="{VISCOSITY}"/>
            <geom type="sphere" size="{tip.radius}" mass="{body.mass}" contype="2" conaffinity="1"/>
          </body>
        </body>"""
        for name, inward in (("right", -1), ("left", 1))
    )
    return f"""
    <mujoco>
      <option timestep="{step}" gravity="0 0 -9.81" integrator="{integrator}" cone="elliptic"
        impratio="10"/>
      <default><geom friction="1 0 0" condim="3" solref="0.004 1"/></default>
      <worldbody>
        <body name="object" pos="0 0 {finger.length}">
          <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
          <joint type="hinge" axis="0 1 0"/>
          <geom type="box" size="{half} {half} {half}" mass="{body.mass}" contype="1"
            conaffinity="2"/>
        </body>{fingers}
      </worldbody>
      <actuator><motor joint="right"/><motor joint="left"/></actuator>
    </mujoco>"""


class Pinch:
    """The grasp at rest under torques, from which every measurement begins.

    Attributes:
        model: MuJoCo's model.
        data: Its data.
        start: The state of the held grasp.
    """

    def __init__(self, integrator: str, step: float, torque: float) -> None:
        """Lets the grasp settle under equal torques on both fingers, N m."""
        import mujoco

        self.model = mujoco.MjModel.from_xml_string(pinch(integrator, step))
        self.data = mujoco.MjData(self.model)
        self.data.ctrl[:] = torque
        mujoco.mj_step(self.model, self.data, round(SETTLING / step))
        self._kind = mujoco.mjtState.mjSTATE_INTEGRATION
        self.start = self.state(self._kind)
        self.require()

    def state(self, kind: Any) -> Floats:
        """The present state, of a kind of MuJoCo's."""
        import mujoco

        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state

    def begin(self) -> None:
        """Goes back to the grasp at rest."""
        import mujoco

        mujoco.mj_setState(self.model, self.data, self.start, self._kind)

    def require(self) -> None:
        """Refuses to time anything but a grasp: an object that falls is cheaper.

        Raises:
            RuntimeError: It is not a grasp of nine degrees of freedom that two contacts hold.
        """
        model, data = self.model, self.data
        if model.nv != 9 or data.ncon != 2 or abs(data.qpos[1]) > LOST:
            raise RuntimeError(f"MuJoCo: nv {model.nv}, ncon {data.ncon}, qpos {data.qpos}")


def alone(
    integrator: str, step: float, each: int, torques: Floats, one_by_one: bool
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Steps one pinch once for each row of the torques (k, 2), by `each` steps.

    Args:
        integrator: MuJoCo's name of it.
        step: Time step, s.
        each: Number of steps under the same torques.
        torques: Torques of the fingers (k, 2), N m.
        one_by_one: Whether Python calls for each step, rather than once for all of them.

    Returns:
        What puts the grasp at its start, and what steps it.
    """
    import mujoco

    grasp = Pinch(integrator, step, float(torques.mean()))
    model, data = grasp.model, grasp.data

    def work() -> None:
        for torque in torques:
            data.ctrl[:] = torque
            if one_by_one:
                for _ in range(each):
                    mujoco.mj_step(model, data)
            else:
                mujoco.mj_step(model, data, each)
        grasp.require()

    return grasp.begin, work


def many(
    integrator: str, step: float, each: int, actions: Floats, threads: int
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Steps n pinches once for each of the actions (k, n, 2), by `each` steps.

    Each period begins at the states at which the one before it ended, as in a training loop.

    Returns:
        What puts the grasps at their start, and what steps them.
    """
    import mujoco
    import mujoco.rollout

    grasp = Pinch(integrator, step, float(actions.mean()))
    start = grasp.state(mujoco.mjtState.mjSTATE_FULLPHYSICS)
    n = actions.shape[1]
    states = np.tile(start, (n, 1))
    rows = np.empty((n, each, len(start)))
    sensors = np.empty((n, each, 0))
    # The pool keeps its threads between calls; without any, the caller's thread computes.
    pool = mujoco.rollout.Rollout(nthread=threads if threads > 1 else 0)
    places = [mujoco.MjData(grasp.model) for _ in range(threads)]

    def begin() -> None:
        states[:] = start

    def work() -> None:
        for torques in actions:
            pool.rollout(
                grasp.model,
                places if threads > 1 else places[0],
                states,
                torques[:, None, :],
                nstep=each,
                state=rows,
                sensordata=sensors,
            )
            states[:] = rows[:, -1]
        # A state is the time, then the coordinates: object x, z, ...
        if not (np.abs(states[:, 2]) < LOST).all():
            raise RuntimeError("MuJoCo: an object fell")

    return begin, work
