"""Atomic output of strict JSON, and checks of output paths."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ann_dc.errors import OutputError
from ann_dc.files import make_folder, write_whole

STDOUT = Path("-")
"""Name of the standard output in place of a JSON file."""


def write_json(path: Path, content: Any) -> None:
    """Write strict JSON (no NaN, no Infinity), atomically, or to `STDOUT`.

    Raises `OutputError` if the file cannot be written; an existing file is then unchanged.
    """
    text = json.dumps(_strict(content), indent=2, allow_nan=False) + "\n"
    if path == STDOUT:
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    write_whole(path, text.encode("utf-8"))


def write_results(content: Any, *paths: Path | None) -> list[Path]:
    """Write the same JSON data to every given path, and return these paths."""
    written = [path for path in paths if path is not None]
    for path in written:
        write_json(path, content)
    return written


def picked(record: object, *names: str) -> dict[str, Any]:
    """Return attributes of a record by name, in the given order."""
    return {name: getattr(record, name) for name in names}


def _strict(value: Any) -> Any:
    """Return plain JSON data: lists for arrays, text for paths, null for non-finite numbers."""
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(item) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # an array or a number of NumPy
        return _strict(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def make_room(
    json_file: Path | None,
    *files: Path | None,
    figures: Path | None = None,
    trajectory: Path | None = None,
) -> None:
    """Create the folders of output files before a long run.

    `figures` is a folder and `trajectory` a file of curves. Only the JSON file may be `STDOUT`.
    Raises `OutputError` if a file has the name of a folder, has an unknown extension, or cannot be
    written.
    """
    if trajectory is not None:
        from ann_dc.backends.curves import check_curves_file

        check_curves_file(trajectory)
    for file in (*files, trajectory, None if json_file == STDOUT else json_file):
        if file is not None:
            _make_room(file)
    if figures is not None:
        _check_access(make_folder(figures), figures)


def _make_room(file: Path) -> None:
    if file == STDOUT:
        raise OutputError("-: only --json can write to stdout; use a file name")
    if file.is_dir():
        raise OutputError(f"{file}: is a folder; use a file name")
    folder = make_folder(file.parent)
    is_device = file.exists() and not file.is_file()
    _check_access(file if is_device else folder, file)


def _check_access(written: Path, given: Path) -> None:
    if not os.access(written, os.W_OK):
        raise OutputError(f"{given}: cannot be written (permission denied); use another path")
