"""The documents: what commands put into them is there, what they point to, and blocks run."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from example_runs import run

ROOT = Path(__file__).parent.parent
DOCUMENTS = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs/reference").glob("*.md")),
]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_no_report_is_missing(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    parts = re.findall(r"<!-- report: (.+?) -->\n(.*?)<!-- end -->", text, re.DOTALL)
    assert len(parts) == text.count("<!-- report: ")
    assert [name for name, body in parts if not body.strip()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    targets = re.findall(r"\]\(([^)#\s]+)", document.read_text(encoding="utf-8"))
    local = [target for target in targets if "://" not in target]
    assert [target for target in local if not (document.parent / target).exists()] == []


def test_the_readme_is_short() -> None:
    lines = (ROOT / "README.md").read_text("utf-8").splitlines()
    assert len(lines) <= 220
    assert max(map(len, lines)) <= 250


WITH_CODE = [path for path in DOCUMENTS if "```python" in path.read_text("utf-8")]
# Steps of a page and longer ones for the test, which need not compute the page's thousands of runs
# with the page's accuracy.
STEPS = {"README.md": ("dt=2e-4", "dt=5e-4"), "scale-out.md": ("dt=2e-4", "dt=1e-3")}


@pytest.mark.parametrize("document", WITH_CODE, ids=lambda path: path.name)
def test_blocks_run_one_after_the_other_and_print_what_follows(
    document: Path, tmp_path: Path
) -> None:
    """A block of text right after one of Python is what this prints."""
    text = document.read_text(encoding="utf-8")
    found = re.findall(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", text, re.DOTALL)
    assert len(found) == text.count("```python")
    of_page, of_test = STEPS.get(document.name, ("", ""))
    assert of_page in text
    for k, (block, printed) in enumerate(found):
        wanted = re.findall(r"^(?:import|from) (\w+)", block, re.MULTILINE)
        if not all(map(find_spec, wanted)):
            continue  # Polars is no dependency, not even of the tests
        script = tmp_path / f"block{k}.py"
        script.write_text(block.replace(of_page, of_test), encoding="utf-8")
        # What newcomers paste first is run as they run it.
        shown = run(script, tmp_path, apart=document.name == "README.md")
        assert not printed or shown == printed, block
