"""One writer at a time: a lock on a folder that its process holds, and that ends with it.

The system lets go of the lock when the process ends, however it ends: a process that was
killed leaves nothing behind that would have to be removed. Who holds it may remove the file.
"""

from __future__ import annotations

import fcntl
import os
import platform
from pathlib import Path

from ann_dc.errors import AnnDcError, OutputError

_HELD: set[int] = set()


def _leave_to_parent() -> None:
    """A forked process holds no lock: else it would hold it on after its parent's end."""
    for handle in _HELD:
        os.close(handle)
    _HELD.clear()


os.register_at_fork(after_in_child=_leave_to_parent)


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
        self._file = file
        self._handle = self._held(on, error)
        while not self._is_the_one():  # another has removed it since it was opened
            os.close(self._handle)
            self._handle = self._held(on, error)
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, f"process {os.getpid()} on {platform.node()}\n".encode(), 0)
        _HELD.add(self._handle)

    def release(self) -> None:
        """Let others have it; nothing if it is not held any more."""
        if self._handle in _HELD:
            _HELD.discard(self._handle)
            os.close(self._handle)

    def _held(self, on: str, error: type[AnnDcError]) -> int:
        handle = os.open(self._file, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as refused:
            holder = os.pread(handle, 300, 0).decode("utf-8", "replace").strip()
            os.close(handle)
            if not isinstance(refused, BlockingIOError):
                raise
            raise error(
                f"{str(self._file.parent)!r}: {holder or 'another process'} is at work on {on}; "
                "wait for its end or end it, or give another folder"
            ) from refused
        return handle

    def _is_the_one(self) -> bool:
        """Whether the file that is held is the one that others open."""
        try:
            return os.path.samestat(os.fstat(self._handle), self._file.stat())
        except FileNotFoundError:
            return False
