"""Links of pages to files of the repository, which are not part of the site.

A link to an example leads to its page in the Gallery. Other files keep their name, without a link:
a reader of the site has no checkout at hand.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

_EXAMPLE = re.compile(r"\]\(\.\./examples/(\d\d_\w+)\.py\)")
_OUTSIDE = re.compile(r"\[([^\]]+)\]\(\.\./[\w./-]+\)")


def _rewrite(app: Sphinx, _: str, source: list[str]) -> None:
    text = source[0].replace("](../examples/README.md)", "](gallery/index.rst)")
    text = _EXAMPLE.sub(r"](gallery/\1.rst)", text)
    source[0] = _OUTSIDE.sub(r"\1", text)


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.connect("source-read", _rewrite)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
