"""A camera and a servo
====================

The object is turned upright by what a camera sees, 30 ms late at 30 Hz, and a servo at 1 kHz::

    python examples/16_camera_and_servo.py [camera_and_servo.png] [--quick]

Posture control in two phases: a camera measures how far the object is turned, and the integral of
that moves the target angles of both fingers in opposite directions. A PD servo turns the fingers
towards the targets. Neither knows the object, the tips or a Jacobian. Both are blocks of one
`SampledController.cascade`, which the core computes in lanes.

The delay limits the gain of the integral. `sp.loop` predicts the limit, an ensemble over the gain
finds it, and another ensemble has the odds with which random objects in random tips end within 3
degrees, with the camera and without it.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import softpinch as sp
from softpinch.plot.style import BLACK, GREEN, PAGE, RED

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("camera_and_servo.png"))
parser.add_argument("--quick", action="store_true", help="fewer runs")
given = parser.parse_args()

FRAME, DELAY = 1 / 30, 0.03  # s
KP, KD = 20.0, 0.2  # of the servo, N m/rad and N m s/rad
TARGETS = np.array([0.1, 0.1])  # rad
APART = np.array([[1.0], [-1.0]])


def controller(gain: float) -> sp.SampledController:
    """Both blocks; the camera's one state is the integral of the rotation, rad s."""
    camera = sp.SampledController(
        FRAME,
        A=[[1.0]],
        B=[[FRAME, 0.0, 0.0]],
        C=gain * APART,
        D=np.hstack([np.zeros((2, 1)), np.eye(2)]),
        measures=("rotation", "target"),
        measure_delay=DELAY,
        # Its outputs are targets. Where a tip slips, the integral must not wind up.
        limits=(0.02, 0.18),
        anti_windup=True,
        initial_torque=TARGETS,
    )
    servo = sp.SampledController.pid(1e-3, KP, KD, 0.0, limits=(-10.0, 10.0))
    return sp.SampledController.cascade([camera, servo])


# The grasp at rest: without the camera the servo is a continuous PD law there.
schedule = sp.Schedule.steps([0.0], [TARGETS])
held = sp.Scene(control=sp.Pid(kp=KP, kd=KD, ki=0.0), schedule=schedule)
rest = sp.equilibrium(held)
assert rest.state is not None
start = replace(rest.state, time=0.0)
scene = sp.Scene(control=controller(1.0), schedule=schedule, initial=start)
loop = sp.loop(scene, rest, block=0)
limit = loop.gain_margin
print(f"predicted limit of the gain: {limit:.3f} 1/s, over {loop.period:g} s")
tenth = sp.loop(replace(scene, control=controller(0.3 * limit)), rest, block=0)
print(f"at 0.3 of it the camera may be {1e3 * tenth.delay_margin:.0f} ms later")

# Ensembles over the gain. An unstable loop swings more at the end of a longer run.
gains = limit * np.linspace(0.99, 1.01, 11 if given.quick else 41)
vary = {"control.outer.C.0.0": gains, "control.outer.C.1.0": -gains}
knock = sp.Impulse(time=0.01, impulse=(0.0, 0.0), angular_impulse=1e-5)
swings = [
    sp.monte_carlo(
        replace(scene, disturbances=[knock], duration=duration),
        vary=vary,
        dt=1e-3,
        summaries=("peak_rotation",),
        summaries_after=duration - 2.0,
        progress=False,
    )["peak_rotation"]
    for duration in (6.0, 12.0)
]
found = gains[swings[1] > swings[0]].min()
print(f"found by simulation:         {found:.3f} 1/s, steps of {np.diff(gains)[0]:.3f}")

# Random objects, whose centre of gravity is off the middle, which are turned by a moment, in random
# tips that slip.
unlike = {
    "grasped.mass": sp.Uniform(0.05, 0.2),
    "grasped.com_offset": sp.Uniform(-0.01, 0.01),
    "disturbances.0.moment": sp.Uniform(-0.4, 0.4),
    "hand.tip.right.youngs_modulus": sp.LogUniform(5e4, 4e5),
    "hand.tip.left.youngs_modulus": sp.LogUniform(5e4, 4e5),
    "friction": sp.Uniform(0.4, 1.0),
}
pinch = sp.Scene(
    schedule=schedule,
    contact="unilateral",
    friction=0.8,
    disturbances=[sp.Step(time=0.5, moment=0.2)],
    duration=4.0,
)
upright = {}
for name, gain in (("with", 0.3 * limit), ("without", 0.0)):
    many = sp.monte_carlo(
        replace(pinch, control=controller(gain)),
        runs=100 if given.quick else 2000,
        vary=unlike,
        seed=1,
        dt=5e-4,
        summaries=("final_state",),
        progress=False,
    )
    turned = np.abs(np.rad2deg(many["final_state"][:, 2]))
    upright[name] = float((many.holds & (turned < 3.0)).mean())
    print(f"within 3 degrees {name} the camera: {100 * upright[name]:.1f}%")

with sp.plot.styled():
    figure = Figure(figsize=(PAGE, 3.4), layout="constrained")
    angle, target = figure.subplots(2, 1, sharex=True)
    turned_away = replace(pinch, duration=1.5)
    for share, color, dashes in ((0.05, BLACK, "-"), (0.3, GREEN, (0, (5, 1.2))), (0.8, RED, ":")):
        run = sp.simulate(replace(turned_away, control=controller(share * limit)), record="state")
        look = {"color": color, "linestyle": dashes}
        angle.plot(run.t, np.rad2deg(run.q[:, 2]), label=f"{share:g} of the limit", **look)
        target.plot(run.t, np.rad2deg(run.q[:, 3]), **look)
        target.plot(run.t, np.rad2deg(run.q[:, 4]), **look)
    angle.axhline(0.0, color=BLACK, linewidth=0.5)
    angle.set_ylabel("rotation of\nthe object [deg]")
    target.set_ylabel("angles of\nthe fingers [deg]")
    target.set_xlabel("time [s]")
    angle.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
print("saved", sp.plot.save(figure, given.picture))
