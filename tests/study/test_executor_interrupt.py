"""Ctrl-C ends a study on an executor soon, and its workers with it; whole rows are kept."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from executors import BLOCK, Call, Inline, require_rows, require_same, study
from softpinch.study import engine as worker

pytestmark = pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
CONTEXTS = [name for name in ("fork", "spawn") if name in multiprocessing.get_all_start_methods()]
MANY = 20 * BLOCK


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


def test_a_worker_that_alone_is_interrupted_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    class Interrupted(Inline):
        """Ctrl-C comes in the middle of the first attempt at its second block."""

        def do(self, function: Callable[..., Any], call: Call) -> Any:
            def interrupted(spec: Any, block: Any, threads: int, watch: Any, *_: Any) -> Any:
                # Not from `watch` inside the core: a fast processor ends the block before it asks.
                if (call.block, call.attempt) == (1, 1):
                    signal.raise_signal(signal.SIGINT)
                    block = block.select(np.arange(9))
                    assert watch(9)
                return compute(spec, block, threads, watch)

            monkeypatch.setattr(worker, "compute", interrupted)
            before = signal.signal(signal.SIGINT, signal.default_int_handler)
            try:
                rows = super().do(function, call)
                done.append((call.block, call.attempt, len(rows)))
                return rows
            finally:
                signal.signal(signal.SIGINT, before)

    compute = worker.compute
    done: list[tuple[int, int, int]] = []
    how: dict[str, Any] = {"runs": 3 * BLOCK}
    some = study("sobol", executor=Interrupted(), **how)
    # What this call had sent to the worker before does not keep it at work.
    assert done == [(0, 1, BLOCK), (1, 1, 9), (1, 2, BLOCK), (2, 1, 0), (2, 2, BLOCK)]
    assert some.run.tolist() == list(range(3 * BLOCK)) and not some.interrupted
    expected = study("sobol", **how)
    assert some["final_state"].tobytes() == expected["final_state"].tobytes()
    # Another call is another matter.
    require_same(study(executor=Inline()))


class Held(Inline):
    """From its second block on, blocks come when Ctrl-C has reached this process."""

    def __init__(self) -> None:
        super().__init__()
        self.futures: list[Future[Any]] = []

    def submit(self, function: Callable[..., Any], /, *args: Any, **how: Any) -> Future[Any]:
        future = super().submit(function, *args, **how)
        if len(self.calls) == 1:
            return future
        self.futures.append(Future())
        if len(self.calls) == 6:
            # Blocks 1 to 3 have begun; 2 is cut short, and 3 is broken by its worker's Ctrl-C.
            for begun in self.futures[:3]:
                begun.set_running_or_notify_cancel()
            os.kill(os.getpid(), signal.SIGINT)
            call = self.calls[2]
            cut = call._replace(runs=call.runs.select(np.arange(9)))
            threading.Timer(0.2, self.come, (1, super().do(function, cut))).start()
            threading.Timer(0.3, self.futures[2].set_exception, (BrokenExecutor("dead"),)).start()
            threading.Timer(0.4, self.come, (0, super().do(function, self.calls[1]))).start()
        return self.futures[-1]

    def come(self, k: int, rows: Any) -> None:
        self.futures[k].set_result(rows)


def test_ctrl_c_cancels_what_has_not_begun_and_keeps_what_comes_within_a_moment() -> None:
    executor = Held()
    some = study("failures", executor=executor)
    assert some.interrupted and not some.lost
    assert [future.cancelled() for future in executor.futures] == [False] * 3 + [True] * 2
    require_rows(some, np.r_[: 2 * BLOCK, 2 * BLOCK : 2 * BLOCK + 9], "failures")
    assert "at most 1024 a worker" in some.interruption


def test_ctrl_c_leaves_out_blocks_cut_short_where_the_order_matters() -> None:
    some = study("stop_when", executor=Held())
    assert some.interrupted and not some.lost
    require_rows(some, np.arange(2 * BLOCK), "failures")


def test_ctrl_c_does_not_wait_for_a_block_that_takes_long() -> None:
    class Slow(Inline):
        def submit(self, function: Callable[..., Any], /, *args: Any, **how: Any) -> Future[Any]:
            if not self.calls:
                return super().submit(function, *args, **how)
            future: Future[Any] = Future()
            future.set_running_or_notify_cancel()
            began.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)
            return future

    began: list[float] = []
    some = study("failures", executor=Slow)
    assert 1.0 <= time.monotonic() - began[0] < 5.0
    assert some.interrupted and len(began) == 1
    require_rows(some, np.arange(BLOCK), "failures")


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
import softpinch as sp
from executors import BLOCK, SHAKEN
import softpinch as sp

context, folder = sys.argv[1], Path(sys.argv[2])
duration = np.full(40 * BLOCK, 2.0)
duration[: 2 * BLOCK] = 0.001
# Of every long block some runs are done at once.
duration[np.arange(40 * BLOCK) % BLOCK < 64] = 0.001


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
        print("back", flush=True)
    few = some.run[-3:]
    again = sp.monte_carlo(
        SHAKEN, vary={"duration": duration}, dt=1e-5, only=few, progress=False
    )
    same = again["final_state"].tobytes() == some["final_state"][-3:].tobytes()
    print(some.interrupted, some.lost, 2 * BLOCK < some.runs < 4 * BLOCK, same)
"""


@contextmanager
def driver(context: str, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A study in a process and a group of its own, in the middle of blocks."""
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
            yield process
        finally:
            # Its workers, too, which are at blocks of a minute.
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="there are no process groups")
# Processes that are forked are interrupted in the tests above and below.
@pytest.mark.parametrize(
    "context",
    [pytest.param(name, marks=pytest.mark.slow) if name == "fork" else name for name in CONTEXTS],
)
def test_ctrl_c_at_a_terminal_stops_workers_in_the_middle_of_long_blocks(
    context: str, tmp_path: Path
) -> None:
    with driver(context, tmp_path) as process:
        os.killpg(process.pid, signal.SIGINT)
        # A net: what they had on their way would take minutes.
        out, err = process.communicate(timeout=30)
    assert out == "back\nTrue () True True\n"
    # Not a word of the workers.
    assert err == ""
    assert process.returncode == 0


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="there are no process groups")
def test_ctrl_c_that_workers_do_not_hear_ends_the_call_all_the_same(tmp_path: Path) -> None:
    with driver(CONTEXTS[0], tmp_path) as process:
        os.kill(process.pid, signal.SIGINT)
        assert process.stdout is not None
        assert process.stdout.readline() == "back\n"


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="has no SIGALRM")
def test_an_exception_of_another_handler_ends_the_call_and_rows_are_kept(tmp_path: Path) -> None:
    class Slow(Inline):
        """Its second block never comes."""

        def submit(self, function: Callable[..., Any], /, *args: Any, **how: Any) -> Future[Any]:
            if not self.calls:
                return super().submit(function, *args, **how)
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGALRM)).start()
            return Future()

    def handle(number: int, frame: object) -> None:
        raise TimeoutError("deadline")

    before = signal.signal(signal.SIGALRM, handle)
    try:
        with pytest.raises(TimeoutError, match="deadline"):
            study("failures", executor=Slow(), runs=2 * BLOCK, store=tmp_path / "study")
    finally:
        signal.signal(signal.SIGALRM, before)
    require_rows(sp.Study.open(tmp_path / "study"), np.arange(BLOCK), "failures")
