"""Where benchmarks put what they found: figures, data, and the tables of the documents."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOCUMENTS = (
    "control.md",
    "derivatives.md",
    "equilibria.md",
    "error-against-run-time.md",
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
