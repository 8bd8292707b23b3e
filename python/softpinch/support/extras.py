"""What is imported where it is used; optional dependencies are asked for by name if missing."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType

from .interrupt import handlers_waiting


def load(module: str) -> ModuleType:
    """Imports a module, and loses no signal meanwhile."""
    if module in sys.modules:
        return importlib.import_module(module)
    with handlers_waiting():
        return importlib.import_module(module)


def require(module: str, *, extra: str, purpose: str = "") -> ModuleType:
    """Imports an optional dependency.

    Args:
        module: Its name, "matplotlib" or "hypothesis.strategies".
        extra: The extra of softpinch that brings it, of those in pyproject.toml.
        purpose: What it is needed for, in the message; the module's name where it is empty.

    Raises:
        ImportError: It is not installed; the message says how to install it.
    """
    try:
        return load(module)
    except ModuleNotFoundError as error:
        # A module that is there but lacks something of its own is another fault: let it speak.
        if error.name is None or error.name != module.split(".")[0]:
            raise
        raise ImportError(
            f"softpinch's extra {extra} is needed for {purpose or module}: "
            f"pip install '.[{extra}]' in a checkout"
        ) from None
