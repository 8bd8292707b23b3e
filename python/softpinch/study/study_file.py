"""A study in a TOML file: a scene, the values that vary between runs, and the settings.

paper = "ii"                    # or scene = "pinch.toml", or the tables of a scene file

[scene]                         # with `paper`: changes of the paper's scene
duration = 1.5

[study]                         # all entries are optional
runs = 1000
seed = 7

[vary]
"grasped.mass" = {kind = "normal", mean = 0.1, std = 0.01}
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from .. import paper
from .._core import RECORDABLE
from ..run.options import Options, in_place
from ..scene.scene import Scene
from ..support import Floats, checks, toml
from ..support.files import one_line
from .distributions import Distribution
from .sources import Key, frozen_distribution
from .spec import RECORDING, RUN_OPTIONS, SETTINGS, SUMMARIES, StudySpec

# `softpinch rare` reads the table "rare". The last three are of manifests, which are study files.
_TOP = ("scene", "paper", "study", "vary", "rare", "format", "sha256", "made_by")
# The number of runs if neither the file nor an array determines it.
_RUNS = 1000
_SCENE = {f.name for f in fields(Scene)}


def read(
    path: Path, change: Callable[..., Scene] = lambda scene, vary: scene, **changes: Any
) -> StudySpec:
    """Reads a study from a file; `changes` override its settings (see `in_place`).

    `change` makes the scene from that of the file and the table `vary`.
    """
    path = checks.path("path", path)
    scene, vary, settings = parse(toml.read(path), path)
    return spec_of(change(scene, vary), vary, settings, **changes)


def spec_of(
    scene: Scene, vary: Mapping[Key, Any], settings: Mapping[str, Any], **changes: Any
) -> StudySpec:
    """Makes the study that `parse` has read, with the `changes` of `read`."""
    default = {"summaries": SUMMARIES, "record": RECORDABLE}
    settings = {**default, **settings, **in_place(**changes)}
    how = {name: settings.pop(name) for name in (*RUN_OPTIONS, *RECORDING) if name in settings}
    return StudySpec.checked(scene, Options.from_dict(how), vary=vary, **settings)


def parse(data: Mapping[str, Any], path: Path) -> tuple[Scene, dict[Key, Any], dict[str, Any]]:
    """Parses the content of the file at `path`: scene, table `vary` and table `study`."""
    with naming(path):
        if "capsule" in data:
            raise ValueError("is a capsule, one run of a study: replay it with softpinch run")
        if data and data.keys() <= _SCENE:
            how = f'as in scene = "{path.name}", or has its tables under [scene]'
            raise ValueError(f"is a scene, not a study: a study file names the scene, {how}")
        checks.refuse_unknown("study file", data, _TOP, "")
        own = data.get("study", {})
        checks.refuse_unknown("[study]", own, SETTINGS, "")
        scene, given = scene_of(data, path.parent), data.get("vary", {})
        checks.instance("[vary]", given, Mapping, "a table from paths to distributions")
        vary: dict[Key, Any] = {}
        for name, value in given.items():
            paths = tuple(part.strip() for part in name.split(","))
            vary[paths[0] if len(paths) == 1 else paths] = _entry(name, value, path.parent)
        own = dict(own)
        if not any(isinstance(value, np.ndarray) for value in vary.values()):
            own.setdefault("runs", _RUNS)
        # Refuse wrong paths, shapes and numbers of runs here, in an error that names the file.
        draws = {name: own[name] for name in ("runs", "seed") if name in own}
        StudySpec.checked(scene, Options.checked(), vary=vary, **draws)
        return scene, vary, own


@contextmanager
def naming(path: Path, prefix: str = "") -> Iterator[None]:
    """Names a file in the errors of its content, which may begin with its name already."""
    try:
        yield
    except (TypeError, ValueError) as error:
        name = "" if str(error).startswith(str(path)) else f"{path}: "
        raise ValueError(f"{prefix}{name}{error}") from None


def scene_of(data: Mapping[str, Any], beside: Path) -> Scene:
    """Makes the scene from a study file's tables, or reads it from the file that they name."""
    given = data.get("scene", {})
    if isinstance(given, str):
        if "paper" in data:
            raise ValueError('scene and paper: give one of them, or a table "scene" of changes')
        path = beside / checks.path("scene", given, "a table, or the name of a scene file")
        with naming(path, "scene: "):
            return Scene.from_toml(path)
    checks.instance("scene", given, Mapping, "a table, or the name of a scene file")
    if "paper" not in data:
        return Scene._parse(given, "scene")
    case = paper.disturbance(checks.choice("paper", data["paper"], paper.CASES))
    return Scene._parse(_merged(case.to_dict(), given), "scene")


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Merges `changes` into `base`: tables recursively, all other values by replacement."""
    result = dict(base)
    for name, value in changes.items():
        old = result.get(name)
        # Replace a table of another kind as a whole, because its fields differ.
        if (
            isinstance(old, Mapping)
            and isinstance(value, Mapping)
            and value.get("kind", old.get("kind")) == old.get("kind")
        ):
            value = _merged(old, value)
        if name in ("angles", "angles_deg"):
            result.pop("angles", None)
        result[name] = value
    return result


def _entry(name: str, value: Any, beside: Path) -> Any:
    """Parses an entry of `[vary]`; the `kind` of a table selects from a closed list."""
    where = f'[vary]."{name}"'
    if not isinstance(value, Mapping):
        if not isinstance(value, list) or not value:
            rule = "must be a distribution, {kind = ...}, or an array with one entry a run"
            raise TypeError(f"{where} = {checks.shown(value)}: {rule}")
        return checks.numbers(where, value)
    if "kind" not in value:
        # TOML reads a dotted path without quotes as nested tables.
        rule = 'such as "grasped.mass", and a distribution with a "kind"'
        raise ValueError(f"[vary].{name}: must be one path in quotes, {rule}")
    if value["kind"] == "array":
        return _array(where, value, beside)
    if value["kind"] == "scipy":
        return frozen_distribution(where, value)
    if value["kind"] == "function":
        what = f"is the function or distribution {value.get('function')}"
        why = "which cannot be written to a file: call monte_carlo again with all of its arguments"
        raise ValueError(f"{where}: {what}, {why}")
    return Distribution._parse(value, where)


def _array(where: str, value: Mapping[str, Any], beside: Path) -> Floats:
    """Reads an array from its own file, as named in a manifest."""
    checks.refuse_unknown(where, value, ("kind", "shape", "file", "sha256"), "")
    for name in ("file", "sha256"):
        checks.instance(f"{where}: {name}", value.get(name), str, "text")
    path = beside / checks.path(f"{where}: file", value["file"], "the name of a file")
    shown = checks.shown(value["file"])
    # Studies write arrays only into their folder. A path elsewhere could be a device or a pipe, and
    # reading it might never end.
    if not path.resolve().is_relative_to(beside.resolve()):
        raise ValueError(f"{where}: file = {shown}: must be in the folder {beside}")
    with checks.reworded(f"{where}: file = {shown}: "):
        return load_array(path, value["sha256"])


def checksum(array: Floats) -> str:
    """SHA-256 of an array's numbers."""
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


def load_array(file: Path, sha256: str) -> Floats:
    """Opens a NumPy file as a memory map, and verifies its checksum; errors lack its name."""
    try:
        # Unlike `numpy.load`, this opens neither archives nor pickles.
        array: Floats = np.lib.format.open_memmap(file, mode="r")
    except FileNotFoundError:
        raise ValueError("is missing") from None
    # For damaged bytes NumPy raises errors of many types, OSError among them.
    except Exception as error:
        raise ValueError(f"is damaged: {one_line(error)}") from None
    if array.dtype != np.float64 or not array.ndim or checksum(array) != sha256:
        raise ValueError("has been altered: its checksum differs")
    return array
