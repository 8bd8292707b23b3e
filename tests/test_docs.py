"""The documents: what commands put into them is there, and so is what they point to."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCUMENTS = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])


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
