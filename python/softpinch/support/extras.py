"""Imports at the point of use; a missing optional dependency names the extra to install."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType

from .interrupt import handlers_waiting


def load(module: str) -> ModuleType:
    """Imports a module, and defers signal handlers until the import is done."""
    if module in sys.modules:
        return importlib.import_module(module)
    with handlers_waiting():
        return importlib.import_module(module)


def require(module: str, *, extra: str, purpose: str = "") -> ModuleType:
    """Imports an optional dependency.

    Args:
        module: The module's name, such as "matplotlib" or "hypothesis.strategies".
        extra: The extra in softpinch's pyproject.toml that installs the module.
        purpose: The feature that needs the module, for the message; empty means the module's name.

    Raises:
        ImportError: The module is not installed; the message says how to install it.
    """
    try:
        return load(module)
    except ModuleNotFoundError as error:
        # An installed module that lacks a dependency of its own should report that one.
        if error.name is None or error.name != module.split(".")[0]:
            raise
        raise ImportError(
            f"softpinch's extra {extra} is needed for {purpose or module}: "
            f"pip install '.[{extra}]' in a checkout"
        ) from None
