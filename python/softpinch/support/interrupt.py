"""Ctrl-C that waits for what must not be cut in two, and what signal handlers raise."""

from __future__ import annotations

import os
import signal
import threading
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
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


@contextmanager
def handlers_waiting() -> Iterator[None]:
    """Inside, a signal that Python handles is noted; its handler is called at the end.

    Compiled modules lose what a handler raises while they are being imported, or make an
    ImportError of it. Blocking signals on this thread would not do: another thread, such as one of
    BLAS, takes them then, and the handler is called on this one all the same.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # no handler is called here
        return
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)

    def give_back(number: int, handler: Any) -> None:
        # What is imported may have put a handler of its own there.
        if signal.getsignal(number) is note:
            signal.signal(number, handler)
            if number in came:
                signal.raise_signal(number)

    # Each is given back, whatever the handler of another raises then.
    with ExitStack() as stack:
        for number in signal.valid_signals():
            handler = signal.getsignal(number)
            if callable(handler):
                stack.callback(give_back, number, handler)
                signal.signal(number, note)
        yield


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
        self._process = os.getpid()

    def __enter__(self) -> Self:
        """Takes the signal over."""
        handler = signal.getsignal(signal.SIGINT)
        other = getattr(handler, "__self__", None)
        # A worker that was forked while its parent handled Ctrl-C has the handler of its parent.
        inherited = isinstance(other, CtrlC) and other._process != self._process
        on_main = threading.current_thread() is threading.main_thread()
        if on_main and (handler is signal.default_int_handler or inherited):
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
