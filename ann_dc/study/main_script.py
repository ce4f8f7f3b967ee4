"""Parent script of a study in the workers of that study.

A worker of `multiprocessing` runs the script of its parent again. A script without ``if __name__ ==
"__main__":`` would then run its study in every worker. A worker of a study runs the script only if
the work needs a function of the script. It then stops where the study begins.
"""

from __future__ import annotations

import contextlib
import pickle
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from ann_dc.errors import StudyError

NAME = "__mp_main__"
"""Name of the script module in a worker, as assigned by `multiprocessing`."""


class Script(NamedTuple):
    """Script of a process.

    Attributes
    ----------
    file : str
        Path; empty for a notebook or a prompt.
    package : str or None
        Package from which relative imports of the script start.
    """

    file: str
    package: str | None


class _Reached(BaseException):
    """Raised in a worker where its script begins a study, after all functions above."""


_running: list[Script] = []


def own_script() -> Script:
    """Return the script of this process.

    Examples
    --------
    >>> own_script() == own_script()
    True
    """
    main = sys.modules["__main__"]
    path = Path(getattr(main, "__file__", None) or "")
    file = str(path.absolute()) if path.is_file() else ""
    return Script(file, getattr(main, "__package__", None))


def loaded(pickled: bytes, given: Script) -> Any:
    """Return the unpickled object; run the script if a function of it is missing.

    Raises `StudyError` if a function is missing and no file defines it.

    Examples
    --------
    >>> loaded(pickle.dumps(max), Script("", None))(3, 5)
    5
    """
    try:
        return pickle.loads(pickled)
    except AttributeError as error:
        if not given.file:
            raise StudyError(f"{error}; write its functions into a module") from error
    module = ModuleType(NAME)
    module.__file__, module.__package__ = given
    sys.modules["__main__"] = sys.modules[NAME] = module
    _running.append(given)
    with contextlib.suppress(_Reached):
        exec(compile(Path(given.file).read_bytes(), given.file, "exec"), vars(module))
    _running.clear()
    return pickle.loads(pickled)


def stop_script() -> None:
    """Stop the script that a worker runs; do nothing in any other process."""
    if _running:
        raise _Reached
