"""Compile cache on disk: complete files from a folder writable only by the user.

A file contains a checksum over its name and its content. If a file does not match, if other users
can write to the folder, or if the disk is full, code is compiled in memory. One warning gives the
reason.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import warnings
from functools import cache
from pathlib import Path

FOLDER_VARIABLE = "ANN_DC_CACHE"
"""Environment variable that names another folder."""
SUFFIX = ".code"
"""Suffix of the cache files, after 64 hexadecimal digits."""
MOST_FILES = 2048
"""Largest number of cached files; beyond it the least recently used files are removed."""
LARGEST = 64 * 2**20
"""Largest size of a file in bytes."""


def folder() -> Path | None:
    """Return the compile cache folder; None if the user has no home folder."""
    try:
        if named := os.environ.get(FOLDER_VARIABLE):
            return Path(named).expanduser()
        cache_folder = os.environ.get("XDG_CACHE_HOME")
        return Path(cache_folder or Path.home() / ".cache") / "ann_dc"
    except RuntimeError:  # nobody's home
        return None


def load(key: str) -> bytes | None:
    """Return the code stored under a key of 64 hexadecimal digits.

    The result is None if no trusted file exists.
    """
    where = _trusted()
    if where is None:
        return None
    file = where / f"{key}{SUFFIX}"
    try:
        content = _read(file)
    except FileNotFoundError:
        return None
    except OSError as error:
        _warn(f"compiled code is not read from {file}: {error}")
        return None
    if content is None:
        _warn(f"compiled code is not read from {file}: other users can write to it")
        return None
    checksum, code = content[:32], content[32:]
    if checksum != _checksum(key, code):
        _warn(f"{file} is damaged; it is compiled again")
        return None
    with contextlib.suppress(OSError):
        os.utime(file)
    return code


def store(key: str, code: bytes) -> None:
    """Store code under a key of 64 hexadecimal digits, if possible."""
    where = _trusted()
    if where is None:
        return
    part = where / f".{key}.{os.getpid()}.part"
    try:
        part.unlink(missing_ok=True)
        # nobody else ever holds it open for writing
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
            stream.write(_checksum(key, code) + code)
        os.replace(part, where / f"{key}{SUFFIX}")
        files = sorted(where.glob(f"{'[0-9a-f]' * 64}{SUFFIX}"), key=_last_used)
        for old in files[:-MOST_FILES]:
            old.unlink(missing_ok=True)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        _warn(f"compiled code is not stored in {where}: {error}")


def _last_used(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except FileNotFoundError:  # another process has just removed it
        return 0.0


def _read(file: Path) -> bytes | None:
    """Return the content of a file only the user can write, checked after opening."""
    with os.fdopen(os.open(file, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0)), "rb") as stream:
        if not _belongs_to_user(os.fstat(stream.fileno())):
            return None
        return stream.read(LARGEST)


def _checksum(key: str, code: bytes) -> bytes:
    return hashlib.sha256(key.encode() + code).digest()


def _trusted() -> Path | None:
    """Return the folder, created if necessary, if it belongs to the user alone."""
    where = folder()
    if where is None or not hasattr(os, "getuid"):
        return None
    why = "it is not a folder to which only the current user can write"
    try:
        where.mkdir(mode=0o700, parents=True, exist_ok=True)
        if where.is_dir() and _is_private(where):
            return where
    except OSError as error:
        why = str(error)
    _warn(
        f"compiled code is stored in memory only: {where}: {why} (set {FOLDER_VARIABLE} to another)"
    )
    return None


def _is_private(path: Path) -> bool:
    """Return True if a path is not a link and only its owner, the user, can write it."""
    return _belongs_to_user(path.lstat())


def _belongs_to_user(found: os.stat_result) -> bool:
    others = stat.S_IWGRP | stat.S_IWOTH
    is_link = stat.S_ISLNK(found.st_mode)
    return hasattr(os, "getuid") and found.st_uid == os.getuid() and not (
        is_link or found.st_mode & others
    )  # fmt: skip


@cache
def _warn(message: str) -> None:
    warnings.warn(message, stacklevel=5)
