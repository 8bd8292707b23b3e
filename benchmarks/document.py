"""Output of benchmarks: figures, data, and the tables of the documents."""

import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOCUMENTS = (
    "control.md",
    "derivatives.md",
    "ensembles.md",
    "equilibria.md",
    "error-against-run-time.md",
    "reference-problems.md",
    "scale-out.md",
    "stability.md",
    "unilateral.md",
    "what-a-scene-pays.md",
)


@contextmanager
def folders(quick: bool) -> Iterator[tuple[Path, Path]]:
    """For figures and for data: the repository's, or for a quick look one that is deleted again."""
    if quick:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder), Path(folder)
        return
    figures, data = ROOT / "docs" / "figures", ROOT / "results" / "reports"
    figures.mkdir(parents=True, exist_ok=True)
    data.mkdir(parents=True, exist_ok=True)
    yield figures, data


def put(name: str, text: str) -> None:
    """Between its markers, in whichever document has them."""
    begin, end = f"<!-- report: {name} -->", "<!-- end -->"
    for document in DOCUMENTS:
        path = ROOT / "docs" / document
        body = path.read_text(encoding="utf-8")
        if begin in body:
            head, _, rest = body.partition(begin)
            _, _, tail = rest.partition(end)
            path.write_text(f"{head}{begin}\n{text}\n{end}{tail}", encoding="utf-8")


def folded(title: str, text: str) -> str:
    """Text that a reader opens by its title; headings cannot be inside."""
    return f"<details>\n<summary>{title}</summary>\n\n{text}\n\n</details>"


def map_table(summary: Sequence[str]) -> str:
    """Makes of `StabilityMap.summary` a sentence and a folded table with a row for each pair."""
    first, *lines = summary
    rows = ["| formulation, method | runs | right end | error < 0.001 | wrong by > 0.1 | failed |"]
    rows += ["|---|---:|---:|---:|---:|---|"]
    for line in lines:
        found = _SUMMARY.fullmatch(line)
        if found is None:
            raise ValueError(f"summary: {line!r} is not a line of StabilityMap.summary")
        pair, right, cells, close, wrong, failed = found.groups()
        cells_of_row = (pair.replace(" + ", " "), cells, right, close, wrong, failed)
        rows.append(f"| {' | '.join(cells_of_row)} |")
    return f"{first[0].upper()}{first[1:]}.\n\n" + folded("Runs, pair by pair", "\n".join(rows))


_SUMMARY = re.compile(
    r"(\w+ \+ \w+): (\d+) of (\d+) runs end as they should, (\d+) with an error below 0\.001, "
    r"(\d+) complete but are wrong by more than 0\.1, failed: (.*)"
)
