"""Resources of package and machine: SPICE library, processor cores, BLAS threads."""

from __future__ import annotations

import os
import sys
import threading
from functools import cache
from pathlib import Path
from typing import Any

LAPACK = "scipy.linalg"
"""Module that loads SciPy's BLAS; without it no code factorises a matrix."""


def circuits_path() -> Path:
    """Return the folder of the SPICE library.

    Returns
    -------
    pathlib.Path
        Folder with the subfolders ``cells`` and ``models``.

    Raises
    ------
    FileNotFoundError
        If the installation is incomplete.

    Examples
    --------
    >>> sorted(part.name for part in (circuits_path() / "models" / "presets").glob("tl*.lib"))
    ['tl072_ad633.lib']
    """
    package = Path(__file__).resolve().parent
    for folder in (package / "circuits", package.parent / "circuits"):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(
        f"the SPICE library is missing: neither {package / 'circuits'} nor "
        f"{package.parent / 'circuits'} exists; install ann_dc again"
    )


def cores() -> int:
    """Return the number of cores that this process may use.

    If the system does not restrict a process to some of its cores (macOS, Windows), the result is
    the number of cores of the machine.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def one_thread() -> OneThread:
    """Return the context in which BLAS and LAPACK use one thread.

    Matrices of a few hundred rows are too small for more threads, which wait for each other at
    every step of a factorisation. On two cores the eigenvalues of 365 neurons then take 2 s instead
    of 0.07 s. Every function decorated with `checked` runs in this context.

    Examples
    --------
    >>> import numpy as np
    >>> with one_thread():
    ...     np.linalg.eigvalsh(np.eye(2)).tolist()
    [1.0, 1.0]
    """
    return _ONE_THREAD


class OneThread:
    """Limit of one BLAS thread, common to all nested and concurrent uses in a process.

    The first use sets the limit and the last use restores the caller's number of threads. Other
    thread pools, such as those of PyTorch and OpenMP, are not changed. A forked process inherits
    the uses of the thread that forked it; the other threads do not exist there.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._uses = 0
        self._of_thread = threading.local()
        self._before: list[tuple[Any, int]] | None = None

    def __enter__(self) -> OneThread:
        with self._lock:
            try:
                if self._before is None and LAPACK in sys.modules:
                    found = [(library, library.num_threads) for library in _libraries()]
                    self._before = [(library, number) for library, number in found if number != 1]
                    for library, _ in self._before:
                        _set(library, 1)
            except BaseException:
                self._restore()
                raise
            self._count(1)
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._count(-1)
            if not self._uses:
                self._restore()

    def forked(self) -> None:
        """Remove the uses and locks of other threads in a forked process."""
        self._lock = threading.Lock()
        self._uses = getattr(self._of_thread, "uses", 0)

    def _count(self, more: int) -> None:
        self._uses += more
        self._of_thread.uses = getattr(self._of_thread, "uses", 0) + more

    def _restore(self) -> None:
        before, self._before = self._before or (), None
        for library, number in before:
            _set(library, number)


def _set(library: Any, number: int) -> None:
    """Set a number of threads, regardless of the Python thread that set the last one."""
    release = getattr(library, "clear_controlling_thread", None)
    if release:  # threadpoolctl lets only the thread that came first set those of OpenBLAS
        release(force=True)
    library.set_num_threads(number)
    if release:
        release()


@cache
def _libraries() -> list[Any]:
    """Return the loaded BLAS libraries; the search takes a millisecond."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas").lib_controllers


_ONE_THREAD = OneThread()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_ONE_THREAD.forked)
