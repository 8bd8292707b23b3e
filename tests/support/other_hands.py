"""Scenes with other parts than the paper's, and seven of which an independent program has the end.

`parts_facts.json` is that program's: Lagrange's multipliers with SymPy's derivatives from positions
and rigid velocities, DOP853 with a relative tolerance of 1e-12.
"""

import json
from pathlib import Path
from typing import Any

import softpinch as sp

FACTS: dict[str, dict[str, Any]] = json.loads(
    Path(__file__).with_name("parts_facts.json").read_text(encoding="utf-8")
)
# What a run can record.
EVERYTHING = ("state", "multipliers", "residuals", "energy", "torque", "contact")
# Gains of a jaw, in N/m, N s/m and N/(m s).
STIFF = sp.Pid(kp=2e4, kd=200.0, ki=2e5)
# A law with the force of the default springs at 5 mm.
POWER = sp.PowerLaw(coefficient=164033.0, exponent=1.67, foot=1e-4)


def scene_of(name: str) -> sp.Scene:
    """The scene of a fact, through the public names."""
    fact = FACTS[name]
    numbers = fact["parameters"]

    def finger(kind: str, k: int) -> Any:
        if kind == "jaw":
            thick = 0.0045
            return sp.Jaw(
                root_offset=numbers[f"X0{k}"] + thick,
                half_thickness=thick,
                mass=numbers[f"Mi{k}"],
                height=numbers[f"Y0{k}"],
                direction=numbers[f"ga{k}"],
                angle=numbers[f"ph{k}"],
            )
        shared = {
            "length": numbers[f"L{k}"],
            "root_offset": numbers[f"Wf{k}"],
            "half_thickness": numbers[f"df{k}"],
            "mass": numbers[f"Mi{k}"],
            "inertia": numbers[f"Ii{k}"],
        }
        return sp.Finger(**shared) if kind == "rotary" else sp.Parallelogram(**shared)

    def side(kind: str, k: int) -> Any:
        if kind == "arc":
            centre = numbers[f"kx{k}"], numbers[f"ky{k}"]
            return sp.Arc(numbers[f"R{k}"], centre, counterface="flat")
        return sp.Face(tilt=numbers[f"be{k}"]) if numbers[f"be{k}"] else None

    def tip(kind: str, k: int) -> sp.Fingertip:
        law = None
        if kind == "power":
            law = sp.PowerLaw(numbers[f"c{k}"], numbers[f"ex{k}"])
        return sp.Fingertip(
            radius=numbers[f"a{k}"],
            youngs_modulus=numbers.get(f"E{k}", 3e5),
            tilt_coupling=numbers[f"ka{k}"],
            normal_mass=numbers[f"mn{k}"],
            tangential_mass=numbers[f"mt{k}"],
            law=law,
        )

    right, left = (finger(kind, k) for k, kind in enumerate(fact["mechanism"], 1))
    sides = [side(kind, k) for k, kind in enumerate(fact["side"], 1)]
    tips = tuple(tip(kind, k) for k, kind in enumerate(fact["law"], 1))
    return sp.Scene(
        hand=sp.Hand(right=right, left=left, tip=(tips[0], tips[1])),
        grasped=sp.GraspedObject(
            width=2.0 * numbers.get("hw1", 0.0245),
            mass=numbers["M"],
            inertia=numbers["I"],
            right=sides[0],
            left=sides[1],
        ),
        control=tuple(sp.Pid(kp=kp, kd=kd, ki=ki) for kp, kd, ki in fact["pid"]),
        schedule=sp.Schedule.steps([0.0], [fact["target"]]),
        gravity=numbers["g"],
        duration=fact["t"],
        initial=sp.State(q=fact["q0"]),
    )


def jaws(**fields: Any) -> sp.Scene:
    """A parallel gripper that closes by 4 mm on the object of `grasped`, if one is given."""
    return sp.Scene(
        **{
            "hand": sp.Hand(right=sp.Jaw(), left=sp.Jaw()),
            "control": STIFF,
            "schedule": sp.Schedule.steps([0.0], [[4e-3, 4e-3]]),
            "duration": 0.1,
            "initial": "touching",
        }
        | fields
    )


def linked(**fields: Any) -> sp.Scene:
    """The default hand of links, which starts where it touches the object."""
    return sp.Scene(**{"duration": 0.1, "initial": "touching"} | fields)


BOTTLE = sp.GraspedObject.disc(diameter=0.05, mass=0.15)
WEDGE = sp.GraspedObject.wedge(width=0.05, height=0.06, mass=0.1, angle=0.05)
MEASURED = sp.MeasuredLaw([1e-3, 2e-3, 4e-3, 6e-3, 8e-3], [1.0, 4.0, 15.5, 34.0, 60.0])
# A scene of each kind, and of some together.
SCENES: dict[str, sp.Scene] = {
    "jaws and a box": jaws(),
    "jaws and a bottle": jaws(grasped=BOTTLE),
    "jaws and a wedge": jaws(grasped=WEDGE),
    "links and a bottle": linked(grasped=BOTTLE),
    "links and a wedge": linked(grasped=WEDGE),
    "parallelograms": linked(hand=sp.Hand(right=sp.Parallelogram(), left=sp.Parallelogram())),
    "power law": linked(hand=sp.Hand(tip=sp.Fingertip(law=POWER))),
    "measured law": linked(hand=sp.Hand(tip=sp.Fingertip(law=MEASURED))),
    "a link and a jaw": linked(
        hand=sp.Hand(right=sp.Finger(), left=sp.Jaw(direction=0.1, angle=-0.1)),
        grasped=sp.GraspedObject(right=sp.Face(tilt=-0.05), left=sp.Arc(0.04, (0.005, 0.002))),
        control=(sp.Pid(), STIFF),
        schedule=sp.Schedule.steps([0.0], [[0.08, 6e-3]]),
    ),
}
