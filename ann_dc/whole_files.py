"""Files are written whole or not at all, and read whole or refused.

A new file is completed beside the old one and then takes its place, so what was there before
stays until the last byte is written. What goes wrong is an error that names the path as given.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from ann_dc.errors import FileFormatError, OutputError


def write_whole(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file; one that exists is replaced once the new one is complete.

    A link stays a link, and a device such as ``/dev/stdout`` is written to directly.

    Raises
    ------
    OutputError
        If the file cannot be written there; what was there before stays.
    """
    with _as_output_error(path):
        file = Path(path)
        if file.exists() and not file.is_file():
            file.write_bytes(content)
            return
        file = file.resolve()
        part = file.with_name(f".{file.name}.{os.getpid()}.part")
        try:
            with part.open("wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(part, file)
        finally:
            part.unlink(missing_ok=True)


def make_folder(folder: str | os.PathLike[str]) -> Path:
    """Return the folder, made where there was none.

    Raises
    ------
    OutputError
        If it cannot be made, for instance because a file stands there.
    """
    with _as_output_error(folder):
        Path(folder).mkdir(parents=True, exist_ok=True)
    return Path(folder)


def read_whole(path: str | os.PathLike[str], limit: int, remedy: str) -> bytes:
    """Read a plain file of at most ``limit`` bytes; ``remedy`` says what to give instead.

    Raises
    ------
    FileFormatError
        If there is no such file, or it cannot be read, or it is larger.
    """
    file = Path(path)
    if not file.is_file():
        reason = "is a folder" if file.is_dir() else "does not exist or is not a plain file"
        raise FileFormatError(f"{str(file)!r} {reason}; {remedy}")
    try:
        with file.open("rb") as stream:
            content = stream.read(limit + 1)
    except OSError as error:
        raise FileFormatError(
            f"{str(file)!r} cannot be read ({error.strerror or error}); {remedy}"
        ) from error
    if len(content) > limit:
        raise FileFormatError(f"{str(file)!r} is larger than {limit} bytes; {remedy}")
    return content


@contextlib.contextmanager
def _as_output_error(path: str | os.PathLike[str]) -> Iterator[None]:
    """An error of the file system as a sentence about the path that the user gave."""
    try:
        yield
    except (OSError, ValueError) as error:  # a path with a zero byte is a ValueError
        is_file = isinstance(error, (FileExistsError, NotADirectoryError))
        reason = getattr(error, "strerror", None) or error
        raise OutputError(
            f"{os.fspath(path)!r} cannot be written "
            f"({'a file stands where a folder is needed' if is_file else reason}); "
            "give a path in a folder that exists and may be written to"
        ) from error
