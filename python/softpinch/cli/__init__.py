"""The shell commands. Each parses its options, calls the public Python function, and prints.

`commands` has the application with `run` and `reproduce`; `montecarlo`, `stability` and `precision`
have the commands of these names (`precision`: `work-precision` and `advise`). `options` has options
that several commands share, `shell` exit codes and one-line errors, `study_report` the tables and
figures of a study. Needs the extra `cli`.
"""

from .commands import app

__all__ = ["app"]
