"""Beyond one process: two workers against one, what the store costs, a folder of 10 000 parts, the
driver's memory, and 1e9 runs on paper.

make bench-scale

Takes some minutes; leave the other cores alone. With --document, as make has it, the tables go into
docs/scale-out.md.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median

import softpinch as sp
from command import parser
from document import ROOT, put
from machine import describe
from scale_driver import Driver, driver
from scale_folder import found, make, reading
from scale_paper import Rates, project
from scale_work import Timed, engines, file_system, in_turns, push, short, size, stopwatch
from softpinch.store import files
from softpinch.store.folder import Writer
from softpinch.study.engine import how_many_threads
from softpinch.study.sampling import Draws
from softpinch.study.sources import BLOCK

Text = Iterator[tuple[str, str]]


def workers(given: argparse.Namespace, scratch: Path) -> Text:
    """Executors side by side, and the driver's share of their time."""
    lines = []
    with engines() as who:
        pushed = partial(push, dt=given.dt)
        for name, study, runs in (
            (f"disturbance (ii), {1.5 / given.dt:.0f} steps a run", pushed, given.push),
            ("0.1 s, 1000 steps a run", short, given.short),
        ):
            for how in who.values():
                study(min(runs, 4 * BLOCK), **how)
            spent = in_turns(
                {k: partial(study, runs, **how) for k, how in who.items()}, given.rounds
            )
            lines += [f"{name}, {runs} runs", *_workers(spent, runs), ""]
            if study is pushed:
                rate = runs / spent["one process"].median
                share = 1 / spent["two processes"].ratio / 2
    cost = driver(given.blocks, given.dt, scratch)
    lines += _driver(cost, BLOCK / rate)
    yield "scale workers", _fenced(lines)
    pushed(given.push, store=scratch / "bytes")
    rates = Rates(rate, share, cost, size(scratch / "bytes") / given.push)
    yield "scale paper", _fenced(project(rates, given.cores, given.price))


def _workers(spent: dict[str, Timed], runs: int) -> list[str]:
    return [
        f"  {'':20s} {'s':>7s} {'(least, most)':>17s} {'runs/s':>9s} {'to one process':>15s}",
        *(
            f"  {name:20s} {one.median:7.2f} {one.span:>17s} {runs / one.median:9.0f} "
            f"{1 / one.ratio:15.2f}"
            for name, one in spent.items()
        ),
    ]


def _driver(cost: Driver, block: float) -> list[str]:
    rows = {
        "draw, twice": cost.draw,
        "check every run": cost.check,
        "pickle there and back": cost.travel,
        "write the store": cost.store,
        "accept, and the rest": cost.rest,
        "in all": cost.total,
    }
    return [
        "what the driver does for a block of 1024 runs of disturbance (ii), with a store",
        *(f"  {name:24s} {1e3 * seconds:7.2f} ms" for name, seconds in rows.items()),
        f"  a worker computes it in {1e3 * block:.0f} ms: the driver of a long study feeds "
        f"{block / cost.during:.0f} of them",
    ]


def store(given: argparse.Namespace, scratch: Path) -> Text:
    """The same study with and without a store, in turns."""
    runs = given.runs
    short(min(runs, 4 * BLOCK), store=scratch / "warm")
    turn = iter(range(given.rounds))
    with stopwatch(
        ("encode", files, "encode"),
        ("hash", hashlib, "sha256"),
        ("bring to the disk", os, "fsync"),
        ("flush", Writer, "flush"),
        ("draw", Draws, "rows"),
    ) as spent:
        works: dict[str, Callable[[], object]] = {
            "without": lambda: short(runs),
            "with": lambda: short(runs, store=scratch / f"store{next(turn)}"),
        }
        times = in_turns(works, given.rounds)
    last = scratch / f"store{given.rounds - 1}"
    study = sp.Study.open(last)
    # Of three drawings two are with a store.
    split = {name: spent[name] / given.rounds for name in ("encode", "hash", "bring to the disk")}
    split["gather, sort, write"] = spent["flush"] / given.rounds - sum(split.values())
    split["draw a second time"] = spent["draw"] / given.rounds / 3
    base = times["without"].median
    busy = median(times["with"].cpu) / median(times["without"].cpu)
    reads = {name: reading(study, name) for name in ("probability", "mean")}
    parts = len(study._folder.parts)
    yield (
        "scale store",
        _fenced(
            [
                f"{runs} runs of 0.1 s, 1000 steps a run, one number varied, two summaries",
                *(
                    f"  {name:24s} {one.median:7.2f} s {one.span}, {median(one.cpu):.2f} s of CPU"
                    for name, one in times.items()
                ),
                f"  a store costs {100 * (times['with'].ratio - 1):.1f} % of the time (median of "
                f"{given.rounds} pairs), {100 * (busy - 1):.1f} % of CPU. What it does, clocked "
                "apart:",
                *(
                    f"    {name:22s} {seconds:7.3f} s  {100 * seconds / base:5.2f} %"
                    for name, seconds in split.items()
                ),
                f"    {'in all':22s} {sum(split.values()):7.3f} s  "
                f"{100 * sum(split.values()) / base:5.2f} %",
                f"  {parts} parts, {size(last) / runs:.1f} bytes a run, on "
                f"{file_system(last) or 'an unknown file system'}",
                "read again, digests included",
                *(
                    f"  {name:24s} {seconds:7.2f} s, {runs / seconds / 1e6:.1f} million rows/s"
                    for name, seconds in reads.items()
                ),
            ]
        ),
    )


def resume(given: argparse.Namespace, scratch: Path) -> Text:
    """A folder of very many parts."""
    make(scratch / "many", given.parts)
    one = found(scratch / "many")
    yield (
        "scale resume",
        _fenced(
            [
                f"{one.parts} parts of {one.rows // one.parts} rows, {one.missing} runs missing "
                "between them",
                f"  Study.open, which says what is missing  {one.opened:8.3f} s",
                f"  from that to the first missing piece    {one.piece:8.3f} s",
                f"  Study.resume, until a run begins        {one.resumed:8.3f} s",
                f"    of it drawing and checking            {one.checked:8.3f} s, "
                f"{1e6 * one.checked / one.missing:.1f} us a missing run",
                f"  probability, digests included           {one.probability:8.3f} s, "
                f"{one.parts / one.probability:.0f} parts/s",
                f"  mean                                    {one.mean:8.3f} s",
            ]
        ),
    )


MEMORY = """\
import resource, sys
from pathlib import Path
from scale_work import short

short(int(sys.argv[1]), 0.01, store=sys.argv[2] or None)
status = Path("/proc/self/status")
if status.exists():
    # What getrusage tells on Linux has the peak of whoever started this process in it.
    (peak,) = (line.split()[1] for line in status.open() if line.startswith("VmHWM:"))
    print(int(peak) / 2**10)
else:
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
"""


def memory(given: argparse.Namespace, scratch: Path) -> Text:
    """Peaks of fresh interpreters."""
    lines = ["most memory that the driver took, MB; runs of 0.01 s, on threads"]
    lines.append(f"  {'runs':>9s} {'with a store':>13s} {'without':>9s}")
    for runs in given.memory:
        peaks = [_peak(runs, where) for where in (str(scratch / f"memory{runs}"), "")]
        lines.append(f"  {runs:9d} {peaks[0]:13.0f} {peaks[1]:9.0f}")
    yield "scale memory", _fenced(lines)


def _peak(runs: int, store: str) -> float:
    command = [sys.executable, "-c", MEMORY, str(runs), store]
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return float(done.stdout)


def _fenced(lines: list[str]) -> str:
    return "\n".join(["```text", *lines, "```"])


QUICK = {
    "rounds": 1,
    # Within the limit of stability.
    "dt": 7.5e-4,
    "push": 32,
    "short": 64,
    "blocks": 2,
    "runs": BLOCK,
    "parts": 5,
    "memory": [64],
}
PARTS = {"workers": workers, "store": store, "resume": resume, "memory": memory}


def _arguments() -> argparse.Namespace:
    made = parser(__doc__, list(PARTS))
    made.add_argument("--document", action="store_true", help="write docs/scale-out.md's tables")
    made.add_argument("--rounds", type=int, default=3, help="how often all take their turn")
    made.add_argument("--dt", type=float, default=2e-4, help="step of disturbance (ii), s")
    made.add_argument("--push", type=int, default=16 * BLOCK, help="runs of disturbance (ii)")
    made.add_argument("--short", type=int, default=64 * BLOCK, help="runs of 0.1 s")
    made.add_argument("--blocks", type=int, default=512, help="that the driver is clocked with")
    made.add_argument("--runs", type=int, default=10**6, help="runs with and without a store")
    made.add_argument("--parts", type=int, default=10_000, help="of the folder to resume")
    made.add_argument(
        "--memory",
        type=int,
        nargs="+",
        default=[10**5, 10**6, 3 * 10**6],
        help="runs whose driver's memory is looked at",
    )
    made.add_argument("--cores", type=int, nargs="+", default=[2, 64, 512], help="of clusters")
    made.add_argument("--price", type=float, default=0.04, help="assumed, $ a core-hour")
    given = made.parse_args()
    if given.quick:
        if given.document:
            made.error("--quick and --document: a quick look is not written down")
        made.set_defaults(**QUICK)
        given = made.parse_args()
    return given


@contextmanager
def _scratch(quick: bool) -> Iterator[Path]:
    """A folder for studies, deleted again.

    Measured ones lie beside the results, not where temporary files may be kept in memory.
    """
    where = None if quick else ROOT / "results"
    if where is not None:
        where.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=where) as folder:
        yield Path(folder)


def main() -> None:
    given = _arguments()
    head = describe(f"{how_many_threads(None)} cores to use", ["pyarrow", "distributed"])
    texts = [("scale machine", _fenced([head]))]
    print(texts[0][1], flush=True)
    with _scratch(given.quick) as scratch:
        for name in given.part or PARTS:
            own = scratch / name
            own.mkdir()
            for text in PARTS[name](given, own):
                print(f"\n{text[1]}", flush=True)
                texts.append(text)
    if given.document:
        for name, text in texts:
            put(name, text)


if __name__ == "__main__":
    main()
