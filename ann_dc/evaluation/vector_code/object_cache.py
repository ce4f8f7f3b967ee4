"""Compiled code on disk: loaded only from a folder that belongs to the user alone, and only whole.

A file holds a checksum over its name and its content. What does not fit, a folder that others can
write to, a full disk: the run goes on with code compiled in memory, and one warning says why.
"""

from __future__ import annotations

import hashlib
import os
import stat
import warnings
from functools import cache
from pathlib import Path

from ann_dc.errors import AnnDcError
from ann_dc.whole_files import read_whole, write_whole

FOLDER_VARIABLE = "ANN_DC_CACHE"
"""Environment variable that names another folder."""
MOST_FILES = 512
"""Files kept; beyond it the oldest ones go."""
LARGEST = 64 * 2**20
"""Bytes of a file."""


def folder() -> Path:
    """Where compiled code lies: a folder of its own in the user's cache folder."""
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ann_dc"


def load(key: str) -> bytes | None:
    """What is stored under a key; None where nothing is that can be trusted.

    Parameters
    ----------
    key : str
        Hexadecimal.

    Returns
    -------
    bytes or None
    """
    file = folder() / f"{key}.o"
    if not _trusted_folder(folder()) or not file.exists():
        return None
    try:
        content = read_whole(file, limit=LARGEST, remedy="delete it") if _is_private(file) else None
    except (OSError, AnnDcError) as error:
        _warn(f"compiled code is not read from {file}: {error}")
        return None
    if content is None:
        _warn(f"compiled code is not read from {file}: others than you can write to it")
        return None
    checksum, code = content[:32], content[32:]
    if checksum != _checksum(key, code):
        _warn(f"{file} is damaged: it is compiled anew")
        return None
    return code


def store(key: str, code: bytes) -> None:
    """Keep code under a key, if it can be.

    Parameters
    ----------
    key : str
    code : bytes
    """
    where = _trusted_folder(folder())
    if not where:
        return
    try:
        write_whole(where / f"{key}.o", _checksum(key, code) + code)
        (where / f"{key}.o").chmod(0o600)
        files = sorted(where.glob("*.o"), key=lambda file: file.stat().st_mtime)
        for old in files[:-MOST_FILES]:
            old.unlink(missing_ok=True)
    except (OSError, AnnDcError) as error:
        _warn(f"compiled code is not kept in {where}: {error}")


def _checksum(key: str, code: bytes) -> bytes:
    return hashlib.sha256(key.encode() + code).digest()


def _trusted_folder(path: Path) -> Path | None:
    """The folder, made where there is none, if it belongs to the user alone."""
    if not hasattr(os, "getuid"):
        return None
    why = "it is no folder of yours that nobody else can write to"
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not path.is_symlink() and path.is_dir() and _is_private(path):
            return path
    except OSError as error:
        why = str(error)
    _warn(f"compiled code is kept in memory only, not in {path}: {why}")
    return None


def _is_private(path: Path) -> bool:
    """Whether it is the user's own, and writable by nobody else."""
    found = path.lstat()
    others = stat.S_IWGRP | stat.S_IWOTH
    return found.st_uid == os.getuid() and not found.st_mode & others


@cache
def _warn(message: str) -> None:
    """Once a process."""
    warnings.warn(f"{message} (set {FOLDER_VARIABLE} to another folder)", stacklevel=5)
