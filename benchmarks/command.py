"""The command line that all benchmarks share.

A benchmark imports its peers only once the arguments are read: they take up to ten seconds, which
nobody waits for to read `--help` or to hear of a misspelt part.
"""

import argparse
from collections.abc import Sequence


def parser(description: str | None, parts: Sequence[str] = ()) -> argparse.ArgumentParser:
    """With `--help`, `--quick` and, where a benchmark has several parts, their names.

    Args:
        description: What `--help` prints first: the script's docstring.
        parts: What can be run alone; `part` of the parsed arguments is empty where none was named.
    """
    made = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument(
        "--quick",
        action="store_true",
        help="only show that it works: a few seconds, few runs and settings, nothing is written; "
        "the numbers are no measurement",
    )
    if parts:
        # Not by `choices`: Python 3.11 would look for the empty list among them.
        names = ", ".join(parts)

        def part(name: str) -> str:
            if name not in parts:
                raise argparse.ArgumentTypeError(f"{name!r} is none of {names}")
            return name

        made.add_argument("part", nargs="*", type=part, help=f"run only these, out of {names}")
    return made
