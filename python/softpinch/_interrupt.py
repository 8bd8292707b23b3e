"""Ctrl-C that waits for what must not be cut in two, and what signal handlers raise."""

from __future__ import annotations

import signal
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from types import CodeType, FrameType, TracebackType
from typing import Any, Self


def by_handler(error: BaseException) -> bool:
    """Whether a signal handler has raised it, and not the code that it came in the middle of.

    A deadline's `TimeoutError` says nothing about the executor or the file at which it happens to
    arrive, so it must reach the caller. It is told by the handler's frame in its traceback; a
    handler that is no Python function, or that has taken itself off before it raised, is not seen.
    """
    handlers = [signal.getsignal(number) for number in signal.valid_signals()]
    codes = {_code(handler) for handler in handlers} - {None}
    return any(frame.f_code in codes for frame, _ in traceback.walk_tb(error.__traceback__))


def of_system(error: OSError) -> bool:
    """Whether the operating system has raised it: its errors have a number."""
    return error.errno is not None and not by_handler(error)


@contextmanager
def ignoring_system() -> Iterator[None]:
    """As `suppress(OSError)`, but for the system's own only."""
    try:
        yield
    except OSError as error:
        if not of_system(error):
            raise


def _code(handler: Any) -> CodeType | None:
    """That of a function, a method, a partial one, or an object that can be called."""
    function = getattr(handler, "func", handler)
    if not callable(function):
        return None
    found: CodeType | None = getattr(
        function, "__code__", getattr(function.__call__, "__code__", None)
    )
    return found


class CtrlC:
    """While it is entered, Ctrl-C is noted where `held`, and raises `KeyboardInterrupt` elsewhere.

    Only on the main thread, which alone gets signals, and where nobody else handles them.

    Attributes:
        held: Whether it waits.
        pending: Whether it came while it had to wait.
    """

    def __init__(self) -> None:
        """Not entered yet."""
        self.held = False
        self.pending = False
        self._before: Any = None

    def __enter__(self) -> Self:
        """Takes the signal over."""
        on_main = threading.current_thread() is threading.main_thread()
        if on_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Gives it back."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if not self.held:
            raise KeyboardInterrupt
        self.pending = True
