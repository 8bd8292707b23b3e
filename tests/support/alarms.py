"""A signal whose handler raises, for tests of what a handler of the user's may do."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def alarm(error: BaseException, after: float = 0.3) -> Iterator[None]:
    """A handler that raises `error` after so many seconds, and a check that it was soon heard."""

    def handle(number: int, frame: FrameType | None) -> None:
        raise error

    before = signal.signal(signal.SIGALRM, handle)
    begun = time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, after)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        # Generous: this is about minutes against seconds, no measurement.
        assert time.monotonic() - begun < 10.0
