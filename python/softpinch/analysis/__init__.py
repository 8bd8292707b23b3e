"""One scene in depth: where it comes to rest, and what a small deviation from there does."""

from typing import TYPE_CHECKING

from ..support.lazy import lazily

if TYPE_CHECKING:
    pass
else:
    __getattr__ = lazily(__name__, {})

__all__: list[str] = []
