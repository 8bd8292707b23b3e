"""Creep of a grasp within its friction cone in 1000 s: softpinch beside MuJoCo.

make bench-creep
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softpinch as sp
from command import parser
from machine import describe, without_mujoco

FRICTION = 0.5
DURATION = 1000.0  # s
SETTLING = 5.0  # s, before the load and again after it
# Load along the faces by what friction carries at most.
SHARES = (0.1, 0.5)
OURS = (("rk4, dt = 1 ms", {"dt": 1e-3}), ("radau5, dt = 10 ms", {"dt": 1e-2, "method": "radau5"}))
# Name, and options and time constant (s) of the contacts: the defaults, and what users turn on
# against slipping.
THEIRS = (
    ("MuJoCo, defaults", {}, 0.02),
    ("MuJoCo, elliptic cones, impratio 10", {"cone": "elliptic", "impratio": "10"}, 0.02),
    ("MuJoCo, the same, stiffer contact", {"cone": "elliptic", "impratio": "10"}, 0.004),
    ("MuJoCo, the same, impratio 1000", {"cone": "elliptic", "impratio": "1000"}, 0.004),
    (
        "MuJoCo, elliptic cones, 20 noslip iterations",
        {"cone": "elliptic", "noslip_iterations": "20"},
        0.02,
    ),
)
# The largest step that the stiffest of these contacts takes.
STEP = 0.002  # s
FACE, MASS, GRAVITY = 0.049, 0.1, 9.81  # of the cube; m, kg, m/s^2
STIFFNESS = 3000.0  # of MuJoCo's fingers, N/m


@dataclass
class Crept:
    """Motion of the object along the tips while it was held.

    Attributes:
        distance: m.
        duration: s; less than asked for where the object left the tips.
        lost: Whether it did.
        spent: Wall time, s.
    """

    distance: float
    duration: float
    lost: bool
    spent: float


def ours(share: float, options: dict[str, Any], duration: float) -> Crept:
    """The paper's pinch at 6 degrees, its object pulled down as hard as the share asks for.

    Raises:
        RuntimeError: It does not stick.
    """
    scene = sp.Scene(
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 6]])),
        contact="unilateral",
        friction=FRICTION,
        grasped=sp.GraspedObject(mass=MASS, height=FACE),
        gravity=GRAVITY,
        duration=SETTLING,
    )
    ends = {"every": 10**9, "record": ("state", "contact", "multipliers"), **options}
    calm = sp.simulate(scene, dt=1e-3, every=10**9, record=("state", "multipliers"))
    grip = float(calm.multipliers[-1, :2].sum())
    force = (0.0, MASS * GRAVITY - share * FRICTION * grip)
    pushed = replace(
        scene,
        disturbances=[sp.Step(time=SETTLING, force=force, moment=0.0)],
        duration=4 * SETTLING,
    )
    start = sp.simulate(pushed, **ends).state(-1)
    begin = time.perf_counter()
    held = sp.simulate(replace(pushed, initial=start, duration=duration), **ends)
    spent = time.perf_counter() - begin
    if not held.holds or held.contact_changes or (held.contact != sp.ContactMode.STICK).any():
        raise RuntimeError(f"the grasp did not stick: {held.status}, {held.contact_changes}")
    moved = float(np.hypot(*(held.q[-1, :2] - start.q[:2])))
    return Crept(moved, float(held.t[-1] - start.time), False, spent)


def pinch(options: dict[str, str], time_constant: float, carriage: float = 0.0) -> str:
    """A cube between two balls on position-driven fingers, in a plane, as MJCF.

    Args:
        options: Attributes of MJCF's `option`.
        time_constant: Of the contacts, s.
        carriage: Mass of the body, kg, that carries the fingers and is driven by a force along
            each axis; 0 fixes them.
    """
    settings = {"integrator": "implicitfast", **options}
    attributes = " ".join(f'{name}="{value}"' for name, value in settings.items())
    tips = "".join(
        f'<body pos="{-s * (FACE / 2 + 0.02)} 0 0">'
        f'<joint name="{name}" type="slide" axis="{s} 0 0"/>'
        '<geom type="sphere" size="0.02" mass="0.1"/></body>'
        for name, s in (("right", -1), ("left", 1))
    )
    drives = ""
    if carriage:
        slides = (
            '<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>'
        )
        inertia = f'<inertial pos="0 0 0" mass="{carriage}" diaginertia="1 1 1"/>'
        tips = f"<body>{slides}{inertia}{tips}</body>"
        drives = '<motor joint="x"/><motor joint="z"/>'
    return f"""
    <mujoco>
      <option timestep="{STEP}" gravity="0 0 -{GRAVITY}" {attributes}/>
      <default>
        <geom friction="{FRICTION} 0 0" condim="3" solref="{time_constant} 1"/>
      </default>
      <worldbody>
        <body name="cube">
          <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
          <joint type="hinge" axis="0 1 0"/>
          <geom type="box" size="{FACE / 2} {FACE / 2} {FACE / 2}" mass="{MASS}"/>
        </body>
        {tips}
      </worldbody>
      <actuator>
        <position joint="right" kp="{STIFFNESS}" kv="30"/>
        <position joint="left" kp="{STIFFNESS}" kv="30"/>
        {drives}
      </actuator>
    </mujoco>"""


def theirs(share: float, options: dict[str, str], time_constant: float, duration: float) -> Crept:
    """A pinch by MuJoCo, whose fingers press so much that the weight is the share asked for.

    Its contacts yield too much for a grip as firm as ours.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(pinch(options, time_constant))
    data = mujoco.MjData(model)
    gravity, steps = model.opt.gravity.copy(), round(SETTLING / STEP)
    # The contact yields: the targets follow until the fingers press as they should.
    model.opt.gravity[:] = 0.0
    grip = MASS * GRAVITY / (share * FRICTION)
    for _ in range(20):
        mujoco.mj_step(model, data, steps // 20)
        data.ctrl[:] += (grip / 2 - data.actuator_force) / STIFFNESS
    mujoco.mj_step(model, data, steps)
    model.opt.gravity[:] = gravity
    # Not longer than the object takes to settle on its soft contacts: it is sliding already.
    mujoco.mj_step(model, data, round(0.1 / STEP))
    start, begun = data.qpos[:2].copy(), data.time
    begin = time.perf_counter()
    distance, lost = 0.0, False
    while data.time - begun < duration and not lost:
        mujoco.mj_step(model, data, 50)
        distance = float(np.hypot(*(data.qpos[:2] - start)))
        lost = distance > FACE / 2 or data.ncon < 2
    return Crept(distance, float(data.time - begun), lost, time.perf_counter() - begin)


def rows(share: float, duration: float, peer: bool) -> Iterator[tuple[str, Crept]]:
    for name, options in OURS:
        yield f"softpinch, {name}", ours(share, options, duration)
    for name, settings, time_constant in THEIRS if peer else ():
        yield name, theirs(share, settings, time_constant, duration)


def main() -> None:
    duration = 2.0 if parser(__doc__).parse_args().quick else DURATION
    missing = without_mujoco()
    there = not missing
    print(describe(libraries=["mujoco"] if there else (), missing=missing))
    print(f"\nfriction {FRICTION:g}, held for {duration:g} s; MuJoCo's step is {1e3 * STEP:g} ms")
    for share in SHARES:
        print(f"\nload: {share:.0%} of what friction carries")
        print(f"  {'':46s} {'moved, mm':>10s} {'after, s':>9s} {'time, s':>8s}")
        for name, crept in rows(share, duration, there):
            print(
                f"  {name:46s} {1e3 * crept.distance:10.2g} {crept.duration:9.4g} "
                f"{crept.spent:8.2f}{'  lost' if crept.lost else ''}",
                flush=True,
            )


if __name__ == "__main__":
    main()
