"""Files, sections and equations that docstrings, comments and documents cite exist."""

import ast
import contextlib
import importlib
import re
import runpy
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = ("python", "rust", "tests", "benchmarks", "tools", "examples", "docs", "reference")


def comments_of_python(text: str) -> Iterator[str]:
    """Docstrings, and comments: lines that follow each other are one."""
    nodes: list[Any] = [ast.parse(text)]
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""
        # Statements only, within which definitions stand: there are ten times as many nodes.
        for name in ("body", "orelse", "handlers", "finalbody", "cases"):
            nodes += inner if isinstance(inner := getattr(node, name, None), list) else []
    # A sign within a string is read too: to look for tokens would take as long as all the rest.
    lines = enumerate(text.splitlines())
    found = {n: re.search(r"(?:^|\s)#[: ](.*)", line) for n, line in lines if "#" in line}
    yield from joined({n: match[1] for n, match in found.items() if match})


def comments_of_rust(text: str) -> Iterator[str]:
    lines = enumerate(text.splitlines())
    found = {n: re.search(r"(?<![:\"])//[/!]?\s?(.*)", line) for n, line in lines}
    yield from joined({n: match[1] for n, match in found.items() if match})


def joined(lines: dict[int, str]) -> Iterator[str]:
    part: list[str] = []
    for number, line in lines.items():
        if number - 1 not in lines:
            yield "\n".join(part)
            part = []
        part.append(line)
    yield "\n".join(part)


Pieces: TypeAlias = list[tuple[Path, str]]


@cache
def prose() -> Pieces:
    """Every file with what it says in words, piece by piece.

    Read when a test asks, as each of pytest's processes imports this module, and few ask.
    """
    readers = {
        ".py": comments_of_python,
        ".pyi": comments_of_python,
        ".rs": comments_of_rust,
        # What stands between fences is code, or what a program printed.
        ".md": lambda text: text.split("```")[::2],
    }
    return [
        (path, piece)
        for path in files()
        for piece in readers.get(path.suffix, lambda text: [text])(path.read_text("utf-8"))
    ]


def files() -> Iterator[Path]:
    yield from (ROOT / name for name in ("README.md", "Makefile", "pyproject.toml"))
    for folder in FOLDERS:
        for suffix in (".py", ".pyi", ".rs", ".md", ".toml", ".cpp"):
            yield from (ROOT / folder).rglob(f"*{suffix}")


@cache
def blocks() -> Pieces:
    """The blocks between fences in the documents."""
    return [
        (path, block)
        for path in files()
        if path.suffix == ".md"
        for block in path.read_text("utf-8").split("```")[1::2]
    ]


def cited(pattern: str, pieces: Pieces | None = None) -> Iterator[tuple[Path, re.Match[str], str]]:
    """Every match, line breaks read as spaces, and how to report it; else in `prose()`."""
    for path, piece in prose() if pieces is None else pieces:
        for match in re.finditer(pattern, " ".join(piece.split())):
            yield path, match, f"{path.relative_to(ROOT)}: {match[0]}"


def found(name: str, by: Path) -> Path | None:
    """A file, named from the repository's root or from a folder that the citing one is in."""
    for folder in [ROOT, *(f for f in by.parents if f.is_relative_to(ROOT))]:
        if (folder / name).is_file():
            return folder / name
    return None


def headings(document: Path) -> list[str]:
    lines = document.read_text("utf-8").splitlines()
    return [line.lstrip("#").strip() for line in lines if re.match(r"#+ ", line)]


def anchors(document: Path) -> list[str]:
    """As GitHub and others name them."""
    kept = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings(document))
    return [name.replace(" ", "-") for name in kept]


# Files that users have or make are named, too; of these kinds only those of the repository are.
OURS = r"[\w./-]*\w\.(?:md|py|rs|cpp)\b|(?:docs|examples|tests|rust)/[\w./-]+\.\w+"


# The reader's own.
THEIRS = {"script.py"}


def test_files_that_are_cited_exist() -> None:
    cites = list(cited(rf"(?<![\w/{{}}<])(?:{OURS})(?![\w(])", prose() + blocks()))
    assert len(cites) > 100
    missing = [told for path, match, told in cites if found(match[0], path) is None]
    assert [told for told in missing if told.split()[-1] not in THEIRS] == []


def test_sections_that_are_cited_exist() -> None:
    missing = []
    for path, match, told in cited(r"([\w/.-]+\.md)(?:'s|,|:| \()* \"([^\"]+)\""):
        document = found(match[1], path)
        if document is None or match[2] not in headings(document):
            missing.append(told)
    for path, match, told in cited(r"([\w/.-]*\.md)?#([a-z][\w-]*)(?=\))"):
        document = found(match[1], path) if match[1] else path
        if document is None or match[2] not in anchors(document):
            missing.append(told)
    assert missing == []


def test_tests_that_are_cited_exist() -> None:
    sources = [path.read_text("utf-8") for path in files() if path.suffix in (".py", ".rs")]
    names = set(re.findall(r"(?:def|fn) (test_\w+)", "\n".join(sources)))
    names |= {path.stem for path in (ROOT / "tests").rglob("test_*.py")}
    assert [told for _, match, told in cited(r"\btest_\w+") if match[0] not in names] == []


def test_make_targets_that_are_cited_exist() -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    command = re.compile(r"`make ([a-z-]+)|^make ([a-z-]+)(?=;|$|\s*#)", re.MULTILINE)
    matches = [match for _, piece in prose() + blocks() for match in command.finditer(piece)]
    assert len(matches) > 20
    assert {match[1] or match[2] for match in matches} - targets == set()


def test_figures_that_are_cited_are_those_of_the_paper() -> None:
    cites = list(cited(r"\bFig(?:\.|ures?) (\d+)(?: to (\d+))?"))
    assert len(cites) > 10
    numbers = [(told, int(one)) for _, match, told in cites for one in match.groups() if one]
    assert [told for told, number in numbers if number not in range(1, 8)] == []


@pytest.mark.parametrize("name", ["shared/", "design.md", "contact.md", "paper.md"])
def test_nothing_outside_of_the_repository_is_cited(name: str) -> None:
    cites = cited(rf"(?<!\w){re.escape(name)}", prose() + blocks())
    assert [told for path, _, told in cites if path != Path(__file__)] == []


def test_names_of_the_package_that_are_cited_exist() -> None:
    missing = []
    for _, match, told in cited(r"`(?:sp|softpinch|(_core))\.([A-Za-z_][\w.]*\w)"):
        value: Any = importlib.import_module("softpinch._core" if match[1] else "softpinch")
        for name in match[2].split("."):
            with contextlib.suppress(ImportError):
                importlib.import_module(f"{getattr(value, '__name__', '')}.{name}")
            value = getattr(value, name, None)
        if value is None:
            missing.append(told)
    assert missing == []


def test_every_equation_has_the_functions_that_compute_it() -> None:
    """The lists "In the code" of docs/equations.md: files, types and functions that are there."""
    page = (ROOT / "docs/equations.md").read_text("utf-8")
    for section in page.split("\n## ")[1:]:
        text, _, listed = section.partition("**In the code:**")
        heads = "".join(line.split("[")[0] for line in listed.splitlines())
        assert set(re.findall(r"\\tag\{(U?\d+)\}", text)) <= set(re.findall(r"\((U?\d+)\)", heads))
        for file, names in re.findall(r"\]\(\.\./([^)]+)\)((?:,? `[\w:]+`)+)", listed):
            source = (ROOT / file).read_text("utf-8")
            for owner, name in re.findall(r"`(?:(\w+)::)?(\w+)`", names):
                assert re.search(rf"\b(?:fn|def|mod|const) {name}\b", source), (file, name)
                assert not owner or re.search(rf"\nimpl.*\b{owner}\b", source), (file, owner)


def test_every_misprint_of_the_document_has_its_test() -> None:
    table = (ROOT / "docs/model.md").read_text("utf-8").split("## Misprints of the paper")[1]
    listed = re.findall(r"^\| ([^|]*\(\d+\)[^|]*) \|", table.split("\n## ")[0], re.MULTILINE)
    tests = (ROOT / "tests/core/test_errata.py").read_text("utf-8")
    shown = re.findall(r"def test_(?:after_)?(\d+)_(?:and_(\d+)_)?", tests)
    numbers = {number for row in listed for number in re.findall(r"\((\d+)\)", row)}
    assert len(listed) >= 11
    assert numbers <= {number for pair in shown for number in pair}


def test_mutants_are_of_code_that_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "tools")
    """`make mutants` takes long, and refuses to begin where one is of code that has changed."""
    sources = ROOT / "rust" / "softpinch" / "src"
    mutants = runpy.run_path(str(ROOT / "tools" / "mutant_table.py"))["MUTANTS"]
    texts = {file: (sources / file).read_text("utf-8") for file in {each.file for each in mutants}}
    assert [each for each in mutants if texts[each.file].count(each.right) != 1] == []
