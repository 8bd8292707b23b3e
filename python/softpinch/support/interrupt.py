"""Ctrl-C that waits until finished work is kept."""

import os
import signal
import threading
from types import FrameType
from typing import Any, Self


class CtrlC:
    """Defers Ctrl-C while `held` is true, on the main thread if SIGINT has Python's own handler."""

    def __init__(self) -> None:
        self.held = False  # whether Ctrl-C is deferred; the user of the object sets it
        self.pending = False  # whether Ctrl-C came while it was deferred
        self._before: Any = None
        self._process = os.getpid()

    def __enter__(self) -> Self:
        handler = signal.getsignal(signal.SIGINT)
        other = getattr(handler, "__self__", None)
        # A worker that was forked while its parent handled Ctrl-C has the handler of its parent.
        inherited = isinstance(other, CtrlC) and other._process != self._process
        on_main = threading.current_thread() is threading.main_thread()
        if on_main and (handler is signal.default_int_handler or inherited):
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *error: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if not self.held:
            raise KeyboardInterrupt
        self.pending = True
