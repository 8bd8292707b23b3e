"""Helpers that the commands share: exit codes, one-line errors, reading scenes, gains."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from .. import _core
from ..scene import Scene, Stabilization
from ..study.capsule import Capsule
from ..study.study_file import naming
from ..support import StabilityWarning, SuspiciousValueWarning, VersionMismatchError, checks, toml

ENDED_EARLY, BAD_INPUT, INTERRUPTED = 1, 2, 130
# Longer error messages are cut to this number of characters.
_LONGEST = 2000


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Prints errors and warnings as one line each, without traceback, and sets the exit code."""
    with warnings.catch_warnings(record=True) as caught:
        for kind in (StabilityWarning, SuspiciousValueWarning):
            warnings.simplefilter("always", kind)
        try:
            yield
        except (ValueError, TypeError, OSError, VersionMismatchError) as error:
            # An OSError without file name comes from standard output; `main` reports it.
            if isinstance(error, OSError) and error.errno is not None and error.filename is None:
                raise
            text = str(error)
            if isinstance(error, OSError) and error.filename is not None:
                text = f"{error.filename}: {error.strerror}"
            notes = [f"({note})" for note in getattr(error, "__notes__", ())]
            typer.echo(f"error: {_one_line(' '.join([text, *notes]))}", err=True)
            raise typer.Exit(BAD_INPUT) from None
        except MemoryError as error:
            typer.echo(f"error: out of memory: {_one_line(str(error))}", err=True)
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            typer.echo("interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None
        finally:
            for warning in {str(each.message): None for each in caught}:
                typer.echo(f"warning: {warning}", err=True)


def _one_line(text: str) -> str:
    """Makes one printable line; text from a file may be long or have control characters."""
    line = " ".join(text[:_LONGEST].split()) + ("..." if len(text) > _LONGEST else "")
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)


def gains(
    *formulations: str,
    others: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    **given: float | None,
) -> Stabilization:
    """The gains of the formulations that a command runs: `given` ones, and those of `others`."""
    found = {name: value for name, value in given.items() if value is not None}
    # An unknown formulation is reported elsewhere.
    if found and "csm" not in formulations and set(formulations) <= set(_core.FORMULATIONS):
        option = "--" + " and --".join(found)
        names = ", ".join(map(repr, formulations))
        raise ValueError(f"{option}: formulation {names} has no gains")
    return replace(others, **found)


def read_scene(path: Path, changes: Sequence[str] | None = None) -> Scene:
    """Reads a scene from a TOML file and makes the changes of --set; errors name the file."""
    with naming(path):
        found = Scene.from_toml(path)
    return with_changes(found, changes)


def with_changes(scene: Scene, changes: Sequence[str] | None) -> Scene:
    """Returns the scene with other values, from texts PATH=VALUE of the option --set."""
    values: dict[str, Any] = {}
    for text in changes or ():
        path, equals, value = text.partition("=")
        path, where = path.strip(), f"--set {checks.shown(text)}"
        if not (equals and path):
            raise ValueError(f"{where}: must be PATH=VALUE, such as grasped.mass=0.2")
        if path in values:
            raise ValueError(f"{where}: {path} is given twice")
        try:
            found = toml.read(f"value = {value}")
        except ValueError:
            found = {}
        # A value with line breaks could go on to other names.
        if found.keys() != {"value"}:
            rule = "a number such as 0.3 or 3e5, an array such as [5, 0], or text in quotes such as"
            raise ValueError(f'{where}: the value must be written as in TOML: {rule} "unilateral"')
        values[path] = found["value"]
    with checks.reworded("--set: ", drop="with_: "):
        return scene.with_(values) if values else scene


def changed_study(changes: Sequence[str] | None, scene: Scene, vary: Mapping[Any, Any]) -> Scene:
    """Returns a study's scene after --set, which may not set what the study varies."""
    paths = {path for key in vary for path in ([key] if isinstance(key, str) else key)}
    if varied := paths & {text.partition("=")[0].strip() for text in changes or ()}:
        raise ValueError(f"--set {min(varied)}: the study varies it; change its [vary] instead")
    return with_changes(scene, changes)


def read_run(path: Path) -> Scene | Capsule:
    """Reads a scene or a capsule from a TOML file; errors name the file."""
    with naming(path):
        data = toml.read(path)
        if data.keys() & {"study", "vary", "paper"}:
            raise ValueError("is a study of many runs: compute it with softpinch montecarlo")
        return Capsule.from_dict(data) if "capsule" in data else Scene.from_dict(data)
