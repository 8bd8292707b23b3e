"""Ctrl-C, or a progress function that raises, ends a study soon and loses nothing that is done."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import softpinch as sp
from softpinch import _core

# Longer than any machine needs to come back, and far shorter than the studies below.
SOON = 1.0
NOISY = sp.Scene(
    disturbances=[sp.Noise(force_std=1.0, moment_std=0.0, rate_hz=200.0)], duration=0.1
)
VARY = {"grasped.mass": sp.Normal(0.1, 0.01), "duration": sp.Uniform(0.02, 0.1)}
MANY = 100_000


class CtrlC:
    """A progress function that sends SIGINT some seconds after the computing has begun."""

    def __init__(self, after: float) -> None:
        self.timer = threading.Timer(after, self.send)
        self.begun = False
        self.sent = 0.0

    def send(self) -> None:
        self.sent = time.monotonic()
        os.kill(os.getpid(), signal.SIGINT)

    def __call__(self, done: int, runs: int) -> None:
        if not self.begun:
            self.begun = True
            self.timer.start()

    def require_soon(self) -> None:
        spent = time.monotonic() - self.sent
        self.timer.join()
        assert spent < SOON


def require_few_missing(some: sp.Ensemble, threads: int) -> None:
    """Runs begin in their order, and only those under way are missing."""
    assert (some.run[1:] > some.run[:-1]).all()
    assert some.run[-1] + 1 - some.runs <= 8 * threads
    assert "interrupted" not in set(some.status)


def study(**how: object) -> sp.Ensemble:
    return sp.monte_carlo(
        NOISY,
        seed=3,
        **{
            "runs": MANY,
            "vary": VARY,
            "dt": 1e-3,
            "summaries": ("final_state", *_core.SUMMARIES),
            "progress": False,
            **how,
        },
    )


@pytest.mark.parametrize(
    "how",
    [
        {"dt": 2e-5, "threads": 2},
        {"dt": 1e-4, "method": "radau5", "threads": 2},
        {"dt": None, "tolerance": 1e-12, "method": "dop853", "threads": 2},
        {"dt": None, "tolerance": 1e-9, "method": "rosenbrock", "threads": 1},
    ],
    ids=str,
)
def test_ctrl_c_keeps_all_runs_that_were_done(how: dict[str, object]) -> None:
    ctrl_c = CtrlC(0.25)
    some = study(**how, progress=ctrl_c)
    ctrl_c.require_soon()
    assert some.interrupted
    assert some.requested == MANY
    assert 0 < some.runs < MANY
    assert f"of {some.runs} runs of {MANY} requested" in repr(some) and "interrupted" in repr(some)
    assert some.interruption.startswith(
        f"interrupted: {some.runs} of {MANY} runs are kept; unfinished runs "
    )
    require_few_missing(some, int(str(how["threads"])))
    few = np.unique(np.linspace(0, some.runs - 1, 6).astype(int))
    again = study(only=some.run[few], **how)
    assert again.interruption == ""
    assert not again.interrupted
    for name, values in again.to_dict().items():
        np.testing.assert_array_equal(some.to_dict()[name][few], values, err_msg=name)


@pytest.mark.parametrize(
    "how",
    [
        {"dt": 1e-3, "method": "rk4", "threads": 1},
        {"dt": 1e-3, "method": "rk4", "threads": 2},
        {"tolerance": 1e-6, "method": "dop853", "threads": 1, "max_steps": 2**62},
        {"dt": 1e-3, "method": "radau5", "threads": 2},
    ],
    ids=str,
)
def test_ctrl_c_in_one_long_run_keeps_all_short_ones(how: dict[str, object]) -> None:
    duration = np.full(500, 0.01)
    duration[1] = 1e5
    told: list[int] = []

    def report(done: int, runs: int) -> None:
        told.append(done)
        if done == runs - 1 and told.count(done) == 1:
            os.kill(os.getpid(), signal.SIGINT)

    sway = sp.Scene(disturbances=[sp.Sine(frequency_hz=50.0, force=(0.1, 0.0))])
    some = sp.monte_carlo(sway, vary={"duration": duration}, progress=report, **how)
    assert some.interrupted and (some.runs, some.requested) == (499, 500)
    np.testing.assert_array_equal(some.run, np.delete(np.arange(500), 1))
    np.testing.assert_array_equal(some["duration"], 0.01)
    assert some.probability("completed").value == 1.0
    # It has been told of every one of them, and of none twice.
    assert told == sorted(told) and told[-1] == 499
    assert some.replay(499, record="state").t[-1] == 0.01
    with pytest.raises(IndexError, match="run 1 is not among the 499 runs"):
        some.replay(1)


def test_smaller_steps_are_compared_with_the_same_runs_after_ctrl_c() -> None:
    # Half the step of run 1 takes for ever, so it is under way when the others have been compared.
    duration = np.full(20, 0.01)
    duration[1] = 20.0
    refined = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))

    def report(done: int, runs: int) -> None:
        if done == runs:
            refined.start()

    some = sp.monte_carlo(
        NOISY, vary={"duration": duration}, dt=1e-5, threads=1, check_dt=True, progress=report
    )
    refined.join()
    assert some.interrupted and some.runs == some.requested == 20
    assert some.interruption.startswith(
        "interrupted: 20 of 20 runs are kept; the work after the runs"
    )
    assert some.discretisation is not None
    said = some.discretisation["final_state"]
    assert said.runs == 19
    short = np.delete(np.arange(20), 1)
    half = sp.monte_carlo(NOISY, vary={"duration": duration}, dt=5e-6, only=short, progress=False)
    difference = some["final_state"][short] - half["final_state"]
    np.testing.assert_array_equal(said.bias, difference.mean(axis=0))


@pytest.mark.parametrize(
    "how",
    [
        {"dt": 1e-4},
        {"dt": 1e-3, "method": "rosenbrock"},
        {"tolerance": 1e-10, "method": "dop853"},
        {"dt": 1e-4, "threads": 2, "summaries": tuple(_core.SUMMARIES)},
    ],
    ids=str,
)
def test_ctrl_c_ends_one_long_run(how: dict[str, object]) -> None:
    long = sp.Scene(duration=1e5, disturbances=[sp.Sine(frequency_hz=50.0, force=(0.1, 0.0))])
    ctrl_c = CtrlC(0.2)
    ensemble = sp.monte_carlo(long, 1, progress=ctrl_c, **how)
    ctrl_c.require_soon()
    assert ensemble.interrupted
    assert (ensemble.runs, ensemble.requested) == (0, 1)
    assert ensemble.counts() == {} and ensemble.failures() == []
    assert np.isnan(ensemble.probability().value)
    assert "0 runs of 1 requested" in repr(ensemble)


@pytest.mark.parametrize("how", [{"check_dt": True}, {"trajectories": (0,)}], ids=str)
def test_ctrl_c_in_what_follows_the_runs_loses_no_run(how: dict[str, object]) -> None:
    # The runs have just been done when the last report comes; what follows takes as long again.
    class Late(CtrlC):
        def __call__(self, done: int, runs: int) -> None:
            if done == runs:
                super().__call__(done, runs)

    late = Late(0.1)
    ensemble = sp.monte_carlo(NOISY, 1, dt=1e-7, progress=late, **how)
    late.require_soon()
    assert ensemble.interrupted and ensemble.status.tolist() == ["completed"]
    assert ensemble.trajectories == {}
    if ensemble.discretisation is not None:
        assert ensemble.discretisation["final_state"].runs == 0
        assert np.isnan(ensemble.discretisation["completed"].bias)


class Enough(Exception):
    """Raised by a progress function."""


@pytest.mark.parametrize(("at", "threads"), [(0, 1), (1, 2), (3, 1)])
def test_exceptions_of_a_progress_function_come_through(at: int, threads: int) -> None:
    calls: list[tuple[int, int]] = []
    raised = []

    def report(done: int, runs: int) -> None:
        calls.append((done, runs))
        if len(calls) > at:
            raised.append(time.monotonic())
            raise Enough(f"at {done}")

    with pytest.raises(Enough, match="at "):
        study(progress=report, threads=threads, dt=2e-5)
    assert time.monotonic() - raised[0] < SOON
    # It is not asked again, and it was told the truth.
    assert len(calls) == at + 1
    assert all(runs == MANY for _, runs in calls) and sorted(calls) == calls


def test_a_progress_function_may_give_the_ctrl_c() -> None:
    def report(done: int, runs: int) -> None:
        if done > 0:
            raise KeyboardInterrupt

    some = study(progress=report)
    assert some.interrupted and 0 < some.runs < MANY
