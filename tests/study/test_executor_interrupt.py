"""Ctrl-C ends a study on an executor soon, and its workers with it; whole rows are kept."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executors import BLOCK, Call, Inline, require_rows, require_same, study, until

pytestmark = pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
CONTEXTS = [name for name in ("fork", "spawn") if name in multiprocessing.get_all_start_methods()]
MANY = 60 * BLOCK


class Enough(Exception):
    pass


@pytest.mark.parametrize("at", [0, 1, 3])
def test_what_a_progress_function_raises_comes_through(at: int) -> None:
    calls = []

    def report(done: int, runs: int) -> None:
        calls.append(done)
        if done >= at * BLOCK:
            raise Enough(f"at {done}")

    pools: list[ThreadPoolExecutor] = []

    def make() -> ThreadPoolExecutor:
        pools.append(ThreadPoolExecutor(1))
        return pools[-1]

    with pytest.raises(Enough, match="at "):
        study(runs=200 * BLOCK, executor=make, progress=report)
    # It is not asked again, and nothing goes on.
    assert calls[-1] >= at * BLOCK and all(done < at * BLOCK for done in calls[:-1])
    with pytest.raises(RuntimeError, match="after shutdown"):
        pools[0].submit(print)
    for thread in list(pools[0]._threads):
        thread.join(30)
        assert not thread.is_alive()


@pytest.mark.parametrize("often", [False, True])
def test_a_progress_function_may_give_the_ctrl_c(often: bool) -> None:
    raised = []

    def report(done: int, runs: int) -> None:
        if done and (often or not raised):
            raised.append(done)
            raise KeyboardInterrupt

    with ThreadPoolExecutor(2) as pool:
        some = study(runs=MANY, executor=pool, progress=report)
    assert some.interrupted and 0 < some.runs < MANY
    assert raised[0] <= some.runs
    require_rows(some, some.run, runs=MANY)


def test_a_worker_that_alone_is_interrupted_loses_nothing() -> None:
    # Blocks that are long enough to be in the middle of.
    class Interrupted(Inline):
        def do(self, function: Callable[..., Any], call: Call) -> Any:
            if self.attempts(call.block) > 1 or call.block != 1:
                return super().do(function, call)
            sign = Path(f"{call.end}.here")
            sign.touch()
            try:
                return super().do(function, call._replace(end=str(sign)))
            finally:
                sign.unlink()

    executor = Interrupted()
    how: dict[str, Any] = {"dt": 1e-5, "runs": 2 * BLOCK}
    some = study("sobol", executor=executor, **how)
    assert executor.attempts(1) == 2
    assert some.run.tolist() == list(range(2 * BLOCK)) and not some.interrupted
    expected = study("sobol", **how)
    assert some["final_state"].tobytes() == expected["final_state"].tobytes()


def test_ctrl_c_keeps_whole_rows_of_blocks_that_workers_had_begun() -> None:
    # Threads, which get no signal: they see the sign.
    def report(done: int, runs: int) -> None:
        if not done and not timer.is_alive() and not timer.finished.is_set():
            timer.start()

    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    long: dict[str, Any] = {"dt": 5e-7, "runs": 50 * BLOCK}
    with ThreadPoolExecutor(2) as pool:
        some = study("sobol", executor=pool, progress=report, **long)
    timer.join()
    assert some.interrupted and not some.lost
    # Of two blocks, neither came to its end; those that were taken up then had hardly begun.
    assert 0 < some.runs < 2 * BLOCK
    assert {0, 1} < set((some.run // BLOCK).tolist())
    assert some.interruption.endswith("short ones")
    few = some.run[:: max(1, some.runs // 3)]
    again = study("sobol", only=few, **long)
    rows = np.searchsorted(some.run, few)
    assert some["final_state"][rows].tobytes() == again["final_state"].tobytes()


@pytest.mark.parametrize("context", CONTEXTS)
def test_a_study_on_processes_goes_on_after_ctrl_c(context: str, tmp_path: Path) -> None:
    def report(done: int, runs: int) -> None:
        if done and not sent:
            sent.append(done)
            os.kill(os.getpid(), signal.SIGINT)

    sent: list[int] = []
    store = tmp_path / "study"
    with ProcessPoolExecutor(2, multiprocessing.get_context(context)) as executor:
        some = study("failures", runs=MANY, executor=executor, store=store, progress=report)
        assert some.interrupted and not some.lost
        assert sent[0] <= some.runs < MANY
        require_rows(some, some.run, "failures", MANY)
        # The same pool can be used again.
        again = some.resume(executor=executor, progress=False)
    require_same(again, "failures", MANY)


# Two short blocks, then blocks of a minute: workers that go on with them would be seen.
DRIVER = """
import multiprocessing, os, sys, threading
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
import numpy as np
from executors import BLOCK, SHAKEN
import softpinch as sp

context, folder = sys.argv[1], Path(sys.argv[2])
duration = np.full(40 * BLOCK, 2.0)
duration[: 2 * BLOCK] = 0.001


def begin():
    (folder / str(os.getpid())).touch()


def report(done, runs):
    if done >= 2 * BLOCK and len(list(folder.iterdir())) == 2 and not told:
        told.append(done)
        # By then both are in the middle of a long block.
        threading.Timer(1.0, print, ("begun",), {"flush": True}).start()


told = []
if __name__ == "__main__":
    with ProcessPoolExecutor(2, multiprocessing.get_context(context), initializer=begin) as pool:
        some = sp.monte_carlo(
            SHAKEN, vary={"duration": duration}, dt=1e-5, executor=pool, progress=report
        )
    few = some.run[-3:]
    again = sp.monte_carlo(
        SHAKEN, vary={"duration": duration}, dt=1e-5, only=few, progress=False
    )
    same = again["final_state"].tobytes() == some["final_state"][-3:].tobytes()
    print(some.interrupted, some.lost, 2 * BLOCK < some.runs < 4 * BLOCK, same)
"""


@contextmanager
def driver(context: str, tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """A study in a process and a group of its own, in the middle of blocks; and its workers."""
    script, folder = tmp_path / "driver.py", tmp_path / "workers"
    script.write_text(DRIVER)
    folder.mkdir()
    with subprocess.Popen(
        [sys.executable, str(script), context, str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "begun\n"
            yield process, [int(path.name) for path in folder.iterdir()]
        finally:
            process.kill()


def gone(worker: int) -> bool:
    """Whether a process is no more, also where nobody has asked for its end."""
    try:
        state = Path(f"/proc/{worker}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return True
    return state == "Z"


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="there are no process groups")
@pytest.mark.parametrize("context", CONTEXTS)
@pytest.mark.parametrize("kill", ["driver", "group"])
def test_ctrl_c_stops_workers_in_the_middle_of_long_blocks(
    context: str, kill: str, tmp_path: Path
) -> None:
    with driver(context, tmp_path) as (process, _):
        (os.killpg if kill == "group" else os.kill)(process.pid, signal.SIGINT)
        # A net: what they had on their way would take minutes.
        out, err = process.communicate(timeout=30)
    assert out == "True () True True\n"
    # Not a word of the workers.
    assert err == ""
    assert process.returncode == 0


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no list of processes")
@pytest.mark.parametrize("context", CONTEXTS)
def test_workers_end_with_a_driver_that_is_killed(context: str, tmp_path: Path) -> None:
    with driver(context, tmp_path) as (process, workers):
        assert len(workers) == 2 and not any(map(gone, workers))
        os.kill(process.pid, signal.SIGKILL)
        until(lambda: all(map(gone, workers)))
