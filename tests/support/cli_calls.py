"""Commands of `softpinch`, called without a process of their own."""

import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
from typer.testing import CliRunner

from softpinch.cli import commands


def call(*arguments: object) -> tuple[int, str, str]:
    """Exit code, what was printed, and what was said on stderr."""
    result = CliRunner().invoke(commands.app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr
