"""`python -m softpinch`, and the console script `softpinch`."""

from __future__ import annotations

import os
import sys

from .support.extras import require


def main() -> None:
    """Runs the command line.

    Raises:
        SystemExit: With 0 for a run that completed; 1 for one that ended early, or where an extra
            is missing, or where standard output takes nothing more, which is said unless it is a
            closed pipe; 2 for bad input; 130 after Ctrl-C.
    """
    try:
        for module in ("typer", "rich"):
            require(module, extra="cli", purpose="the command line")
        from .cli import app

        app()
    except ImportError as error:
        # One line that says what to install, whichever extra it is.
        print(error, file=sys.stderr)
        raise SystemExit(1) from None
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print(f"error: {error.strerror or error}", file=sys.stderr)
        # What is left in it would be tried again at the very end, with an error of its own.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
