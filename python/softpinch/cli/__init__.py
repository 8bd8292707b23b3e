"""The shell commands. Each parses its options, calls the public Python function, and prints.

Needs the extra `cli`.
"""

from .commands import app

__all__ = ["app"]
