"""Export formats: purpose, settings, preserved data and omitted data of each."""

from __future__ import annotations

import difflib
import inspect
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ann_dc.errors import ExportError, UnknownNameError
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network

Files = Mapping[str, bytes]
"""File contents, by file name in the format's folder."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """Export format.

    Attributes
    ----------
    title : str
        Purpose and users of the format.
    write : callable
        Function ``(network, vector, **settings)`` that returns files.
    check : callable
        Function that checks files and returns the result as a sentence.
    carries, loses : str
        Preserved and omitted data, for the table of formats.
    """

    title: str
    write: Callable[..., Files]
    check: Callable[[Files], str]
    carries: str
    loses: str

    @property
    def settings(self) -> dict[str, inspect.Parameter]:
        """Keyword arguments of ``write``, by name."""
        given = inspect.signature(self.write).parameters.values()
        return {p.name: p for p in given if p.kind is p.KEYWORD_ONLY}

    def setting_of(self, name: str, text: str) -> Any:
        """Convert a setting's command-line text to its value.

        Raises `ExportError` if the text is not a valid value.
        """
        kind = typing.get_type_hints(inspect.unwrap(self.write))[name]
        named = typing.get_args(kind) if typing.get_origin(kind) is typing.Literal else ()
        for plain in _plain_types(kind):
            try:
                value = _READERS[plain](text)
            except ValueError:
                continue
            if not named or value in named:
                return value
        expected = " or ".join(map(str, named)) or _words(kind)
        raise ExportError(f"{name}: expected {expected}, got {text!r}")

    def files(
        self, network: Network, vector: ReferenceVector, settings: Mapping[str, Any]
    ) -> Files:
        """Return the files of a network with its test vector.

        Raises `UnknownNameError` if the format does not have a setting, `ExportError` if it cannot
        represent the network, and `ExportPackageMissing` if a required package is not installed.
        """
        for name in settings:
            if name not in self.settings:
                raise unknown_setting(name, self.settings)
        return self.write(network, vector, **settings)


def _truth(text: str) -> bool:
    if text not in ("true", "false"):
        raise ValueError(text)
    return text == "true"


_READERS: dict[type, Callable[[str], Any]] = {bool: _truth, int: int, float: float, str: str}


def _plain_types(kind: Any) -> list[type]:
    """Return the plain types of a type hint, narrowest first; literals give theirs."""
    parts = typing.get_args(kind) or (kind,)
    types = {part if isinstance(part, type) else type(part) for part in parts}
    return [plain for plain in _READERS if plain in types]


def _words(kind: Any) -> str:
    names = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}
    return " or ".join(names[plain] for plain in _plain_types(kind))


def unknown_setting(name: str, available: Iterable[str]) -> UnknownNameError:
    """Return the error for an unknown setting, with the closest available name."""
    names = list(available)
    near = difflib.get_close_matches(name, names, 1)
    there = f"choose from: {', '.join(names)}" if names else "these formats have none"
    what = f"did you mean {near[0]!r}?" if near else there
    return UnknownNameError(f"setting {name!r} does not exist; {what}")
