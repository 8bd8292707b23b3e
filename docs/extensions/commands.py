"""The directive `command-help`: the help text of a shell command, as the command prints it."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def help_of(command: str) -> str:
    """Returns what `softpinch COMMAND --help` prints, 90 columns wide; "" is softpinch itself."""
    import typer

    from softpinch.cli import app

    group = typer.main.get_command(app)
    with group.make_context("softpinch", ["--help"], resilient_parsing=True) as context:
        if not command:
            return _text(group, context)
        found = group.get_command(context, command)  # type: ignore[attr-defined]
        inner = found.make_context(command, [], parent=context, resilient_parsing=True)
        return _text(found, inner)


def _text(command: Any, context: Any) -> str:
    context.terminal_width = context.max_content_width = 90
    formatter = context.make_formatter()
    command.format_help(context, formatter)
    return str(formatter.getvalue()).rstrip()


class CommandHelp(SphinxDirective):
    """Shows the help of the command that the argument names."""

    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Returns a block of text."""
        text = help_of(self.arguments[0] if self.arguments else "")
        return [nodes.literal_block(text, text, language="text")]


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.add_directive("command-help", CommandHelp)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
