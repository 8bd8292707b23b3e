"""Links to files of the repository: pages, examples, and files that are not part of the site.

A link to an example leads to its page in the Gallery. Other files keep their name, without a link:
a reader of the site has no checkout at hand. Where a docstring says docs/model.md, this is a link.
A link whose text is a page's file, which is plain on a forge, shows the page's title.
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
    """The link with the first part of the page's title, up to a colon."""
    page = Path(app.srcdir) / f"{match[1]}.md"
    if not page.exists():
        return match[0]  # Sphinx says so
    title = page.read_text("utf-8").splitlines()[0].lstrip("# ").partition(":")[0]
    return f"[{title}]({match[1]}.md{match[2] or ''})"


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
                link = nodes.reference("", match[0], internal=True, refuri=uri)
                pieces += [nodes.Text(text[end : match.start()]), link]
                end = match.end()
        if pieces:
            text.parent.replace(text, [*pieces, nodes.Text(text[end:])])


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.connect("source-read", _rewrite)
    app.connect("doctree-resolved", _link_pages)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
