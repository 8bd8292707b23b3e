"""Names between backticks: a link if the Reference has the name, else plain code.

Docstrings write `dt` and `sp.simulate` between single backticks, so that they read well in an
editor; for Markdown this is code anyway. What the Reference documents leads there, from both.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.domains.python import PyObject

_NAME = re.compile(r"(?:[A-Za-z_]\w*\.)*[A-Za-z_]\w*")
# `sp.simulate(...)`, `Run.torque`: of pages only what cannot be a word of something else.
_PUBLIC = re.compile(r"((?:sp|softpinch)\.[\w.]+\w|[A-Z]\w*\.[a-z]\w*)(?:\(.*\))?", re.DOTALL)


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


def _link_pages(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Makes links of the public names that pages mention."""
    objects = app.env.domains.python_domain.objects
    for code in list(doctree.findall(nodes.literal)):
        match = _PUBLIC.fullmatch(code.astext())
        if match is None or isinstance(code.parent, nodes.reference):
            continue
        found = objects.get("softpinch." + re.sub(r"^(sp|softpinch)\.", "", match[1]))
        if found is not None:
            uri = app.builder.get_relative_uri(page, found.docname) + "#" + found.node_id
            code.parent.replace(code, nodes.reference("", "", code, internal=True, refuri=uri))


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"  # as the docstrings call them
    app.add_role("name", _role)
    app.connect("missing-reference", _plain)
    app.connect("doctree-resolved", _link_pages)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
