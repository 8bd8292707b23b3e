"""Sphinx's settings: `make docs` builds the site from these pages, the examples and docstrings.

Nothing is fetched while the site is built or read: MathJax is copied from a package, fonts are the
reader's own, and other projects' names are not links (`nitpick_ignore_regex`).
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from extensions import gallery

from softpinch import __version__

project = "softpinch"
version = release = __version__
copyright = "the softpinch maintainers"
html_title = f"softpinch {__version__}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "extensions.api",
    "extensions.docstrings",
    "extensions.equations",
    "extensions.names",
    "extensions.links",
    "extensions.commands",
]
exclude_patterns = ["extensions", "gallery/**/*.md5", "gallery/*.ipynb", "gallery/*.zip"]
nitpicky = True
# Types of other packages: their inventories could only be had over the network.
nitpick_ignore_regex = [
    ("py:.*", r"(numpy|np|collections|pathlib|concurrent|matplotlib|xarray|pandas|pyarrow)\..*"),
    ("py:.*", r"(control|scipy|jax|gymnasium|hypothesis|rich|types|dataclasses|enum)\..*"),
    (
        "py:.*",
        "(Axes|ContactModel|DataFrame|Dataset|Figure|Fingers|NDArray|ArrayLike|Bools|Floats|Path|"
        "ResetNeeded)",
    ),
    # Types inside the package, which functions take from each other and users never name.
    ("py:class", r"softpinch\.[a-z_]+\.\w+(\.\w+)?"),
    ("py:class", r"(Engine|Report|Mask|tuple\[float)"),
]

html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["softpinch.css"]
# The pages' sources and the times of the gallery's scripts are in the repository, not on the site.
html_copy_source = False

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

default_role = "name"
# Text keeps its characters: `--quick` is an option.
smartquotes = False
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
maximum_signature_line_length = 90
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

sphinx_gallery_conf = gallery.SETTINGS
