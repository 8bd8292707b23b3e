"""Deferred Ctrl-C for critical sections, and recognition of errors raised by signal handlers."""

from __future__ import annotations

import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import CodeType, FrameType, TracebackType
from typing import Any, Self


def by_handler(error: BaseException) -> bool:
    """Whether a signal handler raised an error, rather than the code that the signal interrupted.

    The `TimeoutError` of a user's deadline says nothing about the executor or the file in use at
    that moment, so it must reach the caller. Such an error is recognised by the handler's frame in
    its traceback. A handler that is not a Python function, or that uninstalled itself before
    raising, is not recognised.
    """
    handlers = [signal.getsignal(number) for number in signal.valid_signals()]
    codes = {_code(handler) for handler in handlers} - {None}
    return any(frame.f_code in codes for frame, _ in traceback.walk_tb(error.__traceback__))


@contextmanager
def handlers_waiting() -> Iterator[Callable[[], None]]:
    """Defers Python's signal handlers until the end of the block.

    A compiled module that is being imported loses an exception raised by a handler, or turns it
    into an ImportError; so do compiled solvers that call back, and Python's callbacks of weak
    references. Blocking signals on this thread would not help: another thread, such as one of BLAS,
    would receive them, and Python would still call the handler on this thread.

    Yields:
        A function that calls the handlers of the signals that have come so far.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None  # Python calls handlers on the main thread only
        return
    came: list[int] = []
    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)

    def deliver() -> None:
        while came:
            number = came.pop(0)
            handlers[number](number, None)

    def give_back(number: int, handler: Any) -> None:
        # Keep a handler that the imported module has installed.
        if signal.getsignal(number) is note:
            signal.signal(number, handler)
            if number in came:
                signal.raise_signal(number)

    # ExitStack restores every handler, even if a deferred handler raises.
    with ExitStack() as stack:
        for number in signal.valid_signals():
            handler = signal.getsignal(number)
            if callable(handler):
                handlers[number] = handler
                stack.callback(give_back, number, handler)
                signal.signal(number, note)
        yield deliver


def of_system(error: OSError) -> bool:
    """Whether the operating system raised an error: it has an errno and no handler raised it."""
    return error.errno is not None and not by_handler(error)


@contextmanager
def ignoring_system() -> Iterator[None]:
    """Suppresses an OSError from the operating system, but not one raised by a signal handler."""
    try:
        yield
    except OSError as error:
        if not of_system(error):
            raise


def _code(handler: Any) -> CodeType | None:
    """Returns the code object of a function, a method, a partial or a callable object, or None."""
    function = getattr(handler, "func", handler)
    if not callable(function):
        return None
    found: CodeType | None = getattr(
        function, "__code__", getattr(function.__call__, "__code__", None)
    )
    return found


class CtrlC:
    """Context manager that defers Ctrl-C while `held` is true.

    While `held` is false, Ctrl-C raises `KeyboardInterrupt` as usual. The context manager has an
    effect only on the main thread, which alone receives signals, and only if SIGINT has Python's
    default handler.

    Attributes:
        held: Whether Ctrl-C is deferred; the user of the object sets it.
        pending: Whether Ctrl-C came while it was deferred.
    """

    def __init__(self) -> None:
        """Installs no handler yet."""
        self.held = False
        self.pending = False
        self._before: Any = None
        self._process = os.getpid()

    def __enter__(self) -> Self:
        """Installs the handler."""
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
        """Restores the previous handler."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if not self.held:
            raise KeyboardInterrupt
        self.pending = True
