"""The file formats of figures."""

from __future__ import annotations

FORMATS = ("png", "pdf", "svg")
