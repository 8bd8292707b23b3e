"""Packages whose names are imported when they are asked for, so that importing them is quick."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any


def lazily(package: str, modules: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """The `__getattr__` of such a package.

    Args:
        package: Its `__name__`.
        modules: Module in it -> names in that; the module's own name stands for the module itself.
    """
    places = {name: module for module, names in modules.items() for name in names}

    def find(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        from .extras import load

        module = load(f"{package}.{places[name]}")
        return module if name == places[name] else getattr(module, name)

    return find
