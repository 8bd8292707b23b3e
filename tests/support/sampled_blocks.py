"""A block of a discrete controller as its documentation says, for loops that others compute."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch import reference

# Instants this close are one.
SAME = 1e-11
# Nearly the torque tau: K_P (tau / K_P - theta) = tau - K_P theta.
WEAK = 1e-12
# A switch and a push between samples.
TURN = sp.Schedule.steps([0.0, 0.0125], np.deg2rad([[6.0, 6.0], [8.0, 5.0]]))
PUSH = sp.Pulse(time=0.0205, duration=0.01, force=(3.0, -1.0), moment=0.01)


def drawn(control: sp.SampledController, after: int, number: int) -> np.ndarray:
    """The uniform numbers of a sample of the block with `after` blocks after it, by NumPy."""
    key = np.array([control.seed, control.run], np.uint64)
    # NumPy counts on before it draws, from the lowest word.
    counter = [number, 2**64 - 1 - after, 2**64 - 1, 0]
    low = (sum(int(word) << (64 * k) for k, word in enumerate(counter)) - 1) % 2**256
    words = np.array([(low >> (64 * k)) & (2**64 - 1) for k in range(4)], np.uint64)
    return (np.random.Philox(key=key, counter=words).random_raw(4) >> 11) * 2.0**-53


class Block:
    """One block as its documentation says, with lists of all that it has measured and put out."""

    def __init__(self, control: sp.SampledController, after: int, end: float) -> None:
        self.control = control
        count = int((end + 1e-9) / control.period) + 2
        draws = np.array([drawn(control, after, k) for k in range(count)])
        late = control.jitter * draws[:, 1]
        if control.jitter_kind == "normal":
            radius = np.sqrt(-2.0 * np.log(1.0 - draws[:, 1]))
            late = control.jitter * np.abs(radius * np.cos(2.0 * np.pi * draws[:, 2]))
        late = np.minimum(late, 0.999 * control.period)
        self.taken = np.arange(count) * control.period + control.first_sample + late
        self.used = self.taken + control.measure_delay
        self.acting = self.used + control.delay
        self.lost = draws[:, 0] < control.loss
        self.lost[0] = False
        self.xi = np.array(control.initial_state)
        self.seen: list[np.ndarray] = []
        self.outputs: list[np.ndarray] = []
        self.second = False
        self.force = np.array(control.initial_torque)

    def due(self, instants: np.ndarray, t: float) -> bool:
        return bool((np.abs(instants - t) < SAME).any())

    def gains(self, t: float, y: np.ndarray) -> list[Any]:
        """A, B, C and D of a sample that is used at t, by its measurements y."""
        of, switch = self.control, self.control.switch
        if switch is not None:
            own: list[float] = []
            for name in of.measures:
                numbers, y = np.split(y, [sp._core.MEASURES[name]])
                own += numbers.tolist() if name == switch.measure else []
            now = switch.at is not None and t > switch.at - SAME
            now = now or (switch.above is not None and max(own) > switch.above)
            now = now or (switch.below is not None and min(own) < switch.below)
            self.second = now or (switch.latched and self.second)
            if self.second:
                of = replace(of, switch=None, **switch.gains)  # type: ignore[arg-type]
        return [of.A, of.B, of.C, of.D]

    def at(self, t: float, q: Any, p: Any, target: Any, schedule: Any) -> None:
        of = self.control
        if self.due(self.taken, t):
            k = len(self.seen)
            now = {"angle_error": q[3:5], "angle_rate": p[3:5], "rotation": q[2:3]}
            now |= {"velocity": p[:2], "target": [0, 0], "schedule": [0, 0], "target_rate": [0, 0]}
            y = np.hstack([np.array(now[name], dtype=float) for name in of.measures])
            self.seen.append(self.seen[-1] if self.lost[k] else y)
        if self.due(self.used, t):
            y, first = self.seen[len(self.outputs)].copy(), 0
            for name in of.measures:
                own = slice(first, first := first + sp._core.MEASURES[name])
                y[own] += {"angle_error": -target, "target": target, "schedule": schedule}.get(
                    name, 0.0 * y[own]
                )
            zone = np.asarray(of.dead_zone)
            y = np.sign(y) * np.maximum(np.abs(y) - zone, 0.0)
            a, b, c, d = self.gains(t, y)
            u = c @ self.xi + d @ y
            if of.limits is not None:
                u = np.clip(u, of.limits[:, 0], of.limits[:, 1])
            if of.rate_limit is not None:
                last = self.outputs[-1] if self.outputs else np.array(of.initial_torque)
                most = of.rate_limit * of.period
                u = np.clip(u, last - most, last + most)
            if of.no_load_rate is not None:
                assert of.limits is not None
                k = sum(
                    sp._core.MEASURES[n] for n in of.measures[: of.measures.index("angle_rate")]
                )
                share = y[k : k + 2] / of.no_load_rate
                low, high = of.limits.T
                u = np.clip(u, low * np.clip(1 + share, 0, 1), high * np.clip(1 - share, 0, 1))
            self.outputs.append(u)
            self.xi = a @ self.xi + b @ y
        if self.due(self.acting, t):
            self.force = self.outputs[int(np.argmin(np.abs(self.acting - t)))]


def under_held_torques(
    scene: sp.Scene, state: sp.State, begin: float, end: float, torque: np.ndarray
) -> sp.State:
    """The state at `end` of a scene whose fingers have these torques from `begin` on, by SciPy."""
    held = replace(
        scene,
        control=sp.Pid(kp=WEAK, kd=0.0, ki=0.0),
        schedule=sp.Schedule.steps([0.0], [torque / WEAK]),
        initial=replace(state, time=begin, check=False),
        duration=end - begin,
    )
    with pytest.MonkeyPatch.context() as patch:
        # A rough run for the sizes of the states would take longer than so short a segment.
        patch.setattr("softpinch.accuracy.reference._ROUGH", ())
        run = reference.solve(held, np.array([begin + held.duration]), tolerance=1e-12)
    return sp.State(run.q[-1], run.p[-1])
