"""Scenes that several tests share, each with switches and edges off any grid."""

from dataclasses import replace

import numpy as np

import softpinch as sp
from softpinch import paper


def uneven() -> sp.Scene:
    """Two different fingers, tips and gains, and a centre of gravity off the middle."""
    return sp.Scene(
        hand=sp.Hand(
            right=sp.Finger(length=0.08, root_offset=0.047, inertia=7e-4),
            left=sp.Finger(length=0.07, half_thickness=0.006, mass=0.15),
            tip=(
                sp.Fingertip(radius=0.018, youngs_modulus=4e5, normal_mass=0.05),
                sp.Fingertip(radius=0.022, tangential_viscosity=60.0, tilt_coupling=-1.0),
            ),
        ),
        grasped=sp.GraspedObject(width=0.052, mass=0.08, com_offset=0.004),
        control=(sp.Pid(kp=90.0), sp.Pid(kd=1.4, ki=600.0)),
        initial="touching",
        schedule=sp.Schedule.ramps([0.0, 0.0413, 0.09], np.deg2rad([[2, 4], [9, 7], [6, 6]])),
        duration=0.12,
    )


def pushed(*disturbances: object) -> sp.Scene:
    """A grasp that is pushed while it closes."""
    return sp.Scene(
        schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.0137], np.deg2rad([[5, 5], [8, 4]]), move_time=0.0411
        ),
        disturbances=disturbances,
        duration=0.1,
    )


TIMES = np.array([0.0171, 0.0333, 0.0507])
SCENES = {
    "paper (i)": paper.disturbance("i"),
    "paper (iii)": paper.disturbance("iii"),
    "uneven": uneven(),
    "step": pushed(sp.Step(time=0.0231, force=(8.0, -3.0), moment=0.03)),
    "pulse": pushed(sp.Pulse(time=0.0231, duration=0.0117, force=(8.0, -3.0), moment=0.03)),
    "impulse": pushed(sp.Impulse(time=0.0231, impulse=(0.05, -0.02), angular_impulse=2e-4)),
    "sine": pushed(
        sp.Sine(frequency_hz=33.0, force=(6.0, 4.0), moment=0.02, phase=0.4, time=0.0091)
    ),
    "samples held": pushed(
        sp.Sampled(
            times=TIMES, force=[[5, 1], [-4, 2], [0, 0]], moment=[0.01, 0.02, 0], hold="zero"
        )
    ),
    "samples joined": pushed(
        sp.Sampled(times=TIMES, force=[[0, 0], [6, 2], [1, 0]], moment=[0, 0.02, 0], hold="linear")
    ),
}


def swaying() -> sp.Scene:
    """Soft tips and soft fingers that sway about their targets, without any switch.

    Nothing decays before the end, and nothing is so fast that a step of some milliseconds leaves
    the asymptotic range of a method: what an order is measured on.
    """
    soft = sp.Scene(
        hand=sp.Hand(
            tip=sp.Fingertip(youngs_modulus=3e4, normal_viscosity=3.0, tangential_viscosity=3.0)
        ),
        control=sp.Pid(kp=20.0, kd=0.05, ki=100.0),
        duration=0.1,
    )
    start = sp.State.consistent(
        soft, fingers=np.deg2rad([7, 5]), velocity=(0.05, -0.02, 0.5), shear=(1e-4, -1e-4)
    )
    return replace(soft, initial=start)


def driven() -> sp.Scene:
    """The same with a smooth move, a step, an impulse and a sine, switches off any grid."""
    return replace(
        swaying(),
        schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.0613], np.deg2rad([[6, 6], [8, 5]]), move_time=0.0511
        ),
        disturbances=[
            sp.Step(time=0.1601, force=(1.0, -0.5), moment=0.01),
            sp.Impulse(time=0.1601, impulse=(0.005, 0.01), angular_impulse=1e-5),
            sp.Sine(frequency_hz=11.0, force=(0.5, 0.5)),
        ],
        duration=0.22,
    )


def some_scene() -> sp.Scene:
    """A short grasp with a pulse, a sine and an impulse."""
    return sp.Scene(
        schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.0123], np.deg2rad([[6, 6], [9, 3]]), move_time=0.021
        ),
        disturbances=[
            sp.Pulse(time=0.0071, duration=0.01, force=(4.0, 1.0), moment=0.01),
            sp.Sine(frequency_hz=40.0, force=(1.0, 1.0)),
            sp.Impulse(time=0.02503, impulse=(0.01, 0.0)),
        ],
        duration=0.05,
    )


def jerked() -> sp.Scene:
    """A grasp that pulls and slips after a jump of the targets, at t = 10 ms."""
    angles = np.deg2rad([[6, 6], [12, -2]])
    schedule = sp.Schedule.steps([0.0, 0.01], angles)
    return sp.Scene(schedule=schedule, friction=0.6, duration=0.03)
