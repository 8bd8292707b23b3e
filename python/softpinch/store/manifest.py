"""The manifest of a study's folder: a complete study file (`study_file`) with these additions.

format, sha256             version and checksum of the manifest, verified when it is read
[study], [vary], [scene]   as in any study file; arrays and functions in `vary` by reference
[[made_by]]                software versions, SIMD level and package hash of each writer
"""

import hashlib
import io
import json
import platform
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..run.options import ALWAYS
from ..scene.scene import Scene
from ..study import study_file
from ..study.sampling import MOST_RUNS, Draws
from ..study.sources import Description, Key
from ..study.spec import RECORDING, SETTINGS, StudySpec
from ..study.study_file import checksum, load_array
from ..support import Floats, StoreError, checks, extras, toml
from . import files
from .files import ARRAYS, MANIFEST

FORMAT = 4
# Entries of [study] that may change when a study is continued, because no row depends on them.
FREE = ("runs", "stop_when", "check_dt", "trajectories", *RECORDING)


def describe(spec: StudySpec, vary: Mapping[str, Any]) -> dict[str, Any]:
    """The manifest of a study as its TOML gives it; `vary` is from `with_files`."""
    data = {"format": FORMAT, **spec.to_dict(), "vary": dict(vary), "made_by": [made_by()]}
    return tomllib.loads(dumps(data))


def made_by() -> dict[str, Any]:
    """The versions, SIMD level, machine and package hash with which this process computes."""
    return {
        "softpinch": _core.__version__,
        "results_version": _core.RESULTS_VERSION,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "simd": _core.simd_level(),
        "machine": platform.machine(),
        **_installed(),
    }


@cache
def _installed() -> dict[str, str]:
    """A hash of the modules and the core of this package, and versions of optional packages."""
    total = hashlib.sha256()
    root = Path(__file__).parent.parent
    for path in sorted(root.rglob("*")):
        if path.suffix in (".py", ".so", ".pyd"):
            total.update(f"{path.relative_to(root).as_posix()}\0".encode())
            total.update(hashlib.sha256(path.read_bytes()).digest())
    found = {"package": f"sha256:{total.hexdigest()}"}
    for name in ("scipy", "pyarrow"):
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def write(path: Path, data: Mapping[str, Any]) -> None:
    """Writes the manifest of a folder."""
    own = {"format": data["format"], "sha256": _digest(data)}
    files.write(path / MANIFEST, dumps({**own, **data}).encode())


def dumps(data: Mapping[str, Any]) -> str:
    """Converts a manifest to TOML that gives every number back exactly."""
    # `toml.dumps` would name another extra in its error.
    extras.require("tomli_w", extra="study", purpose="a study's folder (tomli-w)")
    return toml.dumps(data, "study")


def read(path: Path) -> dict[str, Any]:
    """Reads the manifest of a folder, and compares it with its digest."""
    file = path / MANIFEST
    if not file.exists():
        raise StoreError(f"{path}: is not a study: there is no {MANIFEST}")
    with files.reading(file, "restore the original"):
        data = toml.contents(file)
        if data.get("format", FORMAT) != FORMAT:
            own = f"has store format {data['format']!r}; this softpinch reads {FORMAT}"
            version = f"read it with the version that its {MANIFEST} names"
            again = f"use that {MANIFEST} as a study file, to compute it again in another folder"
            raise StoreError(f"{path}: {own}: {version}, or {again}")
        if data.pop("sha256", None) != _digest(data):
            advice = "for another study use another folder, and for more runs `Study.extend`"
            raise ValueError(f"it was changed after softpinch wrote it ({advice})")
        data = {"vary": {}, **data}
        checks.integer("study.runs", data["study"]["runs"], 1, MOST_RUNS)
        for maker in data["made_by"]:
            checks.integer("made_by.results_version", maker["results_version"], 0)
        if not data["made_by"]:
            raise ValueError("[[made_by]] is empty")
        return data


def _digest(data: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest's data, independent of the file's comments and layout."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def spec_of(path: Path, data: Mapping[str, Any]) -> StudySpec:
    """The study that a manifest describes, without the sources of its varied values."""
    with files.reading(path / MANIFEST, "restore the original"):
        needed = (*ALWAYS, "runs", "seed", "sampler", "summaries", "settling_band")
        checks.refuse_unknown("[study]", data["study"], SETTINGS, "", needed=needed)
        given = data["vary"].items()
        vary: dict[Key, Any] = {tuple(key.split(", ")): Description(entry) for key, entry in given}
        return study_file.spec_of(Scene.from_dict(data["scene"]), vary, data["study"])


def identity(data: Mapping[str, Any]) -> str:
    """A hash of everything on which the rows of a study depend, from its manifest."""
    facts = {"results_version": data["made_by"][0]["results_version"], **_decisive(data)}
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def _decisive(data: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted path -> value of every entry on which rows depend."""
    own = {name: value for name, value in data["study"].items() if name not in FREE}
    return dict(_flat({"study": own, "vary": data["vary"], "scene": data["scene"]}))


def compare(path: Path, there: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Refuses a study whose manifest, `given`, differs from the one in the folder, `there`."""
    versions = [each["results_version"] for each in there["made_by"]]
    if versions[-1] != _core.RESULTS_VERSION:
        made = f"softpinch {there['made_by'][-1]['softpinch']}, results version {versions[-1]}"
        here = f"this softpinch has {_core.RESULTS_VERSION}, whose results have other bits"
        advice = "continue with that version, or use another folder"
        raise StoreError(f"{path}: was made with {made}; {here}: {advice}")
    old, new = _decisive(there), _decisive(given)
    lines = []
    for name in dict.fromkeys((*old, *new)):
        if old.get(name) != new.get(name):
            texts = [checks.shown(d[name]) if name in d else "not given" for d in (old, new)]
            lines.append(f"{name} is {texts[0]} there, and {texts[1]} here")
    before, now = there["study"]["runs"], given["study"]["runs"]
    if there["study"]["sampler"] == "latin_hypercube" and before != now:
        why = "a Latin hypercube cannot be extended"
        lines.append(f"study.runs is {before} there, and {now} here: {why}")
    if lines:
        advice = "give that study, or another folder"
        raise ValueError(f"{path}: holds another study: {'; '.join(lines)}; {advice}")


def _flat(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yields (dotted path, value) of every entry in nested tables."""
    if isinstance(data, Mapping):
        for name, value in data.items():
            yield from _flat(value, f"{path}.{name}" if path else name)
    else:
        yield path, data


def with_files(draws: Draws) -> tuple[dict[str, Any], dict[str, Floats]]:
    """The table `vary` of `Draws.describe` with a file for each array; and file name -> array."""
    result, found = dict(draws.describe()["vary"]), {}
    for name, source in zip(result, draws.sources.values(), strict=True):
        if result[name]["kind"] == "array":
            array = np.ascontiguousarray(source.value)
            total = checksum(array)
            file = f"{ARRAYS}/{total[:16]}.npy"
            found[file] = array
            result[name] = {**result[name], "file": file, "sha256": total}
    return result, found


def write_arrays(path: Path, given: Mapping[str, Floats]) -> None:
    """Writes arrays, file name -> array, into a folder, where they are missing or damaged."""
    for file, array in given.items():
        if _array_fault(path / file, checksum(array)):
            buffer = io.BytesIO()
            np.save(buffer, array)
            files.write(path / file, buffer.getbuffer())


def damaged_arrays(path: Path, data: Mapping[str, Any]) -> Iterator[str]:
    """Yields one line for each missing or damaged array of a folder with this manifest."""
    for name, entry in data["vary"].items():
        if entry["kind"] != "array":
            continue
        file = path / entry["file"]
        if fault := _array_fault(file, entry["sha256"]):
            again = f"call monte_carlo again with the original {name}, which writes it again"
            yield f"{file}: {fault}: restore it, or {again}"


def _array_fault(file: Path, sha256: str) -> str:
    """The fault of an array's file in words; empty if there is none."""
    try:
        load_array(file, sha256)
    except ValueError as error:
        return str(error)
    return ""
