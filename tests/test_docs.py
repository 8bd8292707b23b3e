"""The documents: what commands put into them is there, what they point to, and blocks run."""

import re
import subprocess
import sys
from importlib.util import find_spec
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


def test_blocks_of_scale_out_run_one_after_the_other(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "scale-out.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) >= 7
    # Steps five times as long as the page's, for thousands of runs.
    assert "dt=2e-4" in blocks[0]
    blocks[0] = blocks[0].replace("dt=2e-4", "dt=1e-3")
    for k, block in enumerate(blocks):
        wanted = re.findall(r"^(?:import|from) (\w+)", block, re.MULTILINE)
        if not all(map(find_spec, wanted)):
            continue  # Polars is no dependency, not even of the tests
        # From a file: processes that are spawned import it again.
        script = tmp_path / f"block{k}.py"
        script.write_text(block, encoding="utf-8")
        command = [sys.executable, "-W", "error", str(script)]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert (done.returncode, done.stderr) == (0, ""), block
