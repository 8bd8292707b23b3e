"""Entry point of `python -m softpinch` and of the console script `softpinch`."""

import os
import sys

from .support.extras import require


def main() -> None:
    """Runs the command line.

    Raises:
        SystemExit: With code 0 for success; 1 if a run ended early, an extra is missing, or
            standard output cannot be written (reported, except for a closed pipe); 2 for bad input;
            130 after Ctrl-C.
    """
    try:
        for module in ("typer", "rich"):
            require(module, extra="cli", purpose="the command line")
        from .cli import app

        app()
    except ImportError as error:
        # The message says which extra to install.
        print(error, file=sys.stderr)
        raise SystemExit(1) from None
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print(f"error: {error.strerror or error}", file=sys.stderr)
        # At exit the interpreter flushes the buffered rest again; without this that fails too.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
