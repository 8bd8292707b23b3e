"""The shell commands. Each parses its options, calls the public Python function, and prints.

`commands` has the application with `run` and `reproduce`; `montecarlo` and `fit` have the commands
of these names, `accuracy` has `stability`, `work-precision` and `advise`. `options` has the options
of several commands, `shell` exit codes and one-line errors, `study_report` the tables and figures
of a study. Needs the extra `cli`.
"""

from .commands import app

__all__ = ["app"]
