"""Imports at the point of use: optional dependencies, and the public names of a package."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any


def require(module: str, *, extra: str, purpose: str = "") -> ModuleType:
    """Imports a dependency of an `extra`; the error names the `purpose`, or else the module."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        # An installed module that lacks a dependency of its own should report that one.
        if error.name is None or error.name != module.split(".")[0]:
            raise
        needed = f"softpinch's extra {extra} is needed for {purpose or module}"
        raise ImportError(f"{needed}: pip install '.[{extra}]' in a checkout") from None


def lazily(package: str, modules: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """Makes a package's `__getattr__`, which imports names of its modules when asked for them."""
    places = {name: module for module, names in modules.items() for name in names}

    def find(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(f"{package}.{places[name]}")
        return module if name == places[name] else getattr(module, name)

    return find
