"""Measures a solver by the reference problems. Needs Python 3.11 and NumPy.

python reference/score.py mine.csv [--events events.csv]
python reference/score.py --creep creep.csv
python reference/score.py --rare FAILURES RUNS [--problem 25-rarer]
python reference/score.py --probability VALUE LOW HIGH --problem 25-rarer

mine.csv has the columns of the solutions in reference/problems, and a column "problem" in front of
them; energy may be left out. The file of the events has the columns problem, time, finger, before
and after. A solver with other tips than those of the problems reports creep alone, in a file with
the columns problem, creep_mm and lost: one of the last two is empty, and lost is a time in s. Any
of these may be scored together. README.md beside this script has the rules.

Exit status: 0 if no problem failed, 1 if one did, 2 if a file cannot be scored.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

VERSION = "1"
FOLDER = Path(__file__).parent / "problems"
RARE = "24-rare"
RARER = "25-rarer"
# The ends of the interval of a probability differ by no more than this factor.
WIDEST = 2.0

_PLACES = (
    *("x", "y", "theta", "finger_right", "finger_left"),
    *("dn_right", "dn_left", "dt_right", "dt_left"),
)
_FORCES = ("normal_right", "normal_left", "tangential_right", "tangential_left")
COLUMNS = ("t", *_PLACES, *(f"rate_{name}" for name in _PLACES), *_FORCES, "energy")
EVENTS = ("problem", "time", "finger", "before", "after")
CREEP = ("problem", "creep_mm", "lost")
MODES = ("stick", "slip", "graze", "free")
# Quantity -> groups of columns that are measured by one size, each with the least such size, in SI
# units: below it a group counts as zero.
QUANTITIES: dict[str, list[tuple[list[int], float]]] = {
    "q": [([1, 2, 6, 7, 8, 9], 1e-3), ([3], 1e-2), ([4, 5], 1e-3)],
    "p": [([10, 11, 15, 16, 17, 18], 1e-3), ([12], 1e-2), ([13, 14], 1e-3)],
    "multipliers": [([19, 20, 21, 22], 1e-1)],
    "energy": [([23], 1e-3)],
}
LEVELS = (1e-9, 1e-6, 1e-4, 1e-2)
# Instants within this of each other are one, s. Modes that last less than that may be left out, s.
SAME, BRIEF = 1e-9, 1e-5

Floats: TypeAlias = NDArray[np.float64]
Event: TypeAlias = tuple[float, str, str, str]
# Time, mode before and mode after.
Change: TypeAlias = tuple[float, str, str]


class FileError(Exception):
    """A file that cannot be scored."""


@dataclass
class Answer:
    """What a file says about one problem.

    Attributes:
        rows: `COLUMNS`, in the order of the file; energy is NaN where it was left out.
        events: None where there is no file of events.
    """

    rows: Floats
    events: list[Event] | None = None

    @property
    def lost(self) -> float | None:
        """When the object was lost, s, or None."""
        times = [t for t, finger, _, after in self.events or () if (finger, after) == _LOST]
        return min(times, default=None)


_LOST = ("object", "lost")


@dataclass
class Score:
    """The errors of one problem.

    Attributes:
        errors: By quantity, without a unit; "events" is in s, NaN where it was not reported.
        end: Of the problem, s, by which the errors of times are measured.
        creep: In mm, of the solver and of the solution; None where the problem has none.
        failures: Why it failed.
        notes: What was not reported.
    """

    errors: dict[str, float]
    end: float
    creep: tuple[float, float] | None = None
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def shares(self) -> dict[str, float]:
        """Every error that counts, without a unit: energy and events only where reported.

        Times are measured by the problem's end. Events with other modes have no error of time.
        """
        found = {**self.errors, "times of events": self.errors["events"] / self.end}
        del found["events"]
        needed = ("q", "p", "multipliers")
        return {k: v for k, v in found.items() if k in needed or math.isfinite(v)}

    @property
    def verdict(self) -> str:
        if self.failures:
            return "FAILS: " + "; ".join(self.failures)
        worst = max(self.shares.values())
        level = next(level for level in LEVELS if worst <= level)
        return f"right to {level:.0e}" + "".join(f"; {note}" for note in self.notes)


def differences(exact: Floats, other: Floats, sized_by: Floats) -> dict[str, float]:
    """The largest difference of each quantity, by the size of its group along the solution.

    A quantity that is NaN in all rows is left out.
    """
    found = {}
    for name, groups in QUANTITIES.items():
        worst = math.nan
        for columns, least in groups:
            off = np.abs(exact[:, columns] - other[:, columns])
            if not np.isnan(off).all():
                size = max(float(np.abs(sized_by[:, columns]).max()), least)
                with np.errstate(over="ignore"):
                    worst = np.fmax(worst, np.nanmax(off) / size)
        if not math.isnan(worst):
            found[name] = float(worst)
    return found


def lasting(events: Sequence[Event]) -> dict[str, list[Change]]:
    """The changes of each finger, without modes that were brief."""
    found: dict[str, list[Change]] = {"right": [], "left": [], "object": []}
    for time, finger, before, after in sorted(events, key=lambda event: event[0]):
        kept = found[finger]
        if kept and time - kept[-1][0] < BRIEF:
            # The mode that ends here was brief: the change to it is one with this one.
            time, before, _ = kept.pop()
        if after != before:
            kept.append((time, before, after))
    return found


def event_error(one: dict[str, list[Change]], other: dict[str, list[Change]]) -> float:
    """The largest difference of the times of events, s; infinite where the modes differ."""
    worst = 0.0
    for finger in ("right", "left"):
        if [modes for _, *modes in one[finger]] != [modes for _, *modes in other[finger]]:
            return math.inf
        for (here, *_), (there, *_) in zip(one[finger], other[finger], strict=True):
            worst = max(worst, abs(here - there))
    return worst


def _table(path: Path, needed: Sequence[str]) -> list[dict[str, str]]:
    """The rows of a CSV file with a header."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, restkey=_MORE)
            names = [name.strip() for name in reader.fieldnames or ()]
            missing = [name for name in needed if name not in names]
            if missing:
                hint = "" if names else " (the file is empty)"
                raise FileError(f"{path}: columns are missing: {', '.join(missing)}{hint}")
            twice = sorted({name for name in names if name and names.count(name) > 1})
            if twice:
                raise FileError(f"{path}: two columns have the same name: {', '.join(twice)}")
            reader.fieldnames = names
            rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{path}: not a CSV file that can be read: {error}") from None
    for line, row in enumerate(rows, 2):
        if any(cell.strip() for cell in row.pop(_MORE, ())):
            rule = "more entries than the header; decimals are written with a point"
            raise FileError(f"{path}, line {line}: {rule}")
    return rows


# Where csv.DictReader puts what is beyond the header; no column has this name.
_MORE = "\n"


def _number(path: Path, line: int, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        rule = f"column {name} must be a number, not {text!r}"
        raise FileError(f"{path}, line {line}: {rule}") from None
    if not math.isfinite(value):
        raise FileError(f"{path}, line {line}: column {name} is {text}; it must be finite")
    return value


def read(path: Path, events: Path | None = None) -> dict[str, Answer]:
    """A solver's answers by the problem's name.

    Raises:
        FileError: A column is missing, an entry is no finite number, or a problem is unknown.
    """
    table = _table(path, ["problem", *COLUMNS[:-1]])
    with_energy = bool(table) and "energy" in table[0]
    if not table:
        raise FileError(f"{path}: no rows")
    rows: dict[str, list[list[float]]] = {}
    for line, row in enumerate(table, 2):
        name = _known(path, line, row["problem"])
        values = [_number(path, line, key, row[key]) for key in COLUMNS[:-1]]
        values.append(_number(path, line, "energy", row["energy"]) if with_energy else math.nan)
        rows.setdefault(name, []).append(values)
    answers = {name: Answer(np.array(found)) for name, found in rows.items()}
    if events is not None:
        for answer in answers.values():
            answer.events = []
        for line, row in enumerate(_table(events, EVENTS), 2):
            name = _known(events, line, row["problem"])
            if name not in answers:
                raise FileError(f"{events}, line {line}: {path} has no rows of {name}")
            time = _number(events, line, "time", row["time"])
            finger, before, after = row["finger"], row["before"], row["after"]
            of_tip = finger in ("right", "left") and before in MODES and after in MODES
            if not of_tip and (finger, before, after) != (_LOST[0], "held", _LOST[1]):
                rule = f"finger must be right, left or object, and modes one of {', '.join(MODES)}"
                rule += "; the object goes from held to lost"
                raise FileError(f"{events}, line {line}: {finger}, {before}, {after}: {rule}")
            found = answers[name].events
            assert found is not None
            found.append((time, finger, before, after))
    return answers


def _known(path: Path, line: int, name: str | None) -> str:
    if name in (RARE, RARER):
        raise FileError(f"{path}, line {line}: {name} has no rows; give --rare or --probability")
    if not name or not (FOLDER / name / "solution.csv").is_file():
        raise FileError(f"{path}, line {line}: {name!r} is none of the problems in {FOLDER.name}/")
    return name


def solution(name: str) -> tuple[dict[str, Any], Answer]:
    """The problem's facts and its solution."""
    folder = FOLDER / name
    data = tomllib.loads((folder / "problem.toml").read_text("utf-8"))
    table = _table(folder / "solution.csv", COLUMNS)
    rows = np.array([[float(row[key]) for key in COLUMNS] for row in table])
    events = [
        (float(row["time"]), row["finger"], row["before"], row["after"])
        for row in _table(folder / "events.csv", EVENTS[1:])
    ]
    return data, Answer(rows, events)


def score(name: str, mine: Answer) -> Score:
    """Compares an answer with the solution.

    Raises:
        FileError: Instants of the solution are missing.
    """
    data, exact = solution(name)
    lost = mine.lost
    wanted = exact.rows if lost is None else exact.rows[exact.rows[:, 0] < lost]
    order = np.argsort(mine.rows[:, 0], kind="stable")
    times = mine.rows[order, 0]
    at = np.clip(np.searchsorted(times, wanted[:, 0]), 1, max(len(times) - 1, 1))
    at = np.minimum(at, len(times) - 1)
    before = np.maximum(at - 1, 0)
    closer = np.abs(times[before] - wanted[:, 0]) < np.abs(times[at] - wanted[:, 0])
    at = np.where(closer, before, at)
    off = np.abs(times[at] - wanted[:, 0]) > SAME * np.maximum(1.0, wanted[:, 0])
    if off.any():
        first = float(wanted[off.argmax(), 0])
        raise FileError(
            f"{name}: {off.sum()} of {len(wanted)} instants are missing, the first is "
            f"t = {first!r}; if the object was lost before, report the event "
            "object,held,lost"
        )
    rows = mine.rows[order][at]
    for k, t in enumerate(wanted[:, 0].tolist()):
        near = SAME * max(1.0, t)
        low, high = np.searchsorted(times, [t - near, t + near])
        same = mine.rows[order][low:high, 1:]
        if not np.array_equal(same, np.broadcast_to(rows[k, 1:], same.shape), equal_nan=True):
            raise FileError(f"{name}: {high - low} rows at t = {t!r} say different things")
    errors = differences(wanted, rows, exact.rows) if len(wanted) else {}
    answer = data["answer"]
    result = Score(dict.fromkeys((*QUANTITIES, "events"), math.nan) | errors, answer["end"])
    was_lost = answer["status"] == "lost"
    if np.isnan(rows[:, -1]).any():
        result.notes.append("energy not reported")
    if mine.events is None:
        result.notes.append("events not reported")
        if was_lost:
            result.notes.append("whether the object was lost, too")
    else:
        if (lost is not None) != was_lost:
            told = "lost" if lost is not None else "not lost"
            result.failures.append(
                f"the object is {told}, and should {'' if was_lost else 'not '}be"
            )
        elif lost is not None and abs(lost - answer["end"]) > LEVELS[-1] * answer["end"]:
            result.failures.append(f"the object is lost at {lost:g} s, not {answer['end']:g} s")
        assert exact.events is not None
        result.errors["events"] = event_error(lasting(exact.events), lasting(mine.events))
        if was_lost and lost is not None:
            late = abs(lost - answer["end"])
            result.errors["events"] = max(result.errors["events"], late)
        if math.isinf(result.errors["events"]):
            result.notes.append("other modes")
    if "creep_mm" in answer and lost is None:
        a, b = (int(np.searchsorted(wanted[:, 0], t)) for t in answer["creep_between"])
        way = rows[min(b, len(rows) - 1), 1:3] - rows[a, 1:3]
        result.creep = 1e3 * float(np.hypot(*way)), float(answer["creep_mm"])
    wrong = [name for name, error in result.shares.items() if not error <= LEVELS[-1]]
    if wrong:
        result.failures.append(f"an error above {LEVELS[-1]:g}, of {', '.join(wrong)}")
    return result


# Of the normal distribution, for 99 %.
_Z = 2.5758293035489004


def wilson(failures: int, runs: int, z: float = _Z) -> tuple[float, float]:
    """Wilson's interval of a probability, 99 % by default."""
    p = failures / runs
    middle = p + z * z / (2 * runs)
    half = z * math.sqrt(p * (1 - p) / runs + z * z / (4 * runs * runs))
    scale = 1 + z * z / runs
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


def probability(name: str, low: float, high: float) -> bool:
    """Prints whether a 99 % interval has the exact probability and is narrow enough."""
    data = tomllib.loads((FOLDER / name / "problem.toml").read_text("utf-8"))
    exact = float(data["answer"]["probability"])
    failures = []
    if not low <= exact <= high:
        failures.append("it does not have the exact one")
    if high > WIDEST * low:
        # Of k failures the ends differ by about exp(2 z / sqrt(k)).
        least = (2 * _Z / math.log(WIDEST)) ** 2 / exact
        failures.append(f"its ends differ by more than a factor of {WIDEST:g}; plain runs have to "
                        f"be some {least:.1g}")  # fmt: skip
    print(f"{name}: exact probability {exact:.6g}")
    verdict = "FAILS: " + "; ".join(failures) if failures else "agrees"
    print(f"  99 % interval {low:.3g} to {high:.3g}: {verdict}")
    return not failures


def read_creep(path: Path) -> dict[str, tuple[float | None, float | None]]:
    """Creep, mm, and when the object was lost, s, by problem; one of both is None.

    Raises:
        FileError: An entry is wrong, or a problem has neither creep nor an end.
    """
    found: dict[str, tuple[float | None, float | None]] = {}
    for line, row in enumerate(_table(path, CREEP), 2):
        name = _known(path, line, row["problem"])
        answer = solution(name)[0]["answer"]
        told = [
            _number(path, line, key, row[key]) if (row[key] or "").strip() else None
            for key in CREEP[1:]
        ]
        where = f"{path}, line {line}: {name}"
        if "creep_mm" not in answer and answer["status"] != "lost":
            raise FileError(f"{where} asks for no creep")
        if name in found:
            raise FileError(f"{where} has two lines")
        if (told[0] is None) == (told[1] is None):
            raise FileError(f"{where}: one of creep_mm and lost must be a number, one empty")
        if min(value for value in told if value is not None) < 0:
            raise FileError(f"{where}: creep_mm and lost must not be negative")
        found[name] = told[0], told[1]
    if not found:
        raise FileError(f"{path}: no rows")
    return found


def creep(reports: dict[str, tuple[float | None, float | None]]) -> bool:
    """Prints the reports of creep, and whether the object is held or lost as it should be.

    The time of a loss is not judged: other tips have another way to go.
    """
    right = 0
    for name, (way, lost) in sorted(reports.items()):
        answer = solution(name)[0]["answer"]
        should = "lost" if answer["status"] == "lost" else "held"
        told = "held" if lost is None else "lost"
        right += told == should
        verdict = "as it should be" if told == should else f"FAILS: it should be {should}"
        what = f"creep {way:.3g} mm" if lost is None else f"after {lost:.3g} s"
        exact = answer.get("creep_mm")
        if lost is None and exact is not None:
            what += f", should be {exact:.3g} mm"
        print(f"{name:24s}{what}; the object is {told}, {verdict}")
    print(f"creep alone: {right} of {len(reports)} objects are held or lost as they should be")
    return right == len(reports)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, nargs="?", help="your rows")
    parser.add_argument("--events", type=Path, help="your events")
    parser.add_argument("--creep", type=Path, help="your creep, if your tips are others")
    parser.add_argument("--rare", type=int, nargs=2, metavar=("FAILURES", "RUNS"))
    parser.add_argument(
        "--probability", type=float, nargs=3, metavar=("VALUE", "LOW", "HIGH"),
        help="your probability and its 99 %% interval, of another way than plain runs",
    )  # fmt: skip
    parser.add_argument("--problem", choices=(RARE, RARER), default=RARE, help="of a probability")
    given = parser.parse_args(arguments)
    if all(each is None for each in (given.file, given.creep, given.rare, given.probability)):
        parser.error("name a file, or give --creep, --rare or --probability")
    if given.events is not None and given.file is None:
        parser.error("--events needs the file of your rows")
    intervals = []
    if given.rare is not None:
        failures, runs = given.rare
        if not 0 <= failures <= runs or runs < 1:
            parser.error("--rare: there must be 0 to RUNS failures")
        intervals.append(wilson(failures, runs))
    if given.probability is not None:
        value, low, high = given.probability
        if not 0.0 <= low <= value <= high <= 1.0:
            parser.error("--probability: it must be 0 <= LOW <= VALUE <= HIGH <= 1")
        intervals.append((low, high))
    try:
        answers = read(given.file, given.events) if given.file is not None else {}
        scores = {name: score(name, answer) for name, answer in sorted(answers.items())}
        reports = read_creep(given.creep) if given.creep is not None else {}
    except FileError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    right = [_printed(scores)] if scores else []
    right += [creep(reports)] if reports else []
    right += [probability(given.problem, *ends) for ends in intervals]
    return 0 if all(right) else 1


def _printed(scores: dict[str, Score]) -> bool:
    """Prints the scores; whether all are right."""
    print(f"{'problem':24s}" + "".join(f"{name:>12s}" for name in QUANTITIES) + "   events, s")
    for name, found in scores.items():
        cells = (
            f"{'-':>12s}" if math.isnan(value) else f"{value:12.1e}"
            for value in found.errors.values()
        )
        print(f"{name:24s}{''.join(cells)}  {found.verdict}")
        if found.creep is not None:
            print(f"{'':24s}  creep {found.creep[0]:.3g} mm, should be {found.creep[1]:.3g} mm")
    failed = sum(bool(found.failures) for found in scores.values())
    print(f"{len(scores) - failed} of {len(scores)} problems are right")
    return not failed


if __name__ == "__main__":
    sys.exit(main())
