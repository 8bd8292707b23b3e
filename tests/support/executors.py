"""Executors that misbehave as asked, and studies of several kinds to give them."""

import pickle
import random
import threading
import time
from collections.abc import Callable, Collection
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import cache
from typing import Any, NamedTuple

import numpy as np

import softpinch as sp
from softpinch.study.rows import Rows

BLOCK = 1024
RUNS = 5 * BLOCK + 100
SHAKEN = sp.Scene(
    disturbances=[sp.Noise(force_std=20.0, moment_std=0.1, rate_hz=200.0)], duration=0.02
)
# Some of its grasps are lost.
SHOVED = sp.Scene(disturbances=[sp.Step(time=0.005)], duration=0.03)


def lighter(draw: np.random.Generator) -> float:
    return 0.1 - 0.01 * draw.random()


KINDS: dict[str, tuple[sp.Scene, dict[str, Any]]] = {
    "noise": (
        SHAKEN,
        {
            "vary": {"grasped.mass": lighter, "duration": sp.Uniform(0.01, 0.02)},
            "summaries": ("final_state", *sp._core.SUMMARIES),
        },
    ),
    "failures": (SHOVED, {"vary": {"disturbances.0.force": sp.Uniform((-180, -180), (180, 180))}}),
    "dop853": (SHAKEN, {"dt": None, "tolerance": 1e-6, "method": "dop853",
                        "formulation": "nullspace", "vary": {"control.kp": sp.Normal(100, 1)}}),
    "radau5": (sp.Scene(duration=0.01), {"method": "radau5", "formulation": "nullspace",
                                         "vary": {"grasped.mass": sp.Normal(0.1, 0.01)}}),
    "sobol": (SHAKEN, {"vary": {"gravity": sp.Uniform(9.7, 9.9)}, "sampler": "sobol"}),
    "only": (SHAKEN, {"only": np.arange(0, RUNS, 3), "vary": {"gravity": sp.Uniform(9.7, 9.9)}}),
    "check_dt": (SHAKEN, {"check_dt": True, "trajectories": (3, 2000)}),
    "stop_when": (
        SHOVED,
        {"vary": {"disturbances.0.force": sp.Uniform((-180, -180), (180, 180))},
         "stop_when": {"completed": 0.0285}},
    ),
}  # fmt: skip


def study(kind: str = "noise", **how: Any) -> Any:
    scene, arguments = KINDS[kind]
    given = {"runs": RUNS, "seed": 5, "dt": 1e-3, "progress": False, **arguments, **how}
    return sp.monte_carlo(scene, **given)


@cache
def on_threads(kind: str = "noise", runs: int = RUNS) -> sp.Ensemble:
    ensemble: sp.Ensemble = study(kind, runs=runs, threads=1)
    return ensemble


def require_same(found: Any, kind: str = "noise", runs: int = RUNS) -> None:
    """All that a study came to, bit by bit."""
    expected = on_threads(kind, runs)
    assert not found.lost and not found.interrupted
    require_rows(found, expected.run, kind, runs)
    # A study also has those that `only` left out to compute yet.
    assert found.requested == (runs if isinstance(found, sp.Study) else expected.requested)
    assert list(found.trajectories) == list(expected.trajectories)
    for run, path in expected.trajectories.items():
        assert found.trajectories[run].q.tobytes() == path.q.tobytes()
    assert (found.discretisation is None) == (expected.discretisation is None)
    for name, said in (expected.discretisation or {}).items():
        for field, value in vars(said).items():
            ours = getattr(found.discretisation[name], field)
            assert np.asarray(ours).tobytes() == np.asarray(value).tobytes(), (name, field)


def require_rows(found: Any, numbers: Any, kind: str = "noise", runs: int = RUNS) -> None:
    """Just these rows, bit by bit."""
    expected = on_threads(kind, runs)
    np.testing.assert_array_equal(found.run, numbers)
    rows = np.searchsorted(expected.run, found.run)
    table = found.to_dict()
    assert list(table) == list(expected.to_dict())
    for name, values in expected.to_dict().items():
        if values.dtype.kind == "f":
            assert table[name].tobytes() == values[rows].tobytes(), name
        else:
            assert table[name].tolist() == values[rows].tolist(), name


class Call(NamedTuple):
    """The arguments of `softpinch.study.engine.work`."""

    call: str
    attempt: int
    version: int
    spec: bytes
    runs: Rows
    threads: int

    @property
    def block(self) -> int:
        return int(self.runs.run[0]) // BLOCK


class Inline(Executor):
    """Does at once what is submitted, as if in a process: all is pickled; tests override `do`."""

    def __init__(self) -> None:
        self.calls: list[Call] = []
        self.shut = 0

    def submit(self, function: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        call = Call(*args)
        self.calls.append(call)
        try:
            future.set_result(self.do(function, call))
        except BaseException as error:
            future.set_exception(error)
        return future

    def do(self, function: Callable[..., Any], call: Call) -> Any:
        sent = pickle.loads(pickle.dumps(tuple(call)))
        return pickle.loads(pickle.dumps(function(*sent)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self.shut += 1

    def attempts(self, block: int) -> int:
        return sum(call.block == block for call in self.calls)


class Shuffled(Inline):
    """Does what is submitted in an order of its own.

    Each time it takes the one of all that wait which `choose` names, once no more come. A deadly
    block breaks it, and the others that wait are never heard of again.
    """

    def __init__(self, choose: Callable[[list[Call]], int], deadly: Collection[int] = ()) -> None:
        super().__init__()
        self._choose = choose
        self._deadly = deadly
        self.waiting: list[tuple[Future[Any], Callable[..., Any], Call]] = []
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._broken = False
        self.most = 0
        self.order: list[int] = []
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    @classmethod
    def by_chance(cls, seed: int, deadly: Collection[int] = ()) -> "Shuffled":
        draw = random.Random(seed)
        return cls(lambda waiting: draw.randrange(len(waiting)), deadly)

    def submit(self, function: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        with self._lock:
            if self._broken:
                raise BrokenExecutor("a worker died")
            self.waiting.append((future, function, Call(*args)))
            self.calls.append(self.waiting[-1][2])
            self.most = max(self.most, len(self.waiting))
        return future

    def _serve(self) -> None:
        before = 0
        while not self._over.wait(0.001):
            with self._lock:
                still, before = len(self.waiting) == before, len(self.waiting)
                if not before or not still:
                    continue
                k = self._choose([call for _, _, call in self.waiting])
                future, function, call = self.waiting.pop(k)
                self._broken = call.block in self._deadly
            if self._broken:
                future.set_exception(BrokenExecutor("a worker died"))
                return
            if not future.set_running_or_notify_cancel():
                continue
            self.order.append(call.block)
            try:
                future.set_result(self.do(function, call))
            except Exception as error:
                future.set_exception(error)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        super().shutdown()
        self._over.set()
        self._thread.join()


def until(true: Callable[[], bool], seconds: float = 30.0) -> None:
    """Waits for something that must come; the limit is a net."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)
