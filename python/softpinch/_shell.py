"""What the commands have in common: exit codes, and errors in one line."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from .simulate import StabilityWarning

ENDED_EARLY, BAD_INPUT, INTERRUPTED = 1, 2, 130


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Bad input in one line, Ctrl-C by its code, warnings in one line each; no traceback."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", StabilityWarning)
        try:
            yield
        except (ValueError, TypeError, OSError) as error:
            text = str(error)
            if isinstance(error, OSError) and error.filename is not None:
                text = f"{error.filename}: {error.strerror}"
            typer.echo(f"error: {' '.join(text.split())}", err=True)
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            typer.echo("interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None
        finally:
            for warning in {str(each.message): None for each in caught}:
                typer.echo(f"warning: {warning}", err=True)
