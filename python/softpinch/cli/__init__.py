"""The shell commands: `softpinch run`, `reproduce`, `montecarlo`, `stability` and the others.

They parse, call what Python users call, and print. Needs the extra `cli`.
"""

from .commands import app

__all__ = ["app"]
