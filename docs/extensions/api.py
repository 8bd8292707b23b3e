"""The block `api` of a page: a table of public names, then the docstring of each.

    ```{api} softpinch
    Scene
    simulate
    ```

Before the page is parsed, the block becomes reStructuredText of Sphinx's autosummary and autodoc.
"""

from __future__ import annotations

import importlib
import inspect
import re
from typing import Any

from sphinx.application import Sphinx

_BLOCK = re.compile(r"^```\{api\} ([\w.]+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# The value of a constant with a longer repr is not printed.
_LONGEST = 300


def _directive(value: object) -> str:
    """The directive of autodoc for a value."""
    if inspect.isclass(value):
        return "autoexception" if issubclass(value, BaseException) else "autoclass"
    return "autofunction" if callable(value) else "autodata"


def _expand(match: re.Match[str]) -> str:
    name, names = match[1], match[2].split()
    module = importlib.import_module(name)
    lines = ["```{eval-rst}", f".. currentmodule:: {name}", ""]
    lines += [".. autosummary::", "   :nosignatures:", "", *(f"   {each}" for each in names), ""]
    for each in names:
        value = getattr(module, each)
        directive = _directive(value)
        lines.append(f".. {directive}:: {each}")
        if directive == "autodata" and len(repr(value)) > _LONGEST:
            lines.append("   :no-value:")
        lines.append("")
    return "\n".join([*lines, "```"])


def _source_read(_: Sphinx, __: str, source: list[str]) -> None:
    source[0] = _BLOCK.sub(_expand, source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.connect("source-read", _source_read)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
