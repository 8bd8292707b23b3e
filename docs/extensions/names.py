"""Names between single backticks: a link if the Reference has the name, else plain code.

Docstrings write `dt` and `sp.simulate` alike, so that they read well in an editor. Both are code
here, too, and what the Reference documents leads there.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

_NAME = re.compile(r"(?:[A-Za-z_]\w*\.)*[A-Za-z_]\w*")


def _role(
    role: str, raw: str, text: str, line: int, inliner: Any, options: Any = None, content: Any = ()
) -> tuple[list[nodes.Node], list[nodes.Node]]:
    text = nodes.unescape(text)
    code = nodes.literal(text, text, classes=["name"])
    if not _NAME.fullmatch(text):
        return [code], []
    target = re.sub(r"^sp\.", "softpinch.", text)
    env = inliner.document.settings.env
    link = addnodes.pending_xref(
        raw, code, refdomain="py", reftype="obj", reftarget=target, refdoc=env.docname
    )
    link["softpinch_name"] = True
    link["py:module"] = "softpinch"
    link["py:class"] = env.ref_context.get("py:class")
    return [link], []


def _plain(_: Sphinx, __: Any, node: addnodes.pending_xref, content: nodes.Node) -> Any:
    """Leaves a name that the Reference has not as it is."""
    return content if node.get("softpinch_name") else None


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.add_role("name", _role)
    app.connect("missing-reference", _plain)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
