"""Locks of files: held by one process, and gone with it however it ends."""

from __future__ import annotations

import errno
import os
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

#: The byte that is locked; what is written before it can be read by all.
BYTE = 1 << 20

#: Error numbers where another process has the lock.
HELD = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)

#: The files locked here: locks of the system are between processes, not threads.
_own: set[tuple[int, str]] = set()
_guard = threading.Lock()


def lock_of(store: Path) -> Path:
    """Return the file that is locked by the process that makes a stored run."""
    return store / "checkpoint" / "lock"


@contextmanager
def locked(file: Path, refusal: str) -> Iterator[None]:
    """Hold the lock of a file, which is made where there is none.

    Where the file system has no locks, a warning says so.

    Raises
    ------
    BlockingIOError
        Another process or thread holds it: `refusal`, and which one.
    """
    # a forked child has the set and not the lock
    key = (os.getpid(), os.path.realpath(file))
    with _guard:
        if key in _own:
            raise BlockingIOError(f"{refusal}: this process")
        _own.add(key)
    try:
        with file.open("a+b") as opened:
            try:
                _lock(opened)
            except OSError as error:
                if error.errno in HELD:
                    raise BlockingIOError(f"{refusal}: {_holder(file)}") from None
                warnings.warn(
                    f"{str(file)!r} cannot be locked ({error}): see to it that no other process "
                    "goes on with this run",
                    RuntimeWarning,
                    stacklevel=2,
                )
            opened.truncate(0)
            opened.write(b"process %d" % os.getpid())
            opened.flush()
            yield
    finally:
        with _guard:
            _own.discard(key)


def _lock(opened: Any) -> None:
    if sys.platform == "win32":
        opened.seek(BYTE)
        msvcrt.locking(opened.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        fcntl.lockf(opened, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, BYTE)


def _holder(file: Path) -> str:
    return file.read_bytes().decode(errors="replace") or "another process"
