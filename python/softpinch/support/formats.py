"""What figures are saved as."""

from __future__ import annotations

FORMATS = ("png", "pdf", "svg")
