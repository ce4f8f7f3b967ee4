"""Atomic output of strict JSON, and checks of output paths."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ann_dc.errors import OutputError
from ann_dc.files import make_folder, write_whole


def write_json(path: Path, content: Any) -> None:
    """Write strict JSON (no NaN, no Infinity) atomically.

    Raises `OutputError` if the file cannot be written; an existing file is then unchanged.
    """
    text = json.dumps(_strict(content), indent=2, allow_nan=False) + "\n"
    write_whole(path, text.encode("utf-8"))


def picked(record: object, *names: str) -> dict[str, Any]:
    """Return attributes of a record by name, in the given order."""
    return {name: getattr(record, name) for name in names}


def _strict(value: Any) -> Any:
    """Return plain JSON data: lists for arrays, and null for non-finite numbers."""
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(item) for item in value]
    if hasattr(value, "tolist"):  # an array or a number of NumPy
        return _strict(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def make_room(file: Path | None) -> None:
    """Create the folder of an output file before a long run.

    Raises `OutputError` if the path is a folder, or its folder cannot be created or written.
    """
    if file is None:
        return
    if file.is_dir():
        raise OutputError(f"{file}: is a folder; give the name of a file")
    folder = make_folder(file.parent)
    is_device = file.exists() and not file.is_file()
    if not os.access(file if is_device else folder, os.W_OK):
        raise OutputError(f"{file}: cannot be written (permission denied); give another place")
