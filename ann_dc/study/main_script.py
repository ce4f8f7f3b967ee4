"""Script that runs a study, in the workers of that study.

A worker of `multiprocessing` runs the script of its parent again, and a script without
``if __name__ == "__main__":`` would then run its study in every worker. A worker of a study runs
the script only if the work needs a function of it, and only as far as the study.
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
"""Name of the script in a worker, which `multiprocessing` gives it too."""


class Script(NamedTuple):
    """Script of a process.

    Attributes
    ----------
    file : str
        Empty for a notebook or a prompt.
    package : str or None
        Package that its relative imports start from.
    """

    file: str
    package: str | None


class _Reached(BaseException):
    """Raised in a worker if its script begins a study; the lines above define its functions."""


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

    Parameters
    ----------
    pickled : bytes
    given : Script

    Raises
    ------
    StudyError
        If a function is missing and there is no file that defines it.

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
