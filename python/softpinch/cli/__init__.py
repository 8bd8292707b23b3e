"""The shell commands, which call the public Python functions, and need the extra `cli`."""

from .commands import app

__all__ = ["app"]
