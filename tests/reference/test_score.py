"""The scorer of the reference problems: right and wrong answers, and files that it refuses."""

import ast
import csv
import math
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2] / "reference"
sys.path.append(str(ROOT))

import score  # noqa: E402

SLIP, LOST, REST = "10-slip", "04-lost", "01-rest"
HEADER = ["problem", *score.COLUMNS]

Change = Callable[[np.ndarray], np.ndarray]


def table(path: Path, header: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    return path


def answer(folder: Path, name: str, change: Change = lambda rows: rows) -> Path:
    """A file with the solution of a problem, changed."""
    rows = change(score.solution(name)[1].rows.copy())
    return table(folder / "mine.csv", HEADER, [[name, *map(repr, row)] for row in rows.tolist()])


def events(folder: Path, name: str, later: float = 0.0, skip: str = "") -> Path:
    """A file with the events of a problem, some seconds later, without those of a finger."""
    found = score.solution(name)[1].events or []
    rows = [(name, t + later, *rest) for t, *rest in found if rest[0] != skip]
    return table(folder / "events.csv", score.EVENTS, rows)


def printed(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    status = score.main([str(each) for each in arguments])
    return (status, *capsys.readouterr())


def shifted(column: str, by: float) -> Change:
    def change(rows: np.ndarray) -> np.ndarray:
        rows[:, score.COLUMNS.index(column)] += by
        return rows

    return change


def test_the_scorer_needs_numpy_only() -> None:
    tree = ast.parse((ROOT / "score.py").read_text("utf-8"))
    named = {
        name.split(".")[0]
        for node in ast.walk(tree)
        for name in (
            [each.name for each in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert named - set(sys.stdlib_module_names) == {"numpy"}


@pytest.mark.parametrize("name", [SLIP, LOST, REST])
def test_the_solution_is_right(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = printed(capsys, answer(tmp_path, name), "--events", events(tmp_path, name))
    assert (found[0], found[2]) == (0, "")
    assert "right to 1e-09" in found[1]
    assert "1 of 1 problems are right" in found[1]


def test_rows_in_any_order_and_at_other_instants_do_no_harm(tmp_path: Path) -> None:
    def change(rows: np.ndarray) -> np.ndarray:
        between = (rows[1:] + rows[:-1]) / 2 + 1.0
        between[:, 0] -= 1.0
        return np.random.default_rng(1).permutation(np.vstack([rows, between]))

    assert score.main([str(answer(tmp_path, SLIP, change))]) == 0


def test_an_error_is_measured_by_the_largest_magnitude_of_its_group() -> None:
    _, exact = score.solution(SLIP)
    rows = shifted("tangential_left", 0.5)(exact.rows.copy())
    found = score.score(SLIP, score.Answer(rows))
    largest = np.abs(exact.rows[:, [k for k, n in enumerate(score.COLUMNS) if "normal" in n]]).max()
    assert found.errors["multipliers"] == pytest.approx(0.5 / largest)
    assert found.errors["q"] == found.errors["p"] == found.errors["energy"] == 0.0
    assert math.isnan(found.errors["events"])
    assert found.verdict.startswith("right to 1e-02; events not reported")


def test_a_group_that_is_zero_is_measured_by_its_least_size() -> None:
    _, exact = score.solution(REST)
    found = score.score(REST, score.Answer(shifted("rate_x", 2e-6)(exact.rows.copy())))
    assert found.errors["p"] == pytest.approx(2e-6 / 1e-3)


@pytest.mark.parametrize(
    ("by", "level"), [(1e-13, "1e-09"), (1e-8, "1e-06"), (1e-6, "1e-04"), (1e-4, "1e-02")]
)
def test_the_verdict_is_the_level_below_which_the_error_is(by: float, level: str) -> None:
    rows = shifted("y", by)(score.solution(SLIP)[1].rows.copy())
    assert score.score(SLIP, score.Answer(rows)).verdict.startswith(f"right to {level}")


def test_an_error_above_a_hundredth_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = printed(capsys, answer(tmp_path, SLIP, shifted("y", 0.01)))
    assert status == 1
    assert "FAILS: an error above 0.01" in out


def test_events_are_compared_by_time_and_mode(tmp_path: Path) -> None:
    path = answer(tmp_path, SLIP)
    for later, skip, error in ((3e-7, "", 3e-7), (0.0, "left", math.inf)):
        mine = score.read(path, events(tmp_path, SLIP, later, skip))[SLIP]
        found = score.score(SLIP, mine)
        assert found.errors["events"] == pytest.approx(error)
        assert ("other modes" in found.verdict) == bool(skip)


def test_modes_that_last_less_than_10_microseconds_may_be_left_out() -> None:
    brief = [
        (0.1, "left", "stick", "slip"),
        (0.2, "left", "slip", "graze"),
        (0.2 + 5e-6, "left", "graze", "free"),
        (0.3, "left", "free", "slip"),
        (0.3 + 1e-6, "left", "slip", "free"),
    ]
    left = [(0.1, "stick", "slip"), (0.2, "slip", "free")]
    assert score.lasting(brief)["left"] == left
    without = [brief[0], (0.2, "left", "slip", "free")]
    assert score.event_error(score.lasting(brief), score.lasting(without)) == 0.0


def test_wrong_modes_before_an_event_are_other_modes() -> None:
    _, exact = score.solution(SLIP)
    assert exact.events is not None
    time, finger, before, after = exact.events[0]
    assert before == "stick"
    mine = score.Answer(exact.rows, [(time, finger, "free", after), *exact.events[1:]])
    found = score.score(SLIP, mine)
    assert math.isinf(found.errors["events"])
    assert found.verdict == "right to 1e-09; other modes"


def test_energy_and_times_of_events_count_in_the_verdict(tmp_path: Path) -> None:
    rows, moments = answer(tmp_path, SLIP), events(tmp_path, SLIP)
    size = np.abs(score.solution(SLIP)[1].rows[:, -1]).max()
    for by, verdict in ((1e-5, "right to 1e-04"), (0.5, "FAILS: an error above 0.01, of energy")):
        shift = shifted("energy", by * size)
        found = score.score(SLIP, score.read(answer(tmp_path, SLIP, shift), moments)[SLIP])
        assert found.verdict == verdict
    rows = answer(tmp_path, SLIP)
    end = score.solution(SLIP)[0]["answer"]["end"]
    for by, verdict in (
        (1e-7, "right to 1e-06"),
        (0.02, "FAILS: an error above 0.01, of times of events"),
    ):
        found = score.score(SLIP, score.read(rows, events(tmp_path, SLIP, by * end))[SLIP])
        assert found.verdict == verdict


def test_two_rows_at_one_instant_must_agree(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for by, place, status in ((0.0, 0, 0), (1e-3, 0, 2), (1e-3, len(score.COLUMNS), 2)):

        def twice(rows: np.ndarray, by: float = by, place: int = place) -> np.ndarray:
            again = rows[7:8].copy()
            again[0, 2] += by
            return np.insert(rows, 8 if place == 0 else 7, again, axis=0)

        found = printed(capsys, answer(tmp_path, SLIP, twice))
        assert found[0] == status
        assert ("2 rows at t = " in found[2]) == (status == 2)


CREEP = ("problem", "creep_mm", "lost")


def test_creep_alone_may_be_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = [[REST, "0.25", ""], ["03-held", "0.0016", ""], [LOST, "", "0.81"]]
    path = table(tmp_path / "creep.csv", CREEP, mine)
    status, out, err = printed(capsys, "--creep", path)
    assert (status, err) == (0, "")
    assert "creep 0.25 mm, should be 0 mm; the object is held, as it should be" in out
    assert "creep alone: 3 of 3 objects" in out
    assert "right to" not in out
    wrong = table(tmp_path / "w.csv", CREEP, [[REST, "", "12"], [LOST, "0.4", ""]])
    status, out, _ = printed(capsys, answer(tmp_path, SLIP), "--creep", wrong)
    assert status == 1
    assert "FAILS: it should be held" in out and "FAILS: it should be lost" in out
    assert "1 of 1 problems are right" in out


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[REST, "", ""]], "one of creep_mm and lost must be a number, one empty"),
        ([[REST, "1", "2"]], "one of creep_mm and lost must be a number, one empty"),
        ([[REST, "nan", ""]], "column creep_mm is nan; it must be finite"),
        ([[REST, "-1", ""]], "must not be negative"),
        ([[REST, "1", ""], [REST, "0", ""]], "has two lines"),
        ([[SLIP, "1", ""]], "10-slip asks for no creep"),
        ([["x", "1", ""]], "'x' is none of the problems"),
        ([], "no rows"),
    ],
)
def test_creep_that_cannot_be_scored_is_refused(
    rows: list[list[str]], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = printed(capsys, "--creep", table(tmp_path / "c.csv", CREEP, rows))
    assert (status, out) == (2, "")
    assert message in err


def test_a_file_and_a_probability_are_scored_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for by, problems in ((0.0, "1 of 1"), (0.1, "0 of 1")):
        mine = answer(tmp_path, SLIP, shifted("y", by))
        status, out, _ = printed(capsys, mine, "--rare", "171", "200000")
        assert f"{problems} problems are right" in out and "24-rare" in out and "agrees" in out
        assert status == (by != 0.0)


def test_an_object_that_is_lost_needs_no_rows_after_that(tmp_path: Path) -> None:
    rows = answer(tmp_path, SLIP, lambda rows: rows[rows[:, 0] < 0.05])
    lost = table(tmp_path / "lost.csv", score.EVENTS, [[SLIP, 0.05, "object", "held", "lost"]])
    assert score.main([str(rows), "--events", str(lost)]) == 1
    found = score.score(SLIP, score.read(rows, lost)[SLIP])
    assert "the object is lost, and should not be" in found.verdict


def test_an_object_that_should_be_lost_and_is_not_fails(tmp_path: Path) -> None:
    mine = score.read(answer(tmp_path, LOST), events(tmp_path, LOST, skip="object"))[LOST]
    assert "the object is not lost, and should be" in score.score(LOST, mine).verdict
    late = score.read(answer(tmp_path, LOST), events(tmp_path, LOST, later=0.02))[LOST]
    assert "the object is lost at" in score.score(LOST, late).verdict


def test_creep_is_reported_in_millimetres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def sinking(rows: np.ndarray) -> np.ndarray:
        rows[:, 2] -= 1e-6 * rows[:, 0]
        return rows

    _, out, _ = printed(capsys, answer(tmp_path, REST, sinking))
    assert "creep 0.099 mm, should be 0 mm" in out


def test_a_value_that_is_far_off_fails_in_plain_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        status, out, err = printed(capsys, answer(tmp_path, SLIP, shifted("y", 1e308)))
    assert (status, err) == (1, "")
    assert "FAILS: an error above 0.01, of q" in out


def test_what_is_not_reported_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = score.solution(SLIP)[1].rows.tolist()
    bare = table(tmp_path / "bare.csv", HEADER[:-1], [[SLIP, *row[:-1]] for row in rows])
    status, out, _ = printed(capsys, bare)
    assert status == 0
    assert "right to 1e-09; energy not reported; events not reported" in out


def refusals(folder: Path) -> dict[str, tuple[Path, str]]:
    """Files that cannot be scored, and what the message says of each."""
    header = HEADER[:5]
    row = [SLIP, *["0"] * len(score.COLUMNS)]
    places = {name: folder / f"{name}.csv" for name in ("none", "text", "bytes", "empty")}
    places["text"].write_text("this is a letter\nand no table\n")
    places["bytes"].write_bytes(b"\xff\xfe\x00PNG")
    places["empty"].write_text("")
    nan = [*row[:3], "nan", *row[4:]]
    word = [*row[:3], "two", *row[4:]]
    rows = score.solution(SLIP)[1].rows[:20].tolist()
    return {
        "no file": (places["none"], "not a CSV file that can be read"),
        "a letter": (places["text"], "columns are missing: problem, t, x"),
        "no text": (places["bytes"], "not a CSV file that can be read"),
        "empty": (places["empty"], "the file is empty"),
        "no rows": (table(folder / "header.csv", HEADER, []), "no rows"),
        "columns": (
            table(folder / "columns.csv", header, [row[:5]]),
            "columns are missing: finger",
        ),
        "nan": (
            table(folder / "nan.csv", HEADER, [nan]),
            "line 2: column y is nan; it must be fin",
        ),
        "word": (
            table(folder / "word.csv", HEADER, [word]),
            "column y must be a number, not 'two'",
        ),
        "cut line": (table(folder / "cut.csv", HEADER, [row[:9]]), "must be a number, not None"),
        "twice": (
            table(folder / "twice.csv", [*HEADER, "x"], [[*row, "0"]]),
            "two columns have the same name: x",
        ),
        "commas": (
            table(folder / "commas.csv", HEADER, [[*row[:2], "0", "5", *row[3:]]]),
            "line 2: more entries than the header; decimals are written with a point",
        ),
        "rare": (table(folder / "r.csv", HEADER, [[score.RARE, *row[1:]]]), "has no rows; give --"),
        "problem": (table(folder / "p.csv", HEADER, [["x", *row[1:]]]), "'x' is none of the prob"),
        "path": (table(folder / "q.csv", HEADER, [["..", *row[1:]]]), "'..' is none of the prob"),
        "short": (
            table(folder / "short.csv", HEADER, [[SLIP, *values] for values in rows]),
            "10-slip: 31 of 51 instants are missing, the first is t = 0.032",
        ),
    }


def test_files_that_cannot_be_scored_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for case, (path, message) in refusals(tmp_path).items():
        status, out, err = printed(capsys, path)
        assert (status, out) == (2, ""), case
        assert err.startswith("error: ") and message in err, case
        assert "Traceback" not in err


def test_events_that_cannot_be_scored_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = answer(tmp_path, SLIP)
    for row, message in (
        ([SLIP, "soon", "left", "stick", "slip"], "column time must be a number"),
        ([SLIP, 0.1, "middle", "stick", "slip"], "finger must be right, left or object"),
        ([SLIP, 0.1, "left", "stick", "glue"], "modes one of stick, slip, graze, free"),
        ([SLIP, 0.1, "object", "held", "Lost"], "the object goes from held to lost"),
        ([LOST, 0.1, "left", "stick", "slip"], "has no rows of 04-lost"),
    ):
        path = table(tmp_path / "e.csv", score.EVENTS, [row])
        status, _, err = printed(capsys, mine, "--events", path)
        assert status == 2 and message in err


def test_a_probability_is_right_if_its_interval_has_the_exact_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    data = score.tomllib.loads((score.FOLDER / score.RARE / "problem.toml").read_text("utf-8"))
    exact, runs = data["answer"]["probability"], 1_000_000
    deviation = math.sqrt(exact * (1 - exact) / runs)
    for share, status in ((2.0, 0), (3.5, 1), (-2.0, 0), (-3.5, 1)):
        failures = round(runs * (exact + share * deviation))
        assert printed(capsys, "--rare", str(failures), str(runs))[0] == status


@pytest.mark.parametrize(("failures", "runs"), [(0, 50), (3, 40), (50, 50)])
def test_wilsons_interval_is_scipys(failures: int, runs: int) -> None:
    stats = pytest.importorskip("scipy.stats")
    expected = stats.binomtest(failures, runs).proportion_ci(0.99, method="wilson")
    np.testing.assert_allclose(score.wilson(failures, runs), expected, atol=1e-12)


@pytest.mark.parametrize(("failures", "runs"), [(0, 1), (0, 1000), (1, 1000), (10, 10_000)])
def test_too_few_runs_for_a_probability_fail(
    failures: int, runs: int, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = printed(capsys, "--rare", str(failures), str(runs))
    assert status == 1
    assert "plain runs have to be some 5e+04" in out
    low, high = score.wilson(failures, runs)
    assert low < 1e-3 < high


def test_an_interval_of_another_way_than_plain_runs_is_judged(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for ends, status in (
        (("1e-3", "0.9e-3", "1.1e-3"), 0),
        (("1e-3", "0.9e-3", "1.01e-3"), 1),
        (("1e-3", "0.5e-3", "1.1e-3"), 1),
    ):
        assert printed(capsys, "--probability", *ends)[0] == status
    with pytest.raises(SystemExit):
        score.main(["--probability", "1e-3", "2e-3", "3e-3"])
