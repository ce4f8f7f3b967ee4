"""Atomic writing, size-limited reading and locking of files and folders.

A new file is completed next to the old file and then replaces it. The old content remains until the
last byte is written. Failures raise an error that names the path as given.

A lock on a folder allows one writer at a time. The operating system releases the lock when the
process ends in any way. A killed process leaves nothing that would have to be removed.
"""

from __future__ import annotations

import contextlib
import os
import platform
import re
import secrets
import shutil
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from ann_dc.errors import AnnDcError, FileFormatError, OutputError

LARGEST_TABLE = 1_000_000
"""Largest size in bytes of a text file with a description."""
PATIENCE = 0.05
"""Seconds in which a lock file that its owner has just removed is created again."""
LOCKED = 1
"""Number of bytes at the start of a lock file that other Windows processes cannot read."""

# The TOML reader needs quadratic time for a.a.a.a..., so a long one is refused before.
_LONG_KEY = re.compile(
    r"""(?<![\w\\-])(?:(?:[\w-]++|"(?:\\.|[^"\\\n])*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){16}"""
)


def write_whole(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file atomically; an existing file is replaced by the complete new one.

    The folder must exist. A link remains a link, and a device such as ``/dev/stdout`` is written
    directly. Raises `OutputError` if the file cannot be written; the previous content remains.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_whole(f"{folder}/a.txt", b"first")
    ...     write_whole(f"{folder}/a.txt", b"second")
    ...     read_whole(f"{folder}/a.txt", limit=100, remedy="give a shorter one")
    b'second'
    """
    with writing_whole(path) as stream:
        stream.write(content)


@contextlib.contextmanager
def writing_whole(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Write a file in parts, atomically; yields a binary stream.

    The folder must exist. The written content replaces the file at the end of the ``with`` block,
    unless the block ends with an error. Concurrent writers do not mix; the last to end remains.
    Raises `OutputError` if the file cannot be written; the previous content remains.
    """
    with as_output_error(path):
        file = Path(path)
        is_plain = file.is_file() or not file.exists()
        file = file.resolve() if is_plain else file
        part = _part_of(file) if is_plain else file
        stream = part.open("xb" if is_plain else "wb")
    try:
        with as_output_error(path, (OSError,)), stream:
            yield stream
            if is_plain:
                stream.flush()
                os.fsync(stream.fileno())
                os.replace(part, file)
                _keep(file.parent)
    finally:
        if is_plain:
            part.unlink(missing_ok=True)


def _part_of(place: Path) -> Path:
    """Return a unique temporary path next to a future file or folder."""
    return place.with_name(f".{place.name}.{secrets.token_hex(4)}.part")


def make_folder(folder: str | os.PathLike[str]) -> Path:
    """Return the folder, created with its parents if necessary.

    Raises `OutputError` if it cannot be created, for instance because a file has its name.
    """
    with as_output_error(folder):
        Path(folder).mkdir(parents=True, exist_ok=True)
    return Path(folder)


def write_folder(
    folder: str | os.PathLike[str], files: Mapping[str, bytes], *, replace: bool = False
) -> None:
    """Write a folder with all of its files, or nothing.

    `files` maps file names to contents. The parent of the folder must exist. The new folder is
    completed under another name next to its place and then renamed. An existing folder is replaced
    as a whole if `replace` is true. Raises `OutputError` if the name exists otherwise, or if the
    folder cannot be written; existing content is then left unchanged.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     write_folder(f"{place}/new", {"a.txt": b"one", "b.txt": b"two"})
    ...     sorted(file.name for file in Path(place, "new").iterdir())
    ['a.txt', 'b.txt']
    """
    check_new(folder, replace=replace)
    with as_output_error(folder):
        place = Path(folder).absolute()
        place = place.resolve() if replace else place
        part = _part_of(place)
        try:
            part.mkdir()
            for name, content in files.items():
                with (part / name).open("wb") as stream:
                    stream.write(content)
                    stream.flush()
                    os.fsync(stream.fileno())
            _keep(part)
            _put(part, place)
        finally:
            shutil.rmtree(part, ignore_errors=True)
        _keep(place.parent)


def _put(part: Path, place: Path) -> None:
    """Rename a complete folder to its place; a folder there is removed after the swap."""
    if not place.is_dir():
        part.rename(place)
        return
    old = _part_of(place)
    place.rename(old)
    try:
        part.rename(place)
    except BaseException:
        old.rename(place)
        raise
    shutil.rmtree(old, ignore_errors=True)


def check_new(
    folder: str | os.PathLike[str],
    *,
    replace: bool = False,
    remedy: str = "use the name of a new folder, or move this one",
) -> None:
    """Raise `OutputError`, with a remedy, if a folder cannot be written under this name.

    The name may exist already, or the folder cannot be created there. With `replace` an existing
    folder is accepted. `remedy` ends the message if the name exists.
    """
    with as_output_error(folder):
        place = Path(folder)
        parent = place.absolute().parent
        is_taken = place.exists() or place.is_symlink()
        is_taken = is_taken and not (replace and place.is_dir())
        has_room = parent.is_dir() and os.access(parent, os.W_OK)
    if is_taken:
        raise OutputError(f"{os.fspath(folder)!r} exists already; {remedy}")
    if not has_room:
        raise OutputError(
            f"{os.fspath(folder)!r} cannot be written ({str(parent)!r} is not a writable "
            "folder); use a path in an existing, writable folder"
        )


def _keep(folder: Path) -> None:
    """Flush the names in a folder to disk, if the system supports it."""
    with contextlib.suppress(OSError):  # not every system lets a folder be opened
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def read_whole(path: str | os.PathLike[str], limit: int, remedy: str) -> bytes:
    """Read a regular file of at most ``limit`` bytes.

    No more memory is used than the size of the file. Raises `FileFormatError`, whose message ends
    with `remedy`, if the file does not exist, cannot be read, is larger, or grows while it is read.
    """
    file = Path(path)
    try:
        if not file.is_file():
            reason = "is a folder" if file.is_dir() else "does not exist or is not a plain file"
            raise FileFormatError(f"{str(file)!r} {reason}; {remedy}")
        with file.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            content = stream.read(size) if size <= limit else b""
            grows = size <= limit and bool(stream.read(1))
    except OSError as error:
        raise FileFormatError(
            f"{str(file)!r} cannot be read ({error.strerror or error}); {remedy}"
        ) from error
    except MemoryError as error:
        raise FileFormatError(
            f"{str(file)!r} is larger than the available memory; {remedy}"
        ) from error
    if size > limit:
        raise FileFormatError(f"{str(file)!r} is larger than {limit} bytes; {remedy}")
    if grows:
        raise FileFormatError(f"{str(file)!r} has more bytes than its size states; {remedy}")
    return content


@contextlib.contextmanager
def as_output_error(
    path: str | os.PathLike[str], kinds: tuple[type[Exception], ...] = (OSError, ValueError)
) -> Iterator[None]:
    """Convert file-system errors to an `OutputError` that names the user's path.

    `kinds` are the converted exceptions; a path with a zero byte raises `ValueError`.
    """
    try:
        yield
    except AnnDcError:
        raise
    except kinds as error:
        is_file = isinstance(error, (FileExistsError, NotADirectoryError))
        reason = getattr(error, "strerror", None) or error
        raise OutputError(
            f"{os.fspath(path)!r} cannot be written "
            f"({'a file has the name of the folder' if is_file else reason}); use a path in an "
            "existing, writable folder"
        ) from error


def read_table(file: Path, kind: str, example: str) -> dict[str, Any]:
    """Read a TOML file as plain data.

    `kind` names its subject in messages, and `example` is a file to consult. Raises
    `FileFormatError` if the file does not exist or is not TOML in UTF-8 of at most 1 MB.
    """
    text = _read_text(file, kind)
    if _LONG_KEY.search(text):
        raise FileFormatError(f"{file}: a key has too many dots; see {example}")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise FileFormatError(f"{file}: the file nests too deeply; see {example}") from error
    except tomllib.TOMLDecodeError as error:
        raise FileFormatError(f"{file}: not valid TOML: {error}; see {example}") from error
    except ValueError as error:  # an impossible date, a whole number of 5000 digits
        raise FileFormatError(f"{file}: a value cannot be read: {error}") from error


def _read_text(file: Path, kind: str) -> str:
    remedy = f"use the path of a .toml {kind} file"
    try:
        return read_whole(file, LARGEST_TABLE, remedy).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{file}: not UTF-8 text: {error}; save it as UTF-8") from error


class Lock:
    """Lock on a folder, acquired in its construction.

    The lock file, in an existing folder, names the owner and remains after the release; the owner
    may remove the file. `on` describes the written object in the error message. Raises an error of
    type `error` that names process and host of another owner, and `OSError` if the file cannot be
    written.
    """

    def __init__(
        self, file: Path, *, on: str = "this folder", error: type[AnnDcError] = OutputError
    ) -> None:
        from filelock import FileLock, Timeout  # 10 ms, which readers of files need not pay

        self._lock = FileLock(file, thread_local=False, on_acquired=_sign)
        try:
            self._lock.acquire(PATIENCE, PATIENCE / 5)
        except Timeout as refused:
            raise error(
                f"{str(file.parent)!r}: {_holder(file) or 'another process'} is writing to "
                f"{on}; wait for its end, or use another folder"
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
