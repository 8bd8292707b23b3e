"""Links to files of the repository: pages, examples, and files that are not part of the site.

A link to an example leads to its page in the Gallery. Other files keep their name, without a link:
a reader of the site has no checkout at hand. Where a docstring says docs/model.md, or the text of a
link is a page's file, which is plain on a forge, the reader sees a link with the page's title.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_EXAMPLE = re.compile(r"\]\(\.\./examples/(\d\d_\w+)\.py\)")
_FILE = re.compile(r"\[[\w-]+\.md\]\(([\w-]+)\.md(#[\w-]*)?\)")
_OUTSIDE = re.compile(r"\[([^\]]+)\]\(\.\./[\w./-]+\)")


def _rewrite(app: Sphinx, _: str, source: list[str]) -> None:
    text = source[0].replace("](../examples/README.md)", "](gallery/index.rst)")
    text = _EXAMPLE.sub(r"](gallery/\1.rst)", text)
    text = _FILE.sub(lambda match: _titled(app, match), text)
    source[0] = _OUTSIDE.sub(r"\1", text)


def _titled(app: Sphinx, match: re.Match[str]) -> str:
    """The link with the title of its page."""
    if not (Path(app.srcdir) / f"{match[1]}.md").exists():
        return match[0]  # Sphinx says so
    return f"[{_title(app, match[1])}]({match[1]}.md{match[2] or ''})"


def _title(app: Sphinx, page: str) -> str:
    """The first part of a page's title, up to a colon."""
    text = (Path(app.srcdir) / f"{page}.md").read_text("utf-8")
    return text.splitlines()[0].lstrip("# ").partition(":")[0]


_PAGE = re.compile(r"\bdocs/([\w-]+)\.md")


def _link_pages(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Makes links of the names of pages in the text."""
    for text in list(doctree.findall(nodes.Text)):
        if not isinstance(text.parent, nodes.paragraph):
            continue
        pieces: list[nodes.Node] = []
        end = 0
        for match in _PAGE.finditer(text):
            if match[1] in app.env.all_docs:
                uri = app.builder.get_relative_uri(page, match[1])
                link = nodes.reference("", _title(app, match[1]), internal=True, refuri=uri)
                pieces += [nodes.Text(text[end : match.start()]), link]
                end = match.end()
        if pieces:
            text.parent.replace(text, [*pieces, nodes.Text(text[end:])])


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.connect("source-read", _rewrite)
    app.connect("doctree-resolved", _link_pages)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
