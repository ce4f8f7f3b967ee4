"""Export formats: purpose, settings, preserved data and omitted data of each."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ann_dc.errors import (
    AnnDcError,
    ExportError,
    ExportPackageMissing,
    FileFormatError,
)
from ann_dc.export.reference.contents import check_contents, not_run

Files = Mapping[str, bytes]
"""File contents, by file name in the format's folder."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """Export format, with its purpose and its preserved and omitted data.

    Attributes
    ----------
    write : callable
        Function ``(network, vector, **settings)`` that returns files.
    contents : str
        Names of the files, as in `check_contents`.
    run : callable
        Function that runs files, compares them with their test vector and returns the result as a
        sentence. By default nothing is run.
    executes : bool
        True if reading a file may execute code in it. Such files are run when they are written, and
        are not run if their origin is unknown.
    """

    title: str
    write: Callable[..., Files]
    contents: str
    run: Callable[[Files], str] = not_run
    executes: bool = False
    carries: str
    loses: str

    @property
    def settings(self) -> dict[str, inspect.Parameter]:
        """Keyword arguments of ``write``, by name."""
        given = inspect.signature(self.write).parameters.values()
        return {p.name: p for p in given if p.kind is p.KEYWORD_ONLY}

    def setting_of(self, name: str, text: str) -> Any:
        """Convert a setting's command-line text to its value, or raise `ExportError`."""
        kind = typing.get_type_hints(inspect.unwrap(self.write))[name]
        named = typing.get_args(kind) if typing.get_origin(kind) is typing.Literal else ()
        for plain in _plain_types(kind):
            try:
                value = _READERS[plain](text)
            except ValueError:
                continue
            if not named or value in named:
                return value
        words = (_WORDS[plain] for plain in _plain_types(kind))
        expected = " or ".join(map(str, named or words))
        raise ExportError(f"{name}: expected {expected}, got {text!r}")

    def check(self, files: Files) -> str:
        """Check the names of files and the list of their hashes, run them, and return the result.

        Raises `FileFormatError` if a file is missing, changed, foreign or invalid, or does not take
        the steps of its test vector, and `ExportPackageMissing` if a package is not installed.
        """
        check_contents(files, self.contents)
        try:
            return self.run(files)
        except (FileFormatError, ExportPackageMissing):
            raise
        except Exception as error:  # of any package or function that an invalid file reaches
            raise FileFormatError(
                f"cannot be run: {reason_of(error):.300}; export it again"
            ) from error

    def inspect(self, files: Files) -> str:
        """Check files of unknown origin: as `check`, without executing code in them."""
        if self.executes:
            check_contents(files, self.contents)
            return "hashes alone; not run: reading a file may execute code in it"
        return self.check(files)


def reason_of(error: Exception) -> str:
    """Return the message of an error, with its type if ann_dc does not raise it itself."""
    return str(error) if isinstance(error, AnnDcError) else f"{type(error).__name__}: {error}"


def _truth(text: str) -> bool:
    if text not in ("true", "false"):
        raise ValueError(text)
    return text == "true"


_READERS: dict[type, Callable[[str], Any]] = {bool: _truth, int: int, float: float, str: str}
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}


def _plain_types(kind: Any) -> list[type]:
    """Return the plain types of a type hint, narrowest first; literals give theirs."""
    parts = typing.get_args(kind) or (kind,)
    types = {part if isinstance(part, type) else type(part) for part in parts}
    return [plain for plain in _READERS if plain in types]
