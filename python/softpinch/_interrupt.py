"""Ctrl-C that waits for what must not be cut in two."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self


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
