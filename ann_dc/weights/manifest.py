"""The JSON half of a saved network: names and wiring, read with distrust.

Numbers are in arrays beside it, whose names follow from the names here; `Table` takes entries one
by one with the type that the reader asks for, and says where in the manifest one is wrong.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from functools import cache
from typing import Any

from ann_dc.errors import FileFormatError, UnknownNameError
from ann_dc.network.cell import Connection

FORMAT = "ann_dc network"
SCHEMA = 2
"""The first files had schema 1, without hashes and without words about their arrays."""
MOST_TABLES = 200_000
"""Tables and lists that a text may have: each takes some 70 bytes, and two of the text."""
LONGEST = 50_000_000
"""Letters of a text."""


def read_json(text: str) -> Any:
    """What a JSON text says; a table that has a key twice says nothing.

    Parameters
    ----------
    text : str

    Raises
    ------
    FileFormatError
        If it is not JSON, or takes far more memory than the numbers that it may be about.
    """
    if len(text) > LONGEST:
        raise FileFormatError(f"not JSON of ours: more than {LONGEST} letters")
    if tables_in(text) > MOST_TABLES:
        raise FileFormatError(f"not JSON of ours: more than {MOST_TABLES} tables and lists")
    try:
        return json.loads(text, parse_constant=_no_number, object_pairs_hook=_each_once)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"not JSON: {error}") from error


def tables_in(text: str) -> int:
    """How many tables and lists a JSON text has at most; a bracket in a word counts too.

    Parameters
    ----------
    text : str
    """
    return text.count("{") + text.count("[")


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise ValueError(f"key {twice!r:.80} occurs twice in a table")
    return table


def read_manifest(
    text: str, form: str = FORMAT, schema: int = SCHEMA, place: str = "manifest"
) -> Table:
    """The table that a manifest is, after its format and schema have been checked.

    Parameters
    ----------
    text : str
    form : str
        What it has to say that it is.
    schema : int
        The newest version of it that can be read.
    place : str
        What messages call it: the name of its file.

    Returns
    -------
    Table

    Raises
    ------
    FileFormatError
        If the text is not JSON, or no manifest of this format and schema.
    """
    try:
        given = read_json(text)
    except FileFormatError as error:
        raise FileFormatError(f"{place}: {error}") from error
    if not isinstance(given, dict) or given.get("format") != form:
        kind = form.removeprefix("ann_dc ")
        raise FileFormatError(f"{place}: does not say {form!r}; is this a saved {kind}?")
    version = given.get("schema")
    if type(version) is not int or not 1 <= version <= schema:
        known = "1" if schema == 1 else f"1 to {schema}"
        raise FileFormatError(
            f"{place}.schema: {version!r:.60}, but this ann_dc reads {known}; load the file with "
            "the version that saved it"
        )
    return Table(place, given)


def weight_names(connections: Iterable[Connection]) -> list[str]:
    """Entries of the weights; a second wire between the same two nodes is numbered.

    Parameters
    ----------
    connections : iterable of Connection

    Returns
    -------
    list of str
        One a connection, each once.
    """
    seen: Counter[str] = Counter()
    names = []
    for connection in connections:
        seen[connection.name] += 1
        count = seen[connection.name]
        names.append(f"weight/{connection.name}" + (f"#{count}" if count > 1 else ""))
    return names


def _no_number(text: str):
    raise ValueError(f"{text} is no JSON number")


class Table:
    """One JSON table of the manifest, with its place for messages.

    Parameters
    ----------
    place : str
        Where the table stands in the manifest; messages begin with it.
    given : dict
        What JSON says is there.

    Attributes
    ----------
    place : str
    given : dict

    Raises
    ------
    FileFormatError
        If it is no table.
    """

    def __init__(self, place: str, given) -> None:
        if not isinstance(given, dict):
            raise FileFormatError(f"{place}: expected a table, got {given!r:.60}")
        self.place, self.given = place, given

    def only(self, keys: str) -> None:
        """Refuse keys that are not among ``keys``, separated by blanks.

        Raises
        ------
        FileFormatError
            Naming the unknown keys.
        """
        unknown = self.given.keys() - _words(keys)
        if unknown:
            raise FileFormatError(f"{self.place}: unknown key {', '.join(sorted(unknown)):.300}")

    def has(self, key: str) -> bool:
        """Whether there is an entry; for those that files of earlier versions lack."""
        return key in self.given

    def get(self, key: str, kind: type):
        """Entry of a type.

        Raises
        ------
        FileFormatError
            If it is missing or of another type.
        """
        if key not in self.given:
            raise FileFormatError(f"{self.place}.{key}: missing")
        value = self.given[key]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise FileFormatError(
                f"{self.place}.{key}: expected {kind.__name__}, got {value!r:.60}"
            )
        return value

    def whole(self, key: str, low: int, high: int) -> int:
        """Whole number from ``low`` to ``high``, both included.

        Raises
        ------
        FileFormatError
            If it is missing, not whole or out of range.
        """
        value = self.get(key, int)
        if not low <= value <= high:
            raise FileFormatError(f"{self.place}.{key}: {value} is not in {low} .. {high}")
        return value

    def choice(self, key: str, available: Mapping):
        """One of several names, as what it stands for.

        Raises
        ------
        UnknownNameError
            If the name is not available; the message lists those that are.
        FileFormatError
            If there is no name.
        """
        name = self.get(key, str)
        if name not in available:
            raise UnknownNameError.of(f"{self.place}.{key}:", name, available)
        return available[name]

    def names(self, key: str) -> tuple[str, ...]:
        """List of text, each once.

        Raises
        ------
        FileFormatError
            If it is missing, holds anything besides text, or a name twice.
        """
        values = self.get(key, list)
        if not all(isinstance(value, str) for value in values):
            raise FileFormatError(f"{self.place}.{key}: expected names only")
        if len(set(values)) < len(values):
            raise FileFormatError(f"{self.place}.{key}: a name occurs twice")
        return tuple(values)

    def rows(self, key: str) -> Iterator[Table]:
        """Tables of a list, one after the other."""
        for i, value in enumerate(self.get(key, list)):
            yield Table(f"{self.place}.{key}[{i}]", value)

    def record(self, kind: type, *besides: str):
        """All keys as a record of names, with a stage where it has one."""
        keys, types = _fields(kind)
        self.only(" ".join([keys, *besides]))
        return kind(**{key: self.get(key, type_) for key, type_ in types})

    def records(self, key: str, kind: type) -> tuple:
        """List of records of the given kind."""
        return tuple(row.record(kind) for row in self.rows(key))


@cache
def _words(keys: str) -> frozenset[str]:
    return frozenset(keys.split())


@cache
def _fields(kind: type) -> tuple[str, tuple[tuple[str, type], ...]]:
    """Names of a record's fields, and the type of each in a manifest."""
    types = tuple((f.name, int if f.name == "stage" else str) for f in fields(kind))
    return " ".join(name for name, _ in types), types
