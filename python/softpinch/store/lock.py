"""A lock on a folder, which the operating system frees when its process ends, however it ends.

POSIX's record locks belong to a process. `flock`, which the well-known libraries use, would not do:
workers that are forked inherit it, and hold it on when the one that forked them is killed.
"""

from __future__ import annotations

import errno
import os
import socket
import sys
import threading
from pathlib import Path

from ..support.interrupt import ignoring_system

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

# Where Windows locks a byte, which nobody can read then.
_FAR = 2**30
# The locks of this process. POSIX lets it take one twice, and frees it with the first that closes.
_HELD: set[tuple[int, int, int]] = set()
_GUARD = threading.Lock()


class LockedError(OSError):
    """Someone else has it; the message says who, where that is known."""


class Lock:
    """Held from when it is made until `release`."""

    def __init__(self, path: Path) -> None:
        """Takes the lock of a file, which is made where it is not there.

        Raises:
            LockedError: Someone has it.
            OSError: The file cannot be made, or its file system has no locks.
        """
        with _GUARD:
            if path.exists() and self._key(path.stat()) in _HELD:
                raise LockedError("this process")
            # The file is emptied, so a link must not make that another one.
            if path.is_symlink():
                raise OSError(errno.ELOOP, f"{path.name} is a symbolic link")
            alone = getattr(os, "O_NOFOLLOW", 0)
            self._fd = os.open(path, os.O_RDWR | os.O_CREAT | alone, 0o644)
            found = os.fstat(self._fd)
            self._mine = self._key(found)
            try:
                if found.st_nlink > 1:
                    raise OSError(
                        errno.EMLINK,
                        f"{path.name} is a hard link, and another file would be emptied: delete it",
                    )
                self._take()
                _HELD.add(self._mine)
            except BaseException as error:  # a signal's too: nobody would have it to give back
                owner = os.read(self._fd, 200).decode(errors="replace").strip()
                self._free()
                taken = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
                if isinstance(error, OSError) and error.errno in taken:
                    raise LockedError(owner or "another process") from None
                raise
            # It holds without a name, too, where the disk is full.
            try:
                with ignoring_system():
                    os.truncate(self._fd, 0)
                    name = f"process {os.getpid()} on {socket.gethostname()}\n"
                    os.write(self._fd, name.encode())
            except BaseException:
                self._free()
                raise

    @staticmethod
    def _key(found: os.stat_result) -> tuple[int, int, int]:
        # A forked process has the set, and not the locks.
        return os.getpid(), found.st_dev, found.st_ino

    def _take(self) -> None:
        if sys.platform == "win32":
            os.lseek(self._fd, _FAR, os.SEEK_SET)
            msvcrt.locking(self._fd, msvcrt.LK_NBLCK, 1)
            os.lseek(self._fd, 0, os.SEEK_SET)
        else:
            fcntl.lockf(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def release(self) -> None:
        """Gives it back."""
        with _GUARD:
            self._free()

    def _free(self) -> None:
        _HELD.discard(self._mine)
        os.close(self._fd)
