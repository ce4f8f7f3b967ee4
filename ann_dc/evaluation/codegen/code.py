"""Addresses of compiled functions by the wiring for which they were compiled.

Code is searched in memory, then on disk, and compiled if there is none. The key contains everything
on which the code depends: wiring, processor, compiler, and the modules that wrote the code.
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
    """Return the checksum of the modules in a folder."""
    total = hashlib.sha256()
    for module in sorted(folder.glob("*.py")):
        total.update(module.read_bytes())
    return total.digest()


def key_of(identity: tuple, *folders: Path) -> str:
    """Return the key of a piece of code as a hexadecimal string.

    The identity contains plain numbers and words that distinguish the code. The folders contain the
    modules that write the code.
    """
    written = map(_written_by, (*folders, Path(__file__).parent))
    parts = repr(identity).encode(), processor().encode(), *written
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def code(key: str, write: Callable[[], str], names: tuple[str, ...]) -> dict[str, int]:
    """Return the addresses of the named functions of a piece of code.

    ``write`` returns the text of the code, if it must be compiled.
    """
    with _lock:
        if key not in _loaded:
            content = object_cache.load(key)
            if content is None:
                content = compile_text(write(), key[:16])
                object_cache.store(key, content)
            _loaded[key] = load_object(content, names, key[:16])
        return _loaded[key]
