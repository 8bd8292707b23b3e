"""The shell commands. Each parses its options, calls the public Python function, and prints.

`commands` has the application with `run`, `reproduce` and `fit`; `montecarlo` has the command of
this name, with the tables and figures of a study; `accuracy` has `stability`, `work-precision` and
`advise`. `options` has the options of several commands, `shell` exit codes and one-line errors.
Needs the extra `cli`.
"""

from .commands import app

__all__ = ["app"]
