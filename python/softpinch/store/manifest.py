"""The manifest of a study's folder: a complete study file (`study_file`) with these additions.

format, sha256             version and checksum of the manifest, verified when it is read
[study], [vary], [scene]   as in any study file; arrays and functions in `vary` by reference
[[made_by]]                software versions, SIMD level and package hash of each writer
"""

from __future__ import annotations

import hashlib
import json
import platform
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..run.options import ALWAYS, NUMERICS, Options
from ..scene.scene import Scene
from ..study.rows import EVENTS
from ..study.sampling import MOST_RUNS, SAMPLERS
from ..study.setup import Setup
from ..study.sources import BLOCK
from ..study.spec import SETTINGS, StudySpec
from ..support import checks, extras, toml
from ..support.disk import one_line, reason
from ..support.errors import StoreError
from . import arrays, files
from .files import MANIFEST

FORMAT = 3
_TOP = ("format", "study", "vary", "scene", "made_by")
# Entries of [study] that may change when a study is continued, because no row depends on them.
FREE = ("runs", "stop_when", "check_dt", "trajectories")


def describe(spec: StudySpec, vary: Mapping[str, Any]) -> dict[str, Any]:
    """The manifest of a study as plain data, equal to what reading its TOML gives.

    Args:
        spec: The study.
        vary: The table `vary`, with a file for each array (`arrays.described`).
    """
    data = {"format": FORMAT, **spec.to_dict(), "vary": dict(vary), "made_by": [made_by()]}
    return tomllib.loads(dumps(data))


def made_by() -> dict[str, Any]:
    """The versions, SIMD level, machine and package hash with which this process computes."""
    return {
        "softpinch": _core.__version__,
        "results_version": _core.RESULTS_VERSION,
        "package": _package(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "simd": _core.simd_level(),
        "machine": platform.machine(),
        **_versions(),
    }


@cache
def _versions() -> dict[str, str]:
    """Versions of the installed optional packages on which numbers or files depend."""
    found = {}
    for name in ("scipy", "pyarrow"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


@cache
def _package() -> str:
    """A hash of the installed softpinch: its Python modules and its compiled core."""
    total = hashlib.sha256()
    root = Path(__file__).parent.parent
    for path in sorted(root.rglob("*")):
        if path.suffix in (".py", ".so", ".pyd"):
            total.update(f"{path.relative_to(root).as_posix()}\0".encode())
            total.update(hashlib.sha256(path.read_bytes()).digest())
    return f"sha256:{total.hexdigest()}"


def write(path: Path, data: Mapping[str, Any]) -> None:
    """Writes the manifest of a folder.

    Raises:
        StoreError: The manifest cannot be written.
        ImportError: tomli_w is not installed.
    """
    own = {"format": data["format"], "sha256": _digest(data)}
    files.write(path / MANIFEST, dumps({**own, **data}).encode())


def dumps(data: Mapping[str, Any]) -> str:
    """Converts a manifest to TOML that gives every number back exactly.

    Raises:
        ImportError: tomli_w is not installed.
    """
    # `toml.dumps` would name another extra in its error.
    extras.require("tomli_w", extra="study", purpose="a study's folder (tomli-w)")
    return toml.dumps(data, "study")


def read(path: Path) -> dict[str, Any]:
    """Reads and checks the manifest of a folder.

    Raises:
        StoreError: There is no manifest, it is damaged or altered, or it has another format.
    """
    file = path / MANIFEST
    try:
        data = toml.contents(file)
        if data.get("format") in (1, 2):
            raise StoreError(
                f"{path}: has store format {data['format']}, of development versions of softpinch "
                f"0.1.0: read it with the version that its {MANIFEST} names, or use that "
                f"{MANIFEST} as a study file, to compute it again in another folder"
            )
        if "format" in data and data["format"] != FORMAT:
            raise StoreError(
                f"{file}: has store format {data['format']!r}; this softpinch reads {FORMAT}"
            )
        digest = data.pop("sha256", None)
        if digest != _digest(data):
            raise ValueError(
                "it was changed after softpinch wrote it: restore the original; for another study "
                "use another folder, and for more runs `Study.extend`"
            )
        data = {"vary": {}, **data}
        _check_types(data)
    except FileNotFoundError:
        raise StoreError(f"{path}: is not a study: there is no {MANIFEST}") from None
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{file}: cannot be read: {reason(error)}") from None
    except (KeyError, RecursionError, TypeError, ValueError) as error:
        text = one_line(error).removeprefix(f"{file}: ")
        raise StoreError(f"{file}: is damaged: {text}") from None
    return data


def _digest(data: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest's data, independent of the file's comments and layout."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _check_types(data: Mapping[str, Any]) -> None:
    """Refuses a manifest in which an entry is missing or has the wrong type.

    The scene and the numerical settings are checked later, when records are made of them.
    """
    checks.refuse_unknown("manifest", data, _TOP, "")
    study, makers = data["study"], data["made_by"]
    for name in ("study", "vary", "scene"):
        checks.instance(name, data[name], dict)
    runs = checks.integer("study.runs", study["runs"], 1, MOST_RUNS)
    checks.integer("study.seed", study["seed"], 0)
    checks.choice("study.sampler", study["sampler"], SAMPLERS)
    checks.instance("study.trajectories", study.get("trajectories", []), list)
    for run in study.get("trajectories", ()):
        checks.integer("study.trajectories", run, 0, runs - 1)
    checks.instance("study.check_dt", study.get("check_dt", False), bool)
    checks.instance("study.stop_when", study.get("stop_when", {}), dict)
    for name, width in study.get("stop_when", {}).items():
        checks.choice("study.stop_when", name, EVENTS)
        checks.positive(f"study.stop_when.{name}", width)
    checks.instance("made_by", makers, list)
    if not makers:
        raise ValueError("[[made_by]] is empty")
    for maker in makers:
        checks.instance("made_by", maker, dict)
        checks.instance("made_by.softpinch", maker["softpinch"], str)
        checks.integer("made_by.results_version", maker["results_version"], 0)
    for name, entry in data["vary"].items():
        checks.instance(f"vary.{name}", entry, dict)
        checks.instance(f"vary.{name}.kind", entry["kind"], str)
        if entry["kind"] == "array":
            arrays.check_entry(f"vary.{name}", entry)


def setup_of(path: Path, data: Mapping[str, Any]) -> Setup:
    """Scene, options and summaries that all runs share, from a manifest.

    Raises:
        StoreError: The manifest is damaged.
    """
    try:
        own = data["study"]
        checks.refuse_unknown("[study]", own, SETTINGS, "")
        for name in ALWAYS:
            if name not in own:
                raise ValueError(f"[study].{name} is missing")
        return Setup.checked(
            Scene.from_dict(data["scene"]),
            [path for key in data["vary"] for path in key.split(", ")],
            own["seed"],
            Options.from_dict({name: own[name] for name in NUMERICS if name in own}),
            summaries=own["summaries"],
            summaries_after=own.get("summaries_after"),
            settling_band=own["settling_band"],
        )
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise StoreError(f"{path / MANIFEST}: is damaged: {one_line(error)}") from None


def sampling_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """How the runs' numbers are drawn, in the form of `Plan.describe`."""
    own = data["study"]
    facts = {name: own[name] for name in ("sampler", "seed", "runs")}
    return {**facts, "block": BLOCK, "vary": data["vary"]}


def identity(data: Mapping[str, Any]) -> str:
    """A hash of everything on which the rows of a study depend, from its manifest."""
    facts = {"results_version": data["made_by"][0]["results_version"], **_decisive(data)}
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def _decisive(data: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted path -> value of every entry on which rows depend."""
    own = {name: value for name, value in data["study"].items() if name not in FREE}
    return dict(_flat({"study": own, "vary": data["vary"], "scene": data["scene"]}))


def compare(path: Path, there: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Refuses a study that differs from the study in a folder.

    Args:
        path: The folder.
        there: The manifest in the folder.
        given: The manifest of the given study.

    Raises:
        ValueError: The studies differ; the message lists each field that differs.
        StoreError: The folder has another results version of the core, so bits would differ.
    """
    versions = [each["results_version"] for each in there["made_by"]]
    if versions[-1] != _core.RESULTS_VERSION:
        raise StoreError(
            f"{path}: was made with softpinch {there['made_by'][-1]['softpinch']}, results version "
            f"{versions[-1]}; this softpinch has {_core.RESULTS_VERSION}, whose results have other "
            "bits: continue with that version, or use another folder"
        )
    old, new = _decisive(there), _decisive(given)
    lines = [
        f"{name} is {_shown(old, name)} there, and {_shown(new, name)} here"
        for name in dict.fromkeys((*old, *new))
        if _value(old, name) != _value(new, name)
    ]
    before, now = there["study"]["runs"], given["study"]["runs"]
    if there["study"]["sampler"] == "latin_hypercube" and before != now:
        lines.append(
            f"study.runs is {before} there, and {now} here: a Latin hypercube cannot be extended"
        )
    if lines:
        raise ValueError(
            f"{path}: holds another study: {'; '.join(lines)}; give that study, or another folder"
        )


_NOTHING = object()


def _flat(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yields (dotted path, value) of every entry in nested tables."""
    if isinstance(data, Mapping):
        for name, value in data.items():
            yield from _flat(value, f"{path}.{name}" if path else name)
    else:
        yield path, data


def _value(data: Mapping[str, Any], name: str) -> Any:
    value = data.get(name, _NOTHING)
    # In Python True == 1, but a study with true and one with 1 differ.
    return (isinstance(value, bool), value)


def _shown(data: Mapping[str, Any], name: str) -> str:
    if name not in data:
        return "not given"
    text = repr(data[name])
    return text if len(text) <= 80 else f"{text[:77]}..."
