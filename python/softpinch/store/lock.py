"""A lock on a folder, which the operating system releases when the owning process ends.

On POSIX it is a record lock (`fcntl.lockf`), which belongs to one process. A lock by `flock`, as in
well-known locking libraries, is not suitable: forked workers inherit it and keep it when their
parent is killed.
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

# Offset of the byte that Windows locks. A locked byte cannot be read, so it lies behind the text.
_FAR = 2**30
# Locks held by this process, needed because POSIX lets one process take a record lock twice and
# releases it when the first descriptor closes.
_HELD: set[tuple[int, int, int]] = set()
_GUARD = threading.Lock()


class LockedError(OSError):
    """The lock is already held; the message names its owner where that is known."""


class Lock:
    """An exclusive lock, held from its construction until `release`."""

    def __init__(self, path: Path) -> None:
        """Takes the lock on a file, and makes the file if it is missing.

        Raises:
            LockedError: Another process, or this one, holds the lock.
            OSError: The file cannot be made, is a link, or its file system has no locks.
        """
        with _GUARD:
            if path.exists() and self._key(path.stat()) in _HELD:
                raise LockedError("this process")
            # The lock file is truncated below; a link could make that another file.
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
                        f"{path.name} is a hard link, its other file would be emptied: delete it",
                    )
                self._take()
                _HELD.add(self._mine)
            # BaseException, because after a signal no caller would have the lock to release it.
            except BaseException as error:
                owner = os.read(self._fd, 200).decode(errors="replace").strip()
                self._free()
                taken = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
                if isinstance(error, OSError) and error.errno in taken:
                    raise LockedError(owner or "another process") from None
                raise
            # The owner's name is optional: on a full disk the lock holds without it.
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
        # A forked process inherits the set but not the locks, so the key has the process id.
        return os.getpid(), found.st_dev, found.st_ino

    def _take(self) -> None:
        if sys.platform == "win32":
            os.lseek(self._fd, _FAR, os.SEEK_SET)
            msvcrt.locking(self._fd, msvcrt.LK_NBLCK, 1)
            os.lseek(self._fd, 0, os.SEEK_SET)
        else:
            fcntl.lockf(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def release(self) -> None:
        """Releases the lock."""
        with _GUARD:
            self._free()

    def _free(self) -> None:
        _HELD.discard(self._mine)
        os.close(self._fd)
