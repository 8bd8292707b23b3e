"""The Gallery: each script of examples/ runs, and its picture and what it prints are shown.

The scripts take the name of their picture as an argument and draw without pyplot. So each gets a
name in the build's folder, and the scraper finds the picture there.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst

ROOT = Path(__file__).resolve().parents[2]
_PICTURES = Path(tempfile.mkdtemp(prefix="softpinch-gallery-"))


def _arguments(_: Any, variables: dict[str, Any]) -> list[str]:
    """The arguments of a script: the name of its picture."""
    return [str(_PICTURES / f"{Path(variables['src_file']).stem}.png")]


class _Arguments:
    """As a class, since Sphinx keeps settings in a file and compares what they print."""

    def __call__(self, gallery: Any, variables: dict[str, Any]) -> list[str]:
        return _arguments(gallery, variables)

    def __repr__(self) -> str:
        return "PictureArguments"


class _SavedPicture:
    """Finds the picture that a script has saved since the last block."""

    def __call__(self, block: Any, variables: dict[str, Any], gallery: dict[str, Any]) -> str:
        picture = _PICTURES / f"{Path(variables['src_file']).stem}.png"
        if not picture.exists():
            return ""
        place = next(variables["image_path_iterator"])
        shutil.move(picture, place)
        return str(figure_rst([place], gallery["src_dir"]))

    def __repr__(self) -> str:
        return "SavedPicture"


SETTINGS = {
    "examples_dirs": str(ROOT / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"/\d\d_\w+\.py$",
    "ignore_pattern": r"__init__\.py",
    "reset_argv": _Arguments(),
    "image_scrapers": (_SavedPicture(),),
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "show_signature": False,
    "remove_config_comments": True,
    "abort_on_example_error": False,
    "only_warn_on_example_error": False,
    "capture_repr": (),
    "backreferences_dir": None,
    # The scripts are no notebooks: they take arguments, and draw without pyplot.
    "notebook_extensions": set(),
}
