"""Raw files of ngspice: a table of voltages and currents for every analysis.

A text header names the variables and counts the points; the numbers follow point by point after
``Binary:`` or ``Values:``. The reader validates everything: a run may have been cut off anywhere,
and an aborted analysis leaves ``No. Points: 0`` before its data.
"""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ann_dc.errors import (
    EndedEarlyError,
    FileFormatError,
    RawFileError,
    SpiceError,
    UnknownNameError,
)
from ann_dc.files import read_whole

MAX_BYTES = 2**30
"""Largest raw file in bytes, for a run and for reading."""
REMEDY = "save fewer nodes (`.save`), or with a longer step or end"

SPACE = re.compile(rb"\s*")
NEXT_PLOT = b"\nTitle:"


@dataclass(frozen=True, kw_only=True, eq=False)
class Raw:
    """Results of one analysis of a circuit.

    Attributes
    ----------
    title : str
        First line of the deck; in lower case from some versions.
    plot : str
        Name of the analysis in ngspice (``Transient Analysis``).
    names : tuple of str
        Variables in lower case: ``time``, ``frequency``, ``v(node)``, ``i(v1)``.
    values : (T, n) array
        Seconds or hertz, volts and amperes; read-only, complex for ``.ac``.
    """

    title: str
    plot: str
    names: tuple[str, ...]
    values: np.ndarray

    def __post_init__(self) -> None:
        values = np.asarray(self.values).view()
        values.setflags(write=False)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "names", tuple(name.lower() for name in self.names))

    @functools.cached_property
    def _column(self) -> dict[str, int]:
        return {name: i for i, name in reversed([*enumerate(self.names)])}

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a variable (T,), case-insensitive; a bare node name is its voltage."""
        key = str(name).lower()
        column = self._column.get(key, self._column.get(f"v({key})"))
        if column is None:
            raise UnknownNameError.of("variable", name, self.names)
        return self.values[:, column]

    @property
    def time(self) -> np.ndarray:
        """Times (T,) of a transient in seconds."""
        return self["time"]


def read_raw(source: str | os.PathLike[str] | bytes) -> list[Raw]:
    """Read every plot of a raw file or its content, in the order of the analyses.

    The file is binary or text, real or complex. Raises `RawFileError` if it is missing, empty, cut
    off, larger than `MAX_BYTES`, or does not match its header, and `EndedEarlyError` if an analysis
    was aborted.
    """
    where = "the raw data" if isinstance(source, bytes) else f"raw file {os.fspath(source)!r}"
    try:
        return [*_plots(source if isinstance(source, bytes) else _content(source))]
    except SpiceError as error:
        raise type(error)(f"{where}: {error}") from None


def _content(path: str | os.PathLike[str]) -> bytes:
    try:
        return read_whole(path, MAX_BYTES, REMEDY)
    except FileFormatError as error:
        raise RawFileError(str(error)) from error


def _plots(content: bytes) -> Iterator[Raw]:
    start = _skip_space(content, 0)
    if start == len(content):
        raise RawFileError("it is empty; ngspice stopped before its first analysis")
    while start < len(content):
        header, data = _header(content, start)
        if header.points == 0:
            raise _given_up(header, content, data)
        values, end = (_numbers if header.binary else _text)(header, content, data)
        if header.complex and header.names[0] == "frequency":
            values[:, 0].imag = 0.0  # ngspice leaves there what the memory happened to hold
        yield Raw(title=header.title, plot=header.plot, names=header.names, values=values)
        start = _skip_space(content, end)


def _skip_space(content: bytes, start: int) -> int:
    found = SPACE.match(content, start)
    return found.end() if found else start


@dataclass(frozen=True, kw_only=True)
class _Header:
    title: str
    plot: str
    names: tuple[str, ...]
    points: int
    complex: bool
    binary: bool

    @property
    def numbers(self) -> int:
        return self.points * len(self.names)

    @property
    def row(self) -> int:
        """Number of bytes of a point."""
        return len(self.names) * (16 if self.complex else 8)

    def mismatch(self, needed: int, there: int, unit: str) -> RawFileError:
        return RawFileError(
            f"plot {self.plot!r} is cut off or damaged: {self.points} points of "
            f"{len(self.names)} variables are {needed} {unit}, and {there} follow; simulate "
            "again"
        )


def _header(content: bytes, start: int) -> tuple[_Header, int]:
    """Return a plot's header and the position of its data."""
    if not content.startswith(b"Title:", start):
        raise RawFileError(
            f"a plot begins with {content[start : start + 20]!r} instead of 'Title:'; the file "
            "is not a raw file, or is damaged"
        )
    fields: dict[str, str] = {}
    names: list[str] = []
    for line, end in _lines(content, start):
        if line in ("Binary:", "Values:"):
            return _checked(fields, names, binary=line == "Binary:"), end
        if "Variables" in fields and line[:1].isspace():
            names.append(_variable(line))
            continue
        key, _, value = line.partition(":")
        fields[key] = value.strip()
    raise RawFileError("a header has neither 'Binary:' nor 'Values:'; the run was cut off")


def _lines(content: bytes, start: int) -> Iterator[tuple[str, int]]:
    """Yield the text lines from a position on, each with the position after it."""
    while (end := content.find(b"\n", start)) >= 0:
        yield content[start:end].decode("utf-8", "replace").rstrip("\r"), end + 1
        start = end + 1


def _variable(line: str) -> str:
    """Return a variable's name from its number, name, kind and attributes."""
    words = line.split()
    if len(words) < 2:
        raise RawFileError(f"a variable is declared as {line[:60]!r}, without a name")
    if any(word.startswith("dims=") for word in words[2:]):
        raise RawFileError(
            f"variable {words[1][:60]!r} is shorter than its plot; write variables of equal length"
        )
    return words[1].lower()


def _checked(fields: dict[str, str], names: list[str], binary: bool) -> _Header:
    flags = fields.get("Flags", "").lower().split()  # (un)padded matters to unequal lengths only
    if not {"real", "complex"} & {*flags}:
        raise RawFileError(
            f"'Flags' is {fields.get('Flags', '')[:60]!r}; expected 'real' or 'complex'"
        )
    declared = _count(fields, "No. Variables")
    if not declared or declared != len(names):
        raise RawFileError(f"expected {declared} variables, got {len(names)} names")
    return _Header(
        title=fields["Title"],
        plot=fields.get("Plotname", ""),
        names=tuple(names),
        points=_count(fields, "No. Points"),
        complex="complex" in flags,
        binary=binary,
    )


def _count(fields: dict[str, str], key: str) -> int:
    text = fields.get(key, "")
    if not (text.isascii() and text.isdigit() and len(text) <= 18):
        raise RawFileError(f"{key!r} is {text[:60]!r}; expected a count")
    return int(text)


def _given_up(header: _Header, content: bytes, start: int) -> SpiceError:
    """Return the error for a plot without points: ngspice writes the count last."""
    rows = (len(content) - start) // header.row
    if not rows or content.startswith(NEXT_PLOT[1:], start):
        return RawFileError(f"plot {header.plot!r} has no points")
    if not header.binary or header.row != 8 * len(header.names) or header.names[0] != "time":
        return EndedEarlyError(f"plot {header.plot!r} was aborted")
    last = np.frombuffer(content, float, 1, start + (rows - 1) * header.row)[0]
    return EndedEarlyError(f"plot {header.plot!r} was aborted at time {last:g}")


def _numbers(header: _Header, content: bytes, start: int) -> tuple[np.ndarray, int]:
    """Return binary values (T, n) and the position after them."""
    needed, there = header.points * header.row, len(content) - start
    if needed > there:
        raise header.mismatch(needed, there, "bytes")
    kind = complex if header.complex else float
    values = np.frombuffer(content, kind, header.numbers, start).copy()
    return values.reshape(header.points, -1), start + needed


def _text(header: _Header, content: bytes, start: int) -> tuple[np.ndarray, int]:
    """Return text values (T, n) and the position after them; each point follows its number."""
    end = content.find(NEXT_PLOT, start)
    words = content[start : end if end >= 0 else len(content)].split()
    needed = header.numbers + header.points
    if len(words) != needed:
        raise header.mismatch(needed, len(words), "words")
    del words[:: len(header.names) + 1]
    number = _complex if header.complex else float
    try:
        values = np.array([number(word) for word in words])
    except (TypeError, ValueError) as error:
        raise RawFileError(
            f"plot {header.plot!r} contains an entry that is not a number: {str(error)[:80]}"
        ) from None
    return values.reshape(header.points, -1), end if end >= 0 else len(content)


def _complex(word: bytes) -> complex:
    return complex(*map(float, word.split(b",")))
