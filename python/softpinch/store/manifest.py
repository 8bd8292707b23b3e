"""The manifest: a study file (`study_file`), complete, that says what has written its parts.

format, sha256             of the manifest itself: what this module checks when it reads one
[study], [vary], [scene]   as in any study file; arrays and functions of `vary` by reference
[[made_by]]                versions, SIMD level and package hash of each kind of writer
"""

from __future__ import annotations

import hashlib
import json
import platform
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..study.sampling import MOST_RUNS, SAMPLERS
from ..study.setup import Setup, make_setup
from ..study.sources import BLOCK
from ..support import checks, extras, toml
from ..support.disk import one_line, reason
from ..support.errors import StoreError
from . import arrays, files
from .files import MANIFEST

FORMAT = 2
_TOP = ("format", "study", "vary", "scene", "made_by")
# Entries of [study] that may change when a study is continued: no row depends on them.
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
        "format": FORMAT,
        "study": {name: value for name, value in settings.items() if value is not None},
        "vary": dict(sampling["vary"]),
        "scene": setup.scene.to_dict(),
        "made_by": [made_by()],
    }
    return tomllib.loads(dumps(data))


def made_by() -> dict[str, Any]:
    """What this process would write with."""
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
    """Of the packages that are installed, among those whose numbers or files a study has."""
    found = {}
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
    root = Path(__file__).parent.parent
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
    own = {"format": data["format"], "sha256": _digest(data)}
    files.write(path / MANIFEST, dumps({**own, **data}).encode())


def dumps(data: Mapping[str, Any]) -> str:
    """As TOML, every number exact.

    Raises:
        ImportError: tomli_w is not installed.
    """
    # The writer would name another extra.
    extras.require("tomli_w", extra="study", purpose="a study's folder (tomli-w)")
    return toml.dumps(data, "study")


def read(path: Path) -> dict[str, Any]:
    """The manifest of a folder.

    Raises:
        StoreError: There is none, it is damaged or altered, or another softpinch has written it.
    """
    file = path / MANIFEST
    try:
        data = toml.contents(file)
        if data.get("format") == 1:
            raise StoreError(
                f"{path}: has store format 1, of development versions of softpinch 0.1.0: read it "
                f"with the version that its {MANIFEST} names, or run that as a study file and "
                "compute it again in another folder"
            )
        if "format" in data and data["format"] != FORMAT:
            raise StoreError(
                f"{file}: has store format {data['format']!r}; this softpinch reads {FORMAT}"
            )
        digest = data.pop("sha256", None)
        if digest != _digest(data):
            raise ValueError(
                "it is not as softpinch wrote it: put the original back; for another study take "
                "another folder, and for more runs `Study.extend`"
            )
        data = {"vary": {}, **data}
        _check_types(data)
    except FileNotFoundError:
        raise StoreError(f"{path}: is no study: there is no {MANIFEST}") from None
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{file}: cannot be read: {reason(error)}") from None
    except (KeyError, RecursionError, TypeError, ValueError) as error:
        text = one_line(error).removeprefix(f"{file}: ")
        raise StoreError(f"{file}: is damaged: {text}") from None
    return data


def _digest(data: Mapping[str, Any]) -> str:
    """Of all that a manifest says; the file's comments and layout do not count."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _check_types(data: Mapping[str, Any]) -> None:
    """Refuses a manifest in which something is missing or of another type.

    The scene and the settings are checked where they are made into records.
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
        checks.choice("study.stop_when", name, (*_core.STATUSES, *_core.VIOLATIONS))
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
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise StoreError(f"{path / MANIFEST}: is damaged: {one_line(error)}") from None


def sampling_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Where the numbers come from, as `Plan.describe` has it."""
    own = data["study"]
    facts = {name: own[name] for name in ("sampler", "seed", "runs")}
    return {**facts, "block": BLOCK, "vary": data["vary"]}


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
