"""Folder of one ngspice run: removed afterwards, retained if the run fails."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ann_dc.backends.spice.ngspice.raw import REMEDY
from ann_dc.errors import OutputError, SpiceError
from ann_dc.files import make_folder

DECK, RAW, LOG = "deck.cir", "out.raw", "ngspice.log"

LOG_LINES = 15
LOG_BYTES = 2**16
ACCOUNTING = re.compile(r"(Total|Maximum|Current|Shared|Text|Stack|Library|DRAM)\b.* = ")
"""Pattern of the accounting lines with which ngspice ends every run."""

FULL = 2**16
"""Free bytes below which a disk counts as full."""


@contextlib.contextmanager
def run_folder(keep: Path | None) -> Iterator[Path]:
    """Yield a new folder; if the run fails, it is retained and the error names its path."""
    with writing(keep or "the folder of temporary files"):
        home = make_folder(keep).absolute() if keep else None
        folder = Path(tempfile.mkdtemp(prefix="ann_dc-ngspice-", dir=home))
    kept = False
    try:
        yield folder
    except SpiceError as error:
        full = _is_full(folder)
        with contextlib.suppress(OSError):  # the deck gives it again, and it may be large
            (folder / RAW).unlink()
        if full:
            raise _full(folder) from error
        kept = True
        raise type(error)(f"{error}\n{_evidence(folder)}") from None
    finally:
        if not kept:
            shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def writing(where: object) -> Iterator[None]:
    """Raise an `OutputError` for any failure to write at the given place."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"the netlist cannot be written to {str(where)!r} ({error.strerror or error}); free "
            "space, or set `keep` or TMPDIR to a writable folder"
        ) from error


def _is_full(folder: Path) -> bool:
    try:
        return shutil.disk_usage(folder).free < FULL
    except OSError:  # the folder itself is gone
        return False


def _full(folder: Path) -> OutputError:
    return OutputError(
        f"ngspice could not write to {str(folder)!r} (the disk is full); free space, or "
        f"{REMEDY}, or set `keep` or TMPDIR to a folder on another disk"
    )


def _evidence(folder: Path) -> str:
    lines = [f"  | {line}" for line in _last_lines(folder / LOG)] or ["  | (nothing)"]
    return "\n".join(
        [f"The netlist is stored as {str(folder / DECK)!r}; ngspice printed last:", *lines]
    )


def _last_lines(log: Path) -> list[str]:
    """Return the end of a log as a terminal shows it."""
    try:
        with log.open("rb") as stream:
            stream.seek(max(0, stream.seek(0, os.SEEK_END) - LOG_BYTES))
            text = stream.read(LOG_BYTES).decode("utf-8", "replace")
    except OSError:
        return []
    lines = (line.rstrip().rsplit("\r", 1)[-1] for line in text.split("\n"))
    kept = (line for line in lines if line and "#branch" not in line)
    shown = [line[:200] for line in kept if not ACCOUNTING.match(line)]
    return shown[-LOG_LINES:]
