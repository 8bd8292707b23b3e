"""What a study's folder is of: a study file (`study_file`), complete, and what has written it.

[study], [vary], [scene]   as in any study file; arrays and functions of `vary` by reference
[[made_by]]                versions, SIMD level and package hash of each kind of writer
"""

from __future__ import annotations

import hashlib
import io
import json
import platform
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from . import _core, _extras, _record, _toml
from ._folder import ARRAYS, MANIFEST, replace
from ._record import Floats
from ._setup import Setup
from ._sources import BLOCK
from .montecarlo import make_setup
from .results import StoreError
from .sampling import MOST_RUNS
from .scene import Scene, Stabilization

TOP = ("format", "study", "vary", "scene", "made_by")
_FORMAT = 1
# What is read of a table without a further look.
_NEEDED = {
    "study": ("runs", "seed", "sampler", "alpha", "beta"),
    "made_by": ("softpinch", "results_version"),
}
# What of [study] may differ between two calls that go on with one study: no row depends on it.
FREE = ("runs", "stop_when", "check_dt", "trajectories")


def describe(
    setup: Setup,
    sampling: Mapping[str, Any],
    stop_when: Mapping[str, float],
    check_dt: bool,
    kept: Iterable[int],
) -> dict[str, Any]:
    """A study as plain data, as it is read from its manifest.

    Args:
        setup: What its runs have in common.
        sampling: `Plan.describe()`.
        stop_when: As for `monte_carlo`.
        check_dt: As for `monte_carlo`.
        kept: The runs whose paths are kept.
    """
    settings = {
        "runs": sampling["runs"],
        "seed": setup.seed,
        "sampler": sampling["sampler"],
        **setup.options.to_dict(),
        "summaries": list(setup.summaries),
        "summaries_after": setup.after if np.isfinite(setup.after) else None,
        "settling_band": setup.band,
        "stop_when": dict(stop_when) or None,
        "check_dt": check_dt,
        "trajectories": sorted(kept) or None,
    }
    data = {
        "format": _FORMAT,
        "study": {name: value for name, value in settings.items() if value is not None},
        "vary": dict(sampling["vary"]),
        "scene": setup.scene.to_dict(),
        "made_by": [made_by()],
    }
    return tomllib.loads(dumps(data))


def made_by() -> dict[str, Any]:
    """What this process would write with."""
    found = {
        "softpinch": _core.__version__,
        "results_version": _core.RESULTS_VERSION,
        "package": _package(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "simd": _core.simd_level(),
        "machine": platform.machine(),
    }
    for name in ("scipy", "pyarrow"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


@cache
def _package() -> str:
    """A hash of softpinch as it is installed: its modules and its core."""
    total = hashlib.sha256()
    root = Path(__file__).parent
    for path in sorted(root.rglob("*")):
        if path.suffix in (".py", ".so", ".pyd"):
            total.update(f"{path.relative_to(root).as_posix()}\0".encode())
            total.update(hashlib.sha256(path.read_bytes()).digest())
    return f"sha256:{total.hexdigest()}"


def write(path: Path, data: Mapping[str, Any]) -> None:
    """Writes the manifest of a folder.

    Raises:
        StoreError: It cannot be written.
        ImportError: tomli_w is not installed.
    """
    replace(path / MANIFEST, dumps(data).encode())


def dumps(data: Mapping[str, Any]) -> str:
    """As TOML, every number exact.

    Raises:
        ImportError: tomli_w is not installed.
    """
    tomli_w = _extras.require("tomli_w", extra="study", purpose="a study's folder (tomli-w)")
    text: str = tomli_w.dumps(data)
    return f"# A softpinch study: SI units, angles in radians.\n{text}"


def read(path: Path) -> dict[str, Any]:
    """The manifest of a folder.

    Raises:
        StoreError: There is none, or it is damaged or of another softpinch.
    """
    file = path / MANIFEST
    try:
        data = _toml.contents(file)
        if data.get("format", _FORMAT) != _FORMAT:
            raise StoreError(f"{file}: has format {data['format']}; this softpinch reads {_FORMAT}")
        _refuse_damaged(data)
    except FileNotFoundError:
        raise StoreError(f"{path}: is no study: there is no {MANIFEST}") from None
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{file}: cannot be read: {error.strerror or error}") from None
    except (TypeError, ValueError) as error:
        raise StoreError(f"{file}: is damaged: {error}") from None
    return {"vary": {}, **data}


def _refuse_damaged(data: Mapping[str, Any]) -> None:
    """Refuses a manifest that lacks something, as one that was cut does."""
    _record.refuse_unknown("manifest", data, TOP, "")
    missing = [name for name in TOP if name not in data and name != "vary"]
    if missing:
        raise ValueError(f"it lacks {_record.quoted(missing)}")
    if not isinstance(data["made_by"], list) or not data["made_by"]:
        raise ValueError("[[made_by]] is no array of tables")
    for where, needed in _NEEDED.items():
        tables = data[where] if isinstance(data[where], list) else [data[where]]
        for table in tables:
            missing = [name for name in needed if name not in table]
            if missing:
                raise ValueError(f"[{where}] lacks {_record.quoted(missing)}")
    _record.integer("study.runs", data["study"]["runs"], 1, MOST_RUNS)


def setup_of(path: Path, data: Mapping[str, Any]) -> Setup:
    """What the runs have in common.

    Raises:
        StoreError: The manifest is damaged.
    """
    try:
        own = dict(data["study"])
        for name in (*FREE, "sampler"):
            own.pop(name, None)
        gains = Stabilization(own.pop("alpha"), own.pop("beta"))
        absent = ("dt", "tolerance", "max_steps", "summaries_after")
        return make_setup(
            Scene.from_dict(data["scene"]),
            [path for key in data["vary"] for path in key.split(", ")],
            own.pop("seed"),
            stabilization=gains,
            **{**dict.fromkeys(absent), **own},
        )
    except (KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{path / MANIFEST}: is damaged: {error}") from None


def sampling_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Where the numbers come from, as `Plan.describe` has it."""
    own = data["study"]
    facts = {name: own[name] for name in ("sampler", "seed", "runs")}
    return {**facts, "block": BLOCK, "vary": data["vary"]}


def arrays_of(
    vary: Mapping[Any, Any], described: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Floats]]:
    """What `Plan.describe` has of `vary` with a file for each array; and file -> array."""
    result, files = dict(described), {}
    for key, value in vary.items():
        name = key if isinstance(key, str) else ", ".join(key)
        if described[name]["kind"] == "array":
            array = np.ascontiguousarray(value, dtype=np.float64)
            total = checksum(array)
            # By what it holds: a file that is there already is the right one, whatever left it.
            file = f"{ARRAYS}/{total[:16]}.npy"
            files[file] = array
            result[name] = {**described[name], "file": file, "sha256": total}
    return result, files


def checksum(array: Floats) -> str:
    """SHA-256 of an array's numbers."""
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


def write_arrays(path: Path, files: Mapping[str, Floats]) -> None:
    """Writes the arrays that are not there yet.

    Raises:
        StoreError: A file cannot be written.
    """
    for file, array in files.items():
        if not (path / file).exists():
            buffer = io.BytesIO()
            np.save(buffer, array)
            try:
                (path / ARRAYS).mkdir(exist_ok=True)
            except OSError as error:
                raise StoreError(f"{path}: cannot be written: {error.strerror}") from None
            replace(path / file, buffer.getbuffer())


def identity(data: Mapping[str, Any]) -> str:
    """A hash of all that the rows of a study depend on, from its manifest as it is read."""
    facts = {"results_version": data["made_by"][0]["results_version"], **_decisive(data)}
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def _decisive(data: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted path -> value of what rows depend on."""
    own = {name: value for name, value in data["study"].items() if name not in FREE}
    return dict(_flat({"study": own, "vary": data["vary"], "scene": data["scene"]}))


def compare(path: Path, there: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Refuses another study than that of a folder.

    Raises:
        ValueError: The message has each field that differs.
        StoreError: The folder's rows are of another version of the kernel, so bits would differ.
    """
    versions = [each["results_version"] for each in there["made_by"]]
    if versions[-1] != _core.RESULTS_VERSION:
        raise StoreError(
            f"{path}: was made with softpinch {there['made_by'][-1]['softpinch']}, results version "
            f"{versions[-1]}; this one has {_core.RESULTS_VERSION}, whose bits differ: go on with "
            "that one, or begin in another folder"
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
            f"{path}: holds another study: {'; '.join(lines)}; give that one, or another folder"
        )


_NOTHING = object()


def _flat(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted path -> value, tables opened."""
    if isinstance(data, Mapping):
        for name, value in data.items():
            yield from _flat(value, f"{path}.{name}" if path else name)
    else:
        yield path, data


def _value(data: Mapping[str, Any], name: str) -> Any:
    value = data.get(name, _NOTHING)
    # 1 and 1.0 are the same number, 1 and true are not.
    return (isinstance(value, bool), value)


def _shown(data: Mapping[str, Any], name: str) -> str:
    if name not in data:
        return "not given"
    text = repr(data[name])
    return text if len(text) <= 80 else f"{text[:77]}..."
