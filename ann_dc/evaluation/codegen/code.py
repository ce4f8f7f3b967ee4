"""Addresses of compiled functions, by the wiring that they were made for.

Code is looked for in memory, then on disk, and made where there is none. The key is everything that
it depends on: wiring, processor, compiler, and the modules here that wrote it.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path

from ann_dc import jit_cache as object_cache
from ann_dc.evaluation.codegen.machine import compile_text, load_object, processor

_loaded: dict[str, dict[str, int]] = {}
_lock = threading.Lock()


@cache
def _written_by(folder: Path) -> bytes:
    """The modules of a room, as a checksum."""
    total = hashlib.sha256()
    for module in sorted(folder.glob("*.py")):
        total.update(module.read_bytes())
    return total.digest()


def key_of(identity: tuple, *folders: Path) -> str:
    """The key of a piece of code.

    Parameters
    ----------
    identity : tuple
        Plain numbers and words that tell it from any other.
    *folders : Path
        Of the modules that write it.

    Returns
    -------
    str
        Hexadecimal.
    """
    written = map(_written_by, (*folders, Path(__file__).parent))
    parts = repr(identity).encode(), processor().encode(), *written
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def code(key: str, write: Callable[[], str], names: tuple[str, ...]) -> dict[str, int]:
    """Addresses of the functions of a piece of code.

    Parameters
    ----------
    key : str
    write : callable
        Gives its text where it has to be compiled.
    names : tuple of str
        Of its functions.

    Returns
    -------
    dict of str to int
    """
    with _lock:
        if key not in _loaded:
            content = object_cache.load(key)
            if content is None:
                content = compile_text(write(), key[:16])
                object_cache.store(key, content)
            _loaded[key] = load_object(content, names, key[:16])
        return _loaded[key]
