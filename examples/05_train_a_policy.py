"""Train a policy
==============

Train a policy that holds a pinch against pushes, and compare it with a PID of tuned gains::

    python examples/05_train_a_policy.py [learning_curve.png] [--quick]

Both controllers act in the same environment, once every 2 ms. The PID turns each finger by the
error of its own angle, with a constant extra grip. The policy sees all that the environment
observes, and squeezes where it feels a push. One evolution strategy sets the numbers of both, with
the same pushes, the same number of generations and the same number of episodes. Then both meet
pushes that they have not seen. Needs the extras `gym` and `plot`; takes about a minute and a half.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import softpinch as sp
import softpinch.gym

Floats = NDArray[np.float64]
Controller = Callable[[Floats, Floats], Floats]

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", default="learning_curve.png", type=Path)
parser.add_argument("--quick", action="store_true", help="few generations, to see that it runs")
arguments = parser.parse_args()

DIRECTIONS, EPISODES = (4, 2) if arguments.quick else (16, 12)
GENERATIONS, EVERY, LOOKS, TESTS = (2, 1, 4, 8) if arguments.quick else (40, 4, 384, 2000)
# Training takes seeds from 0 on. Other pushes choose the generation, and others again are the test.
LOOK_SEED, TEST_SEED = 1_000_000, 2_000_000

# Where the entries of the observation are after right and left, and the sign of x, have changed.
MIRROR = [0, 1, 2, 3, 4, 5, 7, 6, 9, 8, 11, 10, 13, 12, 15, 14, 17, 16, 19, 18, 20]
SIGNS = np.ones(21)
SIGNS[[0, 2, 3, 5, 20]] = -1.0  # x, theta, their rates, and the path


def policy(weights: Floats, seen: Floats) -> Floats:
    """Actions of weights (n, 43) for observations (n, 21), and for their mirror images."""

    def one(seen: Floats) -> Floats:
        linear, size, bias = weights[:, :21], weights[:, 21:42], weights[:, 42]
        return (linear * seen).sum(axis=1) + (size * np.abs(seen)).sum(axis=1) + bias

    return np.column_stack([one(seen), one(SIGNS * seen[:, MIRROR])])


class Pid:
    """Gains (n, 4): of angle, its rate and its integral, and a constant extra grip."""

    def __init__(self) -> None:
        self.integral: Floats | float = 0.0

    def __call__(self, gains: Floats, seen: Floats) -> Floats:
        angle, rate = seen[:, 6:8], seen[:, 8:10]  # of the fingers, scaled
        self.integral = self.integral + 2e-3 * angle
        p, d, i, grip = gains.T[:, :, None]
        return grip - p * angle - d * rate - 10.0 * i * self.integral


def returns(controller: Controller, numbers: Floats, seeds: list[int]) -> tuple[Floats, Floats]:
    """Returns of one episode for each row of numbers (n, k), and whether each grasp has held."""
    n = len(numbers)
    envs = ENVS[n]
    seen, _ = envs.reset(seed=seeds)
    total, alive, held = np.zeros(n), np.ones(n, bool), np.zeros(n, bool)
    while alive.any():
        seen, reward, terminated, truncated, _ = envs.step(controller(numbers, seen))
        total += np.where(alive, reward, 0.0)
        held |= alive & truncated
        alive &= ~(terminated | truncated)
    return total, held.astype(float)


def train(make: Callable[[], Controller], start: Floats, size: float, rate: float) -> list[Floats]:
    """Evolution strategy: tries directions both ways, ranks them, and climbs (Salimans 2017)."""
    random = np.random.default_rng(7)
    mean, momentum, history = start, np.zeros_like(start), [start]
    for generation in range(GENERATIONS):
        tried = random.standard_normal((DIRECTIONS, len(mean)))
        tried = np.concatenate([tried, -tried])
        # All candidates of a generation meet the same pushes.
        seeds = [EPISODES * generation + k for k in range(EPISODES)] * len(tried)
        numbers = np.repeat(mean + size * tried, EPISODES, axis=0)
        total = returns(make(), numbers, seeds)[0].reshape(len(tried), EPISODES).mean(axis=1)
        rank = total.argsort().argsort() / (len(tried) - 1) - 0.5
        momentum = 0.8 * momentum + rank @ tried / len(tried)
        # Ever smaller steps, so that the end does not jump about.
        mean = mean + rate * (1.0 - 0.8 * generation / GENERATIONS) * momentum
        history.append(mean)
    return history


def interval(values: Floats) -> float:
    """Half the width of the 95 % confidence interval of the mean."""
    return float(1.96 * values.std(ddof=1) / np.sqrt(len(values)))


def unseen(make: Callable[[], Controller], numbers: Floats, n: int, first: int) -> list[Floats]:
    """Returns, and whether the grasp has held, of one controller on n pushes from a seed on."""
    return list(returns(make(), np.tile(numbers, (n, 1)), list(range(first, first + n))))


ENVS = {
    n: gymnasium.make_vec("softpinch/Pinch-v0", num_envs=n)
    for n in {2 * DIRECTIONS * EPISODES, LOOKS, TESTS}
}
PID = np.array([2.0, 0.8, 0.0, 0.0])
FIRST = np.zeros(43)
FIRST[[6, 8]] = -PID[:2]  # the policy starts as the PID does, and learns all of the rest
CONTROLLERS: dict[str, tuple[Callable[[], Controller], Floats, float, str]] = {
    "PID of the angles, tuned gains": (Pid, PID, 0.1, "#7A7A7A"),
    "policy, 43 weights": (lambda: policy, FIRST, 0.05, "#1F5FA8"),
}

tested = []
with sp.plot.styled():
    figure = Figure(figsize=(7.0, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, (make, start, size, colour) in CONTROLLERS.items():
        began = time.perf_counter()
        history = train(make, start, size, 0.3)
        seconds = time.perf_counter() - began
        at = np.arange(0, GENERATIONS + 1, EVERY)
        looks = [unseen(make, history[k], LOOKS, LOOK_SEED) for k in at]
        for axes, which in ((left, 0), (right, 1)):
            mean = np.array([look[which].mean() for look in looks])
            half = np.array([interval(look[which]) for look in looks])
            marker = "s--" if make is Pid else "o-"
            axes.plot(at, mean, marker, color=colour, markersize=3.5, label=name)
            axes.fill_between(at, mean - half, mean + half, color=colour, alpha=0.2, linewidth=0)
        best = history[at[np.argmax([look[0].mean() for look in looks])]]
        total, held = unseen(make, best, TESTS, TEST_SEED)
        print(
            f"{name}: return {total.mean():.3f} ± {interval(total):.3f}, "
            f"{100 * held.mean():.1f} ± {100 * interval(held):.1f} % held, "
            f"in {TESTS} episodes with unseen pushes (trained in {seconds:.0f} s)"
        )
        tested.append((total, held))
    left.set_ylabel("mean return of an episode [1]")
    right.set_ylabel("share of grasps that held [1]")
    for axes in (left, right):
        axes.set_xlabel("generation of the evolution strategy")
    right.legend(loc="lower right", title="95 % intervals shaded")
# Both have met the same pushes, so the differences have smaller intervals.
(pid_total, pid_held), (total, held) = tested
more, safer = total - pid_total, 100 * (held - pid_held)
print(f"policy - PID: return {more.mean():+.3f} ± {interval(more):.3f}", end=", ")
print(f"held {safer.mean():+.1f} ± {interval(safer):.1f} points")
print("saved", sp.plot.save(figure, arguments.picture))
