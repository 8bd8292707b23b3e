"""A script for the interpreter that has Siconos: Moreau-Jean's time stepping of one scene.

It shares no module with softpinch or with the rest of the oracle. A task as JSON comes in on
standard input: the terms of motion as the text of a Python function, and numbers. The end of the
run and every change of contact go out on standard output as JSON.

Siconos integrates the nine equations (MoreauJeanOSI), decides which contacts take part in a step,
and solves the step's contact problem (FrictionContact with Newton's law of impact, e = 0). The
relation of a contact is its gap, linearised at the start of each step. This script adds what
belongs to this model only: the forces, and whether a tip's couple acts or its tilt is frozen
during the next step. Moreau-Jean's scheme holds the velocities' constraints, so the gap of a
contact that presses drifts by some h^2 a step; the tip's surface is moved by as much.
"""

import json
import math
import sys
import time
from typing import Any

import numpy as np
import siconos.kernel as sk
import siconos.numerics as sn

# A gap below this times the step squared counts as closed, m/s^2: more than the drift of a step.
TOUCHING = 1e4
FREE, STICK, SLIP = 0, 1, 2


class Pinch(sk.LagrangianDS):  # type: ignore[misc]
    """The two fingers, their tips and the object, as Siconos takes a Lagrangian system.

    Attributes:
        asked: The targets and the external force of the present step (5,).
        closed: Whether each tip touches, so that its couple acts.
        frozen: The tilts of tips that do not touch, rad.
        integral: Of the errors of the fingers' angles, rad s.
        spent: Time in the terms of motion, which are Python, s.
    """

    def __init__(self, task: dict[str, Any]) -> None:
        super().__init__(task["q"], task["p"], np.diag(task["masses"]))
        names: dict[str, Any] = dict(vars(math))
        exec(task["terms"], names)
        self._function, self._values = names[task["name"]], task["values"]
        self._places, self._turning = task["places"], np.array(task["turning"])
        self.asked, self.integral = task["asked"][0], list(task["integral"])
        self.closed, self.frozen = [True, True], [0.0, 0.0]
        self.spent = 0.0
        self.allocateFInt()

    def tilts(self) -> list[float]:
        tilts: list[float] = (self._turning @ self.q()).tolist()
        return tilts

    def _flat(self, q: Any, v: Any) -> list[float]:
        live = (self._turning @ q).tolist()
        tilts = [live[i] if self.closed[i] else self.frozen[i] for i in range(2)]
        state = (*map(float, q), *map(float, v), *self.integral, *self.asked)
        begin = time.thread_time()
        flat = list(self._function(state, tilts, self._values))
        self.spent += time.thread_time() - begin
        return flat

    def gaps(self) -> tuple[Any, list[float]]:
        """Phi (4, 9) and the gaps (2,), m."""
        flat = self._flat(self.q(), self.velocity())
        phi = np.zeros(36)
        phi[self._places] = flat[:16]
        phi = phi.reshape(4, 9)
        phi[range(4), range(5, 9)] = 1.0
        return phi, flat[31:33]

    def computeFInt(self, t: float, q: Any = None, v: Any = None) -> None:
        """The forces, with the sign of the left-hand side, at one state."""
        flat = self._flat(self.q() if q is None else q, self.velocity() if v is None else v)
        force = np.array(flat[20:29])
        for i in range(2):
            if self.closed[i]:
                force -= flat[29 + i] * self._turning[i]
        self.fInt()[:] = -force


class Stepping:
    """Siconos' objects for one task; they must outlive the run, for Siconos does not keep them."""

    def __init__(self, task: dict[str, Any]) -> None:
        self.step, self.asked = task["step"], task["asked"]
        self.friction, self.pinch = task["friction"], Pinch(task)
        threshold = TOUCHING * self.step**2
        self.model = sk.NonSmoothDynamicalSystem(0.0, len(self.asked) * self.step)
        self.model.insertDynamicalSystem(self.pinch)
        self.laws = [sk.NewtonImpactFrictionNSL(0.0, 0.0, mu, 2) for mu in self.friction]
        self.relations = [sk.LagrangianLinearTIR(np.zeros((2, 9)), np.zeros(2)) for _ in self.laws]
        pairs = zip(self.laws, self.relations, strict=True)
        self.contacts = [sk.Interaction(law, relation) for law, relation in pairs]
        self.pinch.closed = self.linearise()
        for contact in self.contacts:
            self.model.link(contact, self.pinch)
        self.scheme = sk.MoreauJeanOSI(task["theta"])
        self.scheme.setConstraintActivationThreshold(threshold)
        # Impulses are of the step's size: a tolerance for forces would be far too loose.
        self.problem = sk.FrictionContact(2, sn.SICONOS_FRICTION_2D_LEMKE)
        self.problem.numericsSolverOptions().dparam[0] = 1e-14
        self.grid = sk.TimeDiscretisation(0.0, self.step)
        self.run = sk.TimeStepping(self.model, self.grid, self.scheme, self.problem)
        linear, iterated = sk.SICONOS_TS_LINEAR, sk.SICONOS_TS_NONLINEAR
        self.run.setNewtonOptions(iterated if task["iterated"] else linear)
        self.run.setNewtonTolerance(1e-10)
        self.run.initialize()

    def linearise(self) -> list[bool]:
        """Renews both relations; whether each contact will be taken as closed."""
        phi, gaps = self.pinch.gaps()
        q, v = self.pinch.q(), self.pinch.velocity()
        closed = []
        for i, relation in enumerate(self.relations):
            rows = phi[[i, 2 + i]]
            relation.C()[:] = rows
            relation.e()[:] = np.array([gaps[i], 0.0]) - rows @ q
            ahead = gaps[i] + self.step * float(rows[0] @ v) / 2
            closed.append(ahead <= TOUCHING * self.step**2)
        return closed

    def advance(self, asked: list[float]) -> list[int]:
        """One step; the modes of both contacts during it."""
        pinch = self.pinch
        pinch.asked = asked
        closed, live = self.linearise(), pinch.tilts()
        for i in range(2):
            if closed[i] != pinch.closed[i]:
                pinch.frozen[i] = live[i]
        pinch.closed = closed
        angles = [float(pinch.q()[3 + i]) for i in range(2)]
        self.run.updateOutput(0)
        self.run.updateOutput(1)
        self.run.computeOneStep()
        _, gaps = pinch.gaps()
        modes = []
        for i, contact in enumerate(self.contacts):
            normal, tangential = map(float, contact.lambda_(1))
            if normal > 0:
                pinch.q()[5 + i] -= gaps[i]
            slides = abs(tangential) >= (1 - 1e-9) * self.friction[i] * normal
            modes.append((SLIP if slides else STICK) if normal > 0 else FREE)
        self.run.nextStep()
        for i in range(2):
            pinch.integral[i] += self.step * (angles[i] - asked[i])
        return modes


def simulate(task: dict[str, Any]) -> dict[str, Any]:
    stepping = Stepping(task)
    changes: list[tuple[float, int, int]] = []
    rows, watched = [], set(task["watched"])
    before: list[int] = []
    begin = time.thread_time()
    for k, asked in enumerate(stepping.asked):
        modes = stepping.advance(asked)
        changes += [
            (k * stepping.step, i, mode)
            for i, mode in enumerate(modes)
            if not before or mode != before[i]
        ]
        before = modes
        if k + 1 in watched:
            rows.append(stepping.pinch.q().tolist())
    spent, pinch = time.thread_time() - begin, stepping.pinch
    return {
        "q": pinch.q().tolist(),
        "p": pinch.velocity().tolist(),
        "changes": changes,
        "rows": rows,
        "spent": [spent, pinch.spent],
    }


if __name__ == "__main__":
    json.dump(simulate(json.load(sys.stdin)), sys.stdout)
