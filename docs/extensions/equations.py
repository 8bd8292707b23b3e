r"""The paper's equation numbers: `\tag{39}` in a formula is where every "(39)" of the site leads.

Pages print a formula between `$$`, with its number as `\tag`, which forges read as well. Here the
formula gets an anchor, and numbers in brackets in the text of pages and docstrings become links.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

TAG = re.compile(r"\\tag\{(\d+)\}")
# "(39)", "(44, 45)", "(2 to 4)"; f(3) and years are none, nor is what `is_shape` tells apart.
CITED = re.compile(r"(?<![\w\])])\(([1-9]\d?(?:(?:, |-| to | and )[1-9]\d?)*)\)(?![\w(])")
# How shapes of arrays end here: coordinates, compressions of two tips, position and rotation.
_LAST_OF_SHAPES = (2, 3, 9, 18)
# Where a number in brackets is text of its own.
_APART = (
    nodes.literal,
    nodes.literal_block,
    nodes.doctest_block,
    nodes.math,
    nodes.math_block,
    nodes.raw,
    nodes.reference,
    nodes.title,
)


def _anchor(app: Sphinx, doctree: nodes.document) -> None:
    """Gives tagged formulas an anchor, and remembers which page has which number."""
    printed = app.env.__dict__.setdefault("softpinch_equations", {})
    page = app.env.docname
    for number in [number for number, place in printed.items() if place == page]:
        del printed[number]
    for block in doctree.findall(nodes.math_block):
        text = block.astext()
        for number in map(int, TAG.findall(text)):
            block["ids"].append(f"equation-{number}")
            printed[number] = page
        if TAG.search(text):
            # Sphinx would wrap lines with \\ in `split`, in which MathJax takes no tags.
            block["nowrap"] = True
            block.children = [nodes.Text(rf"\[{text}\]")]


def is_shape(cited: str) -> bool:
    """Tells the shape of an array, as "4, 9" or "8, 2", from equations, as "44, 45".

    Equations are cited in increasing order, and none of the texts cites a list of them that ends in
    (2), (3), (9) or (18).
    """
    if not re.fullmatch(r"\d+(, \d+)+", cited):
        return False
    numbers = [int(number) for number in cited.split(", ")]
    rising = all(low < high for low, high in itertools.pairwise(numbers))
    return not rising or numbers[-1] in _LAST_OF_SHAPES


def links(text: str, printed: dict[int, str], uri_of: Callable[[str], str]) -> list[nodes.Node]:
    """The text in pieces, with links of its equation numbers.

    Args:
        text: The text.
        printed: The page of each equation.
        uri_of: Where a page is.
    """
    pieces: list[nodes.Node] = []
    end = 0
    for match in CITED.finditer(text):
        if is_shape(match[1]):
            continue
        for number in re.finditer(r"\d+", match[1]):
            page = printed.get(int(number[0]))
            if page is None:
                continue
            start = match.start(1) + number.start()
            pieces.append(nodes.Text(text[end:start]))
            end = match.start(1) + number.end()
            uri = f"{uri_of(page)}#equation-{number[0]}"
            pieces.append(nodes.reference("", number[0], internal=True, refuri=uri))
    return [*pieces, nodes.Text(text[end:])]


class LinkEquations(SphinxPostTransform):
    """Makes links of the equation numbers in the text."""

    default_priority = 900

    def run(self, **_: Any) -> None:
        """Replaces the numbers in every text of the page."""
        printed: dict[int, str] = getattr(self.env, "softpinch_equations", {})
        for text in list(self.document.findall(nodes.Text)):
            around: nodes.Node | None = text.parent
            while around is not None and not isinstance(around, _APART):
                around = around.parent
            if around is None and CITED.search(text):
                text.parent.replace(text, links(str(text), printed, self._uri))

    def _uri(self, page: str) -> str:
        uri: str = self.app.builder.get_relative_uri(self.env.docname, page)
        return uri


def _merge(_: Sphinx, env: Any, __: set[str], other: Any) -> None:
    found = env.__dict__.setdefault("softpinch_equations", {})
    found.update(getattr(other, "softpinch_equations", {}))


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.connect("doctree-read", _anchor)
    app.connect("env-merge-info", _merge)
    app.add_post_transform(LinkEquations)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
