"""What stays on disk: whole files or nothing, and a sentence where that fails."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ann_dc.errors import OutputError


def write_json(path: Path, content: Any) -> None:
    """Write strict JSON (no NaN, no Infinity), the whole file or nothing.

    Raises
    ------
    OutputError
        If the file cannot be written; what was there before stays.
    """
    text = json.dumps(_strict(content), indent=2, allow_nan=False) + "\n"
    if path.exists() and not path.is_file():  # /dev/stdout
        with _told(path):
            path.write_text(text, encoding="utf-8")
        return
    part = path.with_name(path.name + ".part")
    try:
        with _told(path):
            part.write_text(text, encoding="utf-8")
            part.replace(path.resolve())
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def _strict(value: Any) -> Any:
    """Plain JSON data: numbers that JSON does not know become null."""
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(item) for item in value]
    if hasattr(value, "item"):  # a NumPy scalar
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def make_room(file: Path | None) -> None:
    """Before a long run: the file's folder exists, and the file is no folder."""
    if file is None:
        return
    if file.is_dir():
        raise OutputError(f"{file}: is a folder; give the name of a file")
    make_folder(file.parent)


def make_folder(folder: Path) -> Path:
    """The folder, made where there was none."""
    with _told(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """An OSError as a sentence about the path that the user gave."""
    try:
        yield
    except OSError as error:
        is_file = isinstance(error, (FileExistsError, NotADirectoryError))
        reason = "a file stands where a folder is needed" if is_file else error.strerror or error
        raise OutputError(f"{path}: cannot be written ({reason}); choose another place") from error
