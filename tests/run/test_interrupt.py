"""A long run can be stopped, keeps what it has done, and leaves other threads alone."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from alarms import alarm
from softpinch.run.request import Request

LONG = sp.Scene(duration=1e4)


@pytest.fixture(autouse=True)
def no_collection() -> Iterator[None]:
    """Python ignores an exception of a signal that comes while a callback of the collector runs.

    Hypothesis and JAX have such callbacks.
    """
    gc.disable()
    yield
    gc.enable()


# Steps of free length stay short, too.
PUSHED = replace(LONG, disturbances=(sp.Sine(frequency_hz=50.0, force=(0.5, 0.0)),))


def test_ctrl_c_gives_the_run_so_far_with_a_status() -> None:
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begun = time.monotonic()
    run = sp.simulate(LONG, dt=1e-4, every=10_000)
    # Generous: this is about minutes against seconds, no measurement.
    assert time.monotonic() - begun < 10.0
    assert run.status == "interrupted"
    assert not run.success
    assert "stopped from outside at t = " in run.message
    assert 0.0 < run.t[-1] < LONG.duration
    went_on = sp.simulate(sp.Scene(initial=run.state(-1), duration=0.01), dt=1e-4)
    assert went_on.success
    np.testing.assert_array_equal(went_on.q[0], run.q[-1])


def test_processes_of_tests_have_the_default_handler() -> None:
    program = "import signal; assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_ctrl_c_is_heard_where_the_shell_ignores_it() -> None:
    """A shell ignores SIGINT in its background jobs, and what these start inherits it."""
    own = [test_ctrl_c_gives_the_run_so_far_with_a_status]
    started = [test_processes_of_tests_have_the_default_handler]
    tests = [f"{__file__}::{test.__name__}" for test in own + started]
    pytests = [sys.executable, "-m", "pytest", "--quiet", "-p", "no:cacheprovider", *tests]
    ignoring = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", *pytests]
    done = subprocess.run(ignoring, capture_output=True, text=True, timeout=100.0)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("error", [SystemExit(143), TimeoutError("late")], ids=repr)
@pytest.mark.parametrize("how", [{"dt": 1e-4}, {"tolerance": 1e-8, "method": "radau5"}], ids=str)
def test_exceptions_of_signal_handlers_pass_through_a_run(
    error: BaseException, how: dict[str, Any]
) -> None:
    with pytest.raises(type(error)) as found, alarm(error):
        sp.simulate(PUSHED, record=(), **how)
    assert found.value is error


def states(n: int) -> list[np.ndarray]:
    """The start at `n` instants: t, q, p and integral."""
    start = sp.Scene().start()
    rows = [np.broadcast_to(one, (n, len(one))) for one in (start.q, start.p, start.integral)]
    return [np.zeros(n), *rows]


# All of these take far longer than the tests wait.
HEARING: dict[str, Callable[[], object]] = {
    "modes": lambda: sp.modes(sp.Scene(), *states(30_000)),
    "max_stable_dt": lambda: sp.max_stable_dt(PUSHED),
    "advise": lambda: sp.advise(PUSHED),
    "stability_map": lambda: sp.stability_map(
        PUSHED, "object_mass", [0.08, 0.1], max_steps=10**9, progress=False
    ),
}


@pytest.mark.parametrize("work", HEARING.values(), ids=HEARING)
@pytest.mark.parametrize("error", [KeyboardInterrupt(), TimeoutError("late")], ids=repr)
def test_exceptions_of_signal_handlers_pass_through_long_computations(
    work: Callable[[], object], error: BaseException
) -> None:
    with pytest.raises(type(error)), alarm(error):
        work()


FREE: dict[str, Callable[[], object]] = {
    "simulate": lambda: sp.simulate(sp.Scene(duration=20.0), dt=1e-4, every=10**6),
    "max_stable_dt": lambda: sp.max_stable_dt(sp.Scene(duration=1.0), measure=False),
}


@pytest.mark.parametrize("compute", FREE.values(), ids=FREE)
def test_the_interpreter_is_free_meanwhile(compute: Callable[[], object]) -> None:
    ticks, stop = [], threading.Event()

    def work() -> None:
        while not stop.wait(1e-3):
            ticks.append(time.monotonic())

    thread = threading.Thread(target=work)
    thread.start()
    try:
        begun = time.monotonic()
        compute()
        took = time.monotonic() - begun
    finally:
        stop.set()
        thread.join()
    # The other thread worked all along, not only before and after.
    tenths = {int(10.0 * (tick - begun) / took) for tick in ticks}
    assert len(tenths & set(range(10))) >= 5


@pytest.mark.parametrize(
    ("steps", "finer"),
    [({"dt": 1e-3}, "dt/2"), ({"tolerance": 1e-4, "method": "radau5"}, "halves")],
)
@pytest.mark.parametrize("refined", [2, 4])
def test_ctrl_c_in_an_error_estimate_keeps_the_run(
    refined: int, steps: dict[str, Any], finer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = Request.simulation

    def interrupted(self: Request, refine: int = 1, *rest: Any) -> Any:
        if refine == refined:
            signal.raise_signal(signal.SIGINT)
        return simulation(self, refine, *rest)

    scene = sp.Scene(duration=0.01)
    how: dict[str, Any] = {**steps, "record": ("state", "multipliers")}
    whole = sp.simulate(scene, **how)
    with monkeypatch.context() as patch:
        patch.setattr(Request, "simulation", interrupted)
        run = sp.simulate(scene, **how, estimate_error=True)
    assert run.status == whole.status == "completed"
    np.testing.assert_array_equal(run.q, whole.q)
    error = run.error_estimate
    assert error.interrupted and not error.asymptotic
    assert str(error).startswith(f"the error cannot be estimated: the runs with {finer}")
    assert error.q is not None and error.q.shape == run.q.shape and np.isinf(error.q).all()
    assert error.largest == dict.fromkeys(("q", "p", "multipliers"), np.inf)
    assert not sp.simulate(scene, **how, estimate_error=True).error_estimate.interrupted
