"""The site: it builds without a warning, and its pages have every name, equation and default."""

import importlib.util
import re
import shutil
import subprocess
import sys
import zlib
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import pytest

import softpinch as sp
from test_references import cited

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = {
    str(path.relative_to(DOCS).with_suffix("")): path.read_text("utf-8")
    for path in sorted([*DOCS.glob("*.md"), *DOCS.glob("reference/*.md")])
}
NEEDED = ("sphinx", "furo", "myst_parser", "sphinx_gallery", "sphinx_copybutton")


# Reads all pages and writes some: to write all would take as long again. The search, which would
# lack the others, is left out, and so is Python's search for memory that it could free. Then it
# resolves the references of all; every warning is an error.
BUILD = """
import gc, sys
gc.disable()
from sphinx.application import Sphinx
app = Sphinx("docs", "docs", "site", "read", "html", {"plot_gallery": "0"}, None, sys.stderr, True)
app.builder.search = False
app.build(filenames=[f"docs/{page}.md" for page in sys.argv[1:]])
for name in app.env.found_docs:
    app.env.get_and_resolve_doctree(name, app.builder)
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of a copy of docs, built without running the examples."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        pytest.skip(f"not installed, of the dependency group docs: {', '.join(missing)}")
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(DOCS, folder / "docs", ignore=shutil.ignore_patterns("figures", "gallery"))
    shutil.copy(ROOT / "CONTRIBUTING.md", folder)
    for name in ("docs/figures", "examples"):
        (folder / name).symlink_to(ROOT / name)
    pages = ("equations", "reference/run", "reference/accuracy", "reference/ready-scenes")
    done = subprocess.run(
        [sys.executable, "-c", BUILD, *pages],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "site"


def test_the_reference_has_every_public_name(site: Path) -> None:
    inventory = (site / "objects.inv").read_bytes().split(b"\n", 4)[4]
    lines = zlib.decompress(inventory).decode().splitlines()
    documented = {line.split()[0] for line in lines if " py:" in line}
    modules = {"softpinch.paper", "softpinch.__version__"}
    wanted = {f"softpinch.{name}" for name in sp.__all__} - modules
    wanted |= {f"softpinch.plot.{name}" for name in sp.plot.__all__}
    assert len(wanted) > 100
    assert wanted - documented == set()


def test_a_number_of_an_equation_leads_to_it(site: Path) -> None:
    page = (site / "equations.html").read_text("utf-8")
    assert 'id="equation-30"' in page
    # "(3)" of the drawing's page, or of this one, is a link.
    assert 'href="#equation-' in page or 'href="equations.html#equation-' in page


@pytest.mark.parametrize("name", ["run", "accuracy", "ready-scenes"])
def test_every_name_of_the_reference_has_a_line_in_the_table(site: Path, name: str) -> None:
    """Also constants, whose type's docstring or whose value would say nothing about them."""
    page = (site / f"reference/{name}.html").read_text("utf-8")
    rows = re.findall(r'<tr class="row-\w+">(.*?)</tr>', page, re.DOTALL)
    cells = [re.findall(r"<td>(.*?)</td>", row, re.DOTALL) for row in rows]
    lines = [[re.sub(r"<[^>]+>", "", cell).strip() for cell in pair] for pair in cells if pair]
    assert len(lines) > 10
    assert [name for name, line in lines if len(line) < 10] == []
    assert not re.search(r"mappingproxy|Built-in|at 0x", page)


def test_a_page_that_a_docstring_names_is_a_link_with_its_title(site: Path) -> None:
    page = (site / "reference/run.html").read_text("utf-8")
    title = PAGES["integrators"].splitlines()[0].removeprefix("# ")
    assert f'href="../integrators.html">{title}</a>' in page
    text = re.sub(r"<[^>]+>", "", page)
    assert re.findall(r"docs/[\w-]+\.md", text) == []


@pytest.mark.parametrize(
    ("text", "equations"),
    [
        ("the multipliers (44, 45)", True),
        ("(19, 20)", True),
        ("(2 to 9)", True),
        ("(9)", True),
        ("angles (8, 2)", False),
        ("(2, 9)", False),
        ("(9, 18)", False),
        ("(3, 9, 18)", False),
    ],
)
def test_shapes_of_arrays_are_no_equations(text: str, equations: bool) -> None:
    pytest.importorskip("sphinx")
    spec = importlib.util.spec_from_file_location(
        "equations_extension", DOCS / "extensions/equations.py"
    )
    assert spec is not None and spec.loader is not None
    extension = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(extension)
    printed = dict.fromkeys(range(1, 46), "equations")
    links = extension.links(text, printed, lambda page: f"{page}.html")
    numbers = [int(number) for number in re.findall(r"\d+", text)]
    wanted = [f"equations.html#equation-{number}" for number in numbers] if equations else []
    assert [
        link["refuri"] for link in links if "refuri" in getattr(link, "attributes", {})
    ] == wanted
    assert "".join(link.astext() for link in links) == text


def test_a_page_loads_nothing_from_the_network(site: Path) -> None:
    page = (site / "equations.html").read_text("utf-8")
    loaded = re.findall(r"<(?:script|link|img|iframe)\b[^>]*?(?:src|href)=\"([^\"]+)\"", page)
    assert len(loaded) > 5
    assert [target for target in loaded if "//" in target] == []
    assert any("mathjax/" in target for target in loaded)
    assert (site / "_static/mathjax/tex-chtml.js").exists()


def test_every_page_is_in_a_table_of_contents() -> None:
    listed = []
    for name, text in PAGES.items():
        folder = Path(name).parent
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL):
            entries = [line for line in tree.splitlines() if re.fullmatch(r"[\w/-]+", line)]
            listed += [str(folder / entry) for entry in entries if entry != "gallery/index"]
    assert set(PAGES) - set(listed) == {"index"}
    assert [name for name, times in Counter(listed).items() if times > 1] == []


def test_every_equation_that_is_cited_is_printed_once() -> None:
    tags = [int(tag) for tag in re.findall(r"\\tag\{(\d+)\}", "".join(PAGES.values()))]
    assert [number for number, times in Counter(tags).items() if times > 1] == []
    number = r"[1-9]\d?"
    equation = rf"(?<![\w\])])\(({number}(?:(?:, |-| to | and ){number})*)\)(?![\w(])"
    missing = []
    for _, match, told in cited(equation):
        wanted = [int(one) for one in re.findall(r"\d+", match[1])]
        missing += [told for one in wanted if one not in tags]
    # The paper has 45 equations, and all that comments, documents and tests cite are printed.
    assert missing == [] and set(tags) == set(range(1, 46))


def test_files_of_the_page_on_formats_are_read(tmp_path: Path) -> None:
    from softpinch.fitting import fit_file
    from softpinch.study import study_file

    blocks = re.findall(r"```toml\n(.*?)```", PAGES["reference/files"], re.DOTALL)
    scene, study, fit = (tmp_path / name for name in ("pinch.toml", "study.toml", "fit.toml"))
    for path, block in zip((scene, study, fit), blocks, strict=True):
        path.write_text(block, encoding="utf-8")
    assert sp.Scene.from_toml(scene).friction == 0.5
    assert study_file.read(study).draws.runs == 1000
    assert fit_file.read(fit) is not None
