"""One writer at a time: a lock on a folder that its process holds, and that ends with it.

The system lets go of the lock when the process ends, however it ends: a process that was
killed leaves nothing behind that would have to be removed. Who holds it may remove the file.
"""

from __future__ import annotations

import os
import platform
from pathlib import Path

from filelock import FileLock, Timeout

from ann_dc.errors import AnnDcError, OutputError

PATIENCE = 0.05
"""Seconds in which a file that its holder has just removed is made again."""
LOCKED = 1
"""Bytes at the beginning of the file that Windows lets nobody else read."""


class Lock:
    """Held from its construction on.

    Parameters
    ----------
    file : Path
        In a folder that is there; it tells who holds the lock, and stays when nobody does.
    on : str
        What is written there, as the error calls it.
    error : type of AnnDcError
        What is raised.

    Raises
    ------
    AnnDcError
        Of that kind, if another has it; it is named by process and host.
    OSError
        If the file cannot be written.
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
        """Let others have it; nothing if it is not held any more."""
        self._lock.release()


def _sign(handle: int) -> None:
    """Write into the file who holds it."""
    os.ftruncate(handle, 0)
    os.write(handle, b" " * LOCKED + f"process {os.getpid()} on {platform.node()}\n".encode())


def _holder(file: Path) -> str:
    try:
        with file.open("rb", buffering=0) as stream:
            stream.seek(LOCKED)
            return stream.read(300).decode("utf-8", "replace").strip()
    except OSError:
        return ""
