"""Lock on a folder that allows one writer at a time.

The operating system releases the lock when the process ends in any way. A killed process leaves
nothing that would have to be removed. The owner of the lock may remove the file.
"""

from __future__ import annotations

import os
import platform
from pathlib import Path

from filelock import FileLock, Timeout

from ann_dc.errors import AnnDcError, OutputError

PATIENCE = 0.05
"""Seconds in which a file that its owner has just removed is created again."""
LOCKED = 1
"""Number of bytes at the start of the file that other Windows processes cannot read."""


class Lock:
    """Lock on a folder, acquired in its construction.

    The lock file, in an existing folder, names the owner and remains after the release. `on`
    describes the written object in the error message. Raises an error of type `error` that names
    process and host of another owner, and `OSError` if the file cannot be written.
    """

    def __init__(
        self, file: Path, *, on: str = "this folder", error: type[AnnDcError] = OutputError
    ) -> None:
        self._lock = FileLock(file, thread_local=False, on_acquired=_sign)
        try:
            self._lock.acquire(PATIENCE, PATIENCE / 5)
        except Timeout as refused:
            raise error(
                f"{str(file.parent)!r}: {_holder(file) or 'another process'} is at work on {on}; "
                "wait for its end or end it, or give another folder"
            ) from refused

    def release(self) -> None:
        """Release the lock; a released lock is ignored."""
        self._lock.release()


def _sign(handle: int) -> None:
    """Write the identity of the owner into the file."""
    os.ftruncate(handle, 0)
    os.write(handle, b" " * LOCKED + f"process {os.getpid()} on {platform.node()}\n".encode())


def _holder(file: Path) -> str:
    try:
        with file.open("rb", buffering=0) as stream:
            stream.seek(LOCKED)
            return stream.read(300).decode("utf-8", "replace").strip()
    except OSError:
        return ""
