"""A long run can be stopped, keeps what it has done, and leaves other threads alone."""

import os
import signal
import threading
import time

import numpy as np

import softpinch as sp

LONG = sp.Scene(duration=1e4)


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


def test_the_interpreter_is_free_during_a_run() -> None:
    count, stop = 0, threading.Event()

    def work() -> None:
        nonlocal count
        while not stop.is_set():
            count += 1
            time.sleep(0.0)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        before = count
        sp.simulate(sp.Scene(duration=20.0), dt=1e-4, every=10**6)
        during = count - before
    finally:
        stop.set()
        thread.join()
    assert during > 100
