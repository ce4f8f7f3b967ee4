"""The formats: what each is for, which settings it has, what it carries and what it loses."""

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
"""Contents, by the name of the file in the format's folder."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """One way to take a network away.

    Attributes
    ----------
    title : str
        What it is, and for whom.
    write : callable
        ``(network, vector, **settings)`` to files.
    check : callable
        Files to a sentence on what they are worth.
    carries, loses : str
        For the table of formats.
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
        """What a word on the command line stands for.

        Parameters
        ----------
        name : str
            Of a setting that the format has.
        text : str

        Raises
        ------
        ExportError
            If it is no such value.
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
        """The files of a network.

        Parameters
        ----------
        network : Network
        vector : ReferenceVector
            Of the network.
        settings : mapping of str to value

        Raises
        ------
        UnknownNameError
            If the format has no such setting.
        ExportError
            If the format cannot carry the network.
        ExportPackageMissing
            If a package for it is not installed.
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
    """The plain types of a hint, the narrowest first; of named values those that they have."""
    parts = typing.get_args(kind) or (kind,)
    types = {part if isinstance(part, type) else type(part) for part in parts}
    return [plain for plain in _READERS if plain in types]


def _words(kind: Any) -> str:
    names = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}
    return " or ".join(names[plain] for plain in _plain_types(kind))


def unknown_setting(name: str, available: Iterable[str]) -> UnknownNameError:
    """The error of a setting that none of the formats has, with the nearest that one has.

    Parameters
    ----------
    name : str
    available : iterable of str
    """
    names = list(available)
    near = difflib.get_close_matches(name, names, 1)
    there = f"choose from: {', '.join(names)}" if names else "these formats have none"
    what = f"did you mean {near[0]!r}?" if near else there
    return UnknownNameError(f"setting {name!r} does not exist; {what}")
