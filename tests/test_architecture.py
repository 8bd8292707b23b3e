"""The layout of the folders is the architecture: rooms, and imports that only point up."""

import ast
from collections import Counter
from collections.abc import Callable, Iterator
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


@pytest.mark.parametrize("fault", FAULTS)
def test_the_package_has_no(fault: Fault) -> None:
    package = Package.read(PACKAGE)
    assert len(package.files) > 100 and len(package.imports) > 500
    assert fault(package) == []


SOUND = {
    "__init__.py": "from .run import Run",
    "__main__.py": "from . import Run",
    "scene/__init__.py": "from .hand import Hand",
    "scene/hand.py": "import math\nfrom .. import _core\nfrom .tip import Tip",
    "scene/tip.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n"
    "    from ..run.run import Run\n    from .hand import Hand",
    "run/__init__.py": "from .run import Run",
    "run/run.py": "from ..scene.hand import Hand\nfrom ..scene import tip",
}
BROKEN: list[tuple[Fault, str, str]] = [
    (modules_without_a_room, "cellar.py", ""),
    (imports_that_point_down, "scene/tip.py", "from ..run.run import Run"),
    (imports_that_point_down, "scene/tip.py", "from .. import Run"),
    (imports_that_point_down, "scene/tip.py", "from softpinch.run.run import Run"),
    (imports_that_point_down, "scene/tip.py", "def late():\n    from ..run.run import Run"),
    (modules_in_a_circle, "scene/tip.py", "from .hand import Hand"),
    (modules_in_a_circle, "scene/tip.py", "def late():\n    from . import hand"),
    (files_that_are_too_long, "scene/tip.py", "\n" * (LONGEST + 1)),
    (modules_with_an_underscore, "scene/_tip.py", ""),
]


@pytest.mark.parametrize(("fault", "file", "text"), BROKEN)
def test_what_is_broken_is_found(fault: Fault, file: str, text: str, tmp_path: Path) -> None:
    for name, content in (SOUND | {file: text}).items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    assert fault(Package.read(tmp_path)) != []
    (tmp_path / file).write_text(SOUND.get(file, ""), encoding="utf-8")
    if file not in SOUND:
        (tmp_path / file).unlink()
    assert [each(Package.read(tmp_path)) for each in FAULTS] == [[]] * len(FAULTS)


class Names(NamedTuple):
    """The names that a package gives, each with the module that it is from."""

    eager: list[tuple[str, str]]
    # What type checkers are told of what is imported when it is asked for, and what is.
    told: list[tuple[str, str]]
    lazy: list[tuple[str, str]]
    listed: list[str]

    @classmethod
    def of(cls, path: Path) -> "Names":
        tree = ast.parse(path.read_text("utf-8"))
        told, lazy, listed = [], [], []
        for node in tree.body:
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                told = list(imported(node.body))
        for node in ast.walk(tree):
            if isinstance(node, ast.Dict):
                table = ast.literal_eval(node)
                lazy += [(name, module) for module, names in table.items() for name in names]
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
                listed = ast.literal_eval(node.value)
        return cls(list(imported(tree.body)), told, lazy, listed)


def imported(statements: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    for node in statements:
        if isinstance(node, ast.ImportFrom) and node.level:
            for alias in node.names:
                yield alias.asname or alias.name, node.module or alias.name


# Modules that users reach as attributes, and that a `*` does not bring.
MODULES = {"gym", "jax", "plot", "reference", "strategies", "stress"}


@pytest.mark.parametrize(
    "path", sorted(PACKAGE.rglob("__init__.py")), ids=lambda path: path.parent.name
)
def test_each_public_name_stands_once_wherever_it_must(path: Path) -> None:
    names = Names.of(path)
    assert sorted(names.told) == sorted(names.lazy)
    given = [name for name, _ in (*names.eager, *names.lazy)]
    apart = MODULES if path.parent == PACKAGE else set()
    helpers = {"lazily", "require"}
    assert Counter(names.listed) == Counter(set(given) - apart - helpers)
    assert len(given) == len(set(given))
    assert names.listed


def test_rooms_say_what_they_are_for() -> None:
    for path in PACKAGE.rglob("__init__.py"):
        words = ast.get_docstring(ast.parse(path.read_text("utf-8")))
        assert words is not None and len(words) > 100, path


def test_tests_mirror_the_rooms() -> None:
    """Beside them are those of the compiled core, which no room has, and the independent model."""
    folders = {path.parent.relative_to(TESTS).as_posix() for path in TESTS.rglob("*.py")}
    assert folders - {".", "core", "oracle"} <= set(ROOMS)
    assert (
        files_that_are_too_long(Package({str(path): path for path in TESTS.rglob("*.py")}, []))
        == []
    )
