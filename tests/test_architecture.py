"""The layout of the folders is the architecture: rooms, and imports that only point up."""

import ast
import importlib
import re
from collections.abc import Callable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

TESTS = Path(__file__).parent
PACKAGE = TESTS.parent / "python" / "softpinch"
# From the ground up: a room is a folder, or one file at the top.
ROOMS = (
    *(
        "support",
        "scene",
        "paper",
        "stress",
        "strategies",
        "run",
        "analysis",
        "study",
        "store",
        "montecarlo",
        "rare",
        "fitting",
    ),
    "simulator",
    *("accuracy", "reference", "plot", "gym", "jax", "reproduce", "cli"),
    # What users import, and the program, stand above all rooms.
    *("", "__main__"),
)
# The compiled module, below all rooms.
CORE = "_core"
LONGEST = 600
CRATE = TESTS.parent / "rust" / "softpinch" / "src"
# Parameters say of which kind each part of a contact is; the parts read their numbers from them.
CIRCLE_OF_PARTS = {
    *(f"model::{name}" for name in ("parameters", "rule", "source", "motion")),
    *(f"model::contact::{name}" for name in ("mechanism", "law")),
    *(f"model::contact::law::{name}" for name in ("measured", "springs", "relaxation")),
}


class Import(NamedTuple):
    """A module that another one of the package imports, both by their dotted paths in it."""

    by: str
    module: str
    line: int


class Package(NamedTuple):
    """The modules of a package, by their dotted paths in it; the package itself is ""."""

    files: dict[str, Path]
    imports: list[Import]

    @classmethod
    def read(cls, root: Path) -> "Package":
        files = {}
        for path in sorted(root.rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            files[".".join(part for part in parts if part != "__init__")] = path
        return cls(files, [each for by in files for each in imports_of(by, files)])


def imports_of(by: str, files: dict[str, Path]) -> Iterator[Import]:
    """At the top and inside functions; what only type checkers import may point anywhere."""
    tree = ast.parse(files[by].read_text("utf-8"))
    checkers = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
    ]
    left_out = {inner for node in checkers for part in node.body for inner in ast.walk(part)}
    for node in (each for each in ast.walk(tree) if each not in left_out):
        paths: list[list[str]] = []
        if isinstance(node, ast.Import):
            paths = [alias.name.split(".") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            module = node.module.split(".") if node.module else []
            if node.level:
                folders = len(by.split(".")) if by else 0
                above = folders - node.level + (files[by].name == "__init__.py")
                module = ["softpinch", *by.split(".")[:above], *module]
            paths = [[*module, alias.name] for alias in node.names]
        for path in paths:
            if path[0] == "softpinch":
                inside = [".".join(path[1:end]) for end in (len(path), len(path) - 1)]
                yield Import(by, next(name for name in (*inside, "") if known(name, files)),
                             node.lineno)  # fmt: skip


def known(module: str, files: dict[str, Path]) -> bool:
    return module == CORE or module in files


def room_of(module: str) -> str:
    return module.partition(".")[0]


def modules_without_a_room(package: Package) -> list[str]:
    return [name for name in package.files if room_of(name) not in ROOMS]


def imports_that_point_down(package: Package) -> list[str]:
    rank = {room: k for k, room in enumerate((CORE, *ROOMS))}
    return [
        f"{each.by or 'softpinch'}, line {each.line}: imports {each.module or 'softpinch'}"
        for each in package.imports
        if rank[room_of(each.module)] > rank[room_of(each.by)]
    ]


def modules_in_a_circle(package: Package) -> list[str]:
    graph: dict[str, set[str]] = {name: set() for name in package.files}
    for each in package.imports:
        graph[each.by].add(each.module)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        found: list[str] = error.args[1]
        return found
    return []


def files_that_are_too_long(package: Package) -> list[str]:
    lengths = {
        name: len(path.read_text("utf-8").splitlines()) for name, path in package.files.items()
    }
    return [f"{name}: {length} lines" for name, length in lengths.items() if length > LONGEST]


def modules_with_an_underscore(package: Package) -> list[str]:
    return [
        name
        for name in package.files
        if name != "__main__" and any(part.startswith("_") for part in name.split("."))
    ]


Fault = Callable[[Package], list[str]]
FAULTS: list[Fault] = [
    modules_without_a_room,
    imports_that_point_down,
    modules_in_a_circle,
    files_that_are_too_long,
    modules_with_an_underscore,
]


@cache
def the_package() -> Package:
    return Package.read(PACKAGE)


@pytest.mark.parametrize("fault", FAULTS)
def test_the_package_has_no(fault: Fault) -> None:
    package = the_package()
    assert len(package.files) > 100 and len(package.imports) > 500
    assert fault(package) == []


# The layer for JAX has tests in a process of their own.
@pytest.mark.parametrize(
    "room", [r for r in ROOMS if r not in ("", "jax") and (PACKAGE / r).is_dir()]
)
def test_every_name_that_a_room_lists_is_there(room: str) -> None:
    """Also those that are imported when they are asked for."""
    module = importlib.import_module(f"softpinch.{room}")
    assert len(set(module.__all__)) == len(module.__all__) > 0
    assert [name for name in module.__all__ if not hasattr(module, name)] == []


def test_tests_mirror_the_rooms() -> None:
    """Beside them are those of the compiled core, which no room has, and the independent model."""
    folders = {path.parent.relative_to(TESTS).as_posix() for path in TESTS.rglob("*.py")}
    assert folders - {".", "core", "oracle"} <= set(ROOMS)
    assert (
        files_that_are_too_long(Package({str(path): path for path in TESTS.rglob("*.py")}, []))
        == []
    )


def paths_of(tree: str) -> list[str]:
    """The paths of a `use`: `a::{b, c::{d, e}}` has `a::b`, `a::c::d` and `a::c::e`."""
    tree = re.sub(r"\s+as\s+\w+|\s", "", tree)
    while inner := re.search(r"([\w:]*)\{([^{}]*)\}", tree):
        paths = ",".join(inner[1] + path for path in inner[2].split(",") if path)
        tree = tree.replace(inner[0], paths)
    return tree.split(",")


def files_of_the_core() -> dict[str, set[str]]:
    """The files that each file imports, through re-exports, by their modules; tests are left out.

    That a file names those of its own folder is no import: there it says of which parts it is made.
    """
    texts: dict[str, str] = {}
    for path in CRATE.rglob("*.rs"):
        parts = re.findall(r"\w+", str(path.relative_to(CRATE))[:-3])
        parts = parts[:-1] if parts[-1] in ("mod", "lib") else parts
        if not any(part.endswith("tests") for part in parts):
            text = re.sub(r"(?ms)^#\[cfg\(test\)\]\nmod \w+ \{.*?^\}", "", path.read_text("utf-8"))
            above = "::".join(["crate", *parts[:-1], ""])
            texts["::".join(parts)] = re.sub("//.*", "", text).replace("super::", above)
    exports: dict[str, str] = {}
    imports = {by: re.findall(r"\bcrate::(\w+(?:::\w+)*)", texts[by]) for by in texts}
    for by, text in texts.items():
        for public, tree in re.findall(r"(?m)^\s*(pub(?:\(\w+\))? )?use ([^;]+);", text):
            for used in paths_of(tree):
                whole = f"{by}::{used}".rpartition("crate::")[2]
                imports[by].append(whole)
                if public and file_of(whole, texts, {}) != by:
                    exports[f"{by}::{used.rpartition('::')[2]}"] = whole
    found = {by: {file_of(each, texts, exports) for each in imports[by]} for by in texts}
    return {by: {f for f in found[by] if not f"{f}::".startswith(f"{by}::")} for by in texts}


def file_of(path: str, texts: dict[str, str], exports: dict[str, str]) -> str:
    module = path
    while module not in texts:
        module = module.rpartition("::")[0]
    name = "::".join(path.split("::")[: module.count("::") + 2])
    if name in exports:
        return file_of(exports[name] + path.removeprefix(name), texts, exports)
    return module


def test_no_file_of_the_core_imports_itself_through_others() -> None:
    reached = files_of_the_core()
    assert len(reached) > 100 and sum(map(len, reached.values())) > 600
    for between in reached:
        for file in reached:
            if between in reached[file]:
                reached[file] |= reached[between]
    assert {file for file in reached if file in reached[file]} == CIRCLE_OF_PARTS
