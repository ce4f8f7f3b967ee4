"""JSON manifest of a saved network (names and wiring) with a strict reader.

Numbers are stored in separate arrays. The array names follow from the names in the manifest.
`Table` takes entries one by one with the type that the reader requests, and reports the position of
an invalid entry.
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
SCHEMA = 3
"""Schema version; version 1 had no hashes and no descriptions of the arrays."""
MOST_TABLES = 200_000
"""Maximum number of tables and lists in a text: each needs about 70 bytes of memory and two of
text.
"""
LONGEST = 50_000_000
"""Maximum number of characters of a text."""


def read_json(text: str) -> Any:
    """Parse a JSON text; a table with a duplicate key is invalid.

    Raises `FileFormatError` if the text is not JSON, or needs far more memory than the numbers that
    it may describe.
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
    """Return an upper bound of the number of tables and lists in a JSON text.

    Brackets inside strings are counted too.
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
    """Parse a manifest and check its format and schema.

    Raises `FileFormatError` if the text is not JSON or not a manifest of this format and schema.

    Parameters
    ----------
    form : str
        Required format name.
    schema : int
        Supported schema version.
    place : str
        Name used in messages: the file name of the manifest.
    """
    try:
        given = read_json(text)
    except FileFormatError as error:
        raise FileFormatError(f"{place}: {error}") from error
    if not isinstance(given, dict) or given.get("format") != form:
        kind = form.removeprefix("ann_dc ")
        raise FileFormatError(f"{place}: does not say {form!r}; is this a saved {kind}?")
    version = given.get("schema")
    if version != schema or type(version) is not int:
        raise FileFormatError(
            f"{place}.schema: expected {schema}, got {version!r:.60}; load the file with the "
            "version of ann_dc that saved it"
        )
    return Table(place, given)


def weight_names(connections: Iterable[Connection]) -> list[str]:
    """Return unique entry names of the weights, one per connection.

    Further connections between the same two nodes are numbered.
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
    """JSON table of the manifest, with its position for messages.

    Raises `FileFormatError` if the value is not a table.

    Attributes
    ----------
    place : str
        Position of the table in the manifest; messages begin with it.
    given : dict
        Parsed JSON value.
    """

    def __init__(self, place: str, given) -> None:
        if not isinstance(given, dict):
            raise FileFormatError(f"{place}: expected a table, got {given!r:.60}")
        self.place, self.given = place, given

    def only(self, keys: str) -> None:
        """Raise `FileFormatError` that names the keys not listed in ``keys``.

        The names in ``keys`` are separated by blanks.
        """
        unknown = self.given.keys() - _words(keys)
        if unknown:
            raise FileFormatError(f"{self.place}: unknown key {', '.join(sorted(unknown)):.300}")

    def has(self, key: str) -> bool:
        """Return True if the entry exists; used for entries that older files lack."""
        return key in self.given

    def get(self, key: str, kind: type):
        """Return an entry of the requested type.

        Raises `FileFormatError` if the entry is missing or has another type.
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
        """Return an integer between ``low`` and ``high``, both included.

        Raises `FileFormatError` if the entry is missing, not an integer or out of range.
        """
        value = self.get(key, int)
        if not low <= value <= high:
            raise FileFormatError(f"{self.place}.{key}: {value} is not in {low} .. {high}")
        return value

    def choice(self, key: str, available: Mapping):
        """Return the object that a name denotes in ``available``.

        Raises `UnknownNameError`, which lists the available names, if the name is unknown, and
        `FileFormatError` if the entry has no name.
        """
        name = self.get(key, str)
        if name not in available:
            raise UnknownNameError.of(f"{self.place}.{key}:", name, available)
        return available[name]

    def names(self, key: str) -> tuple[str, ...]:
        """Return a list of distinct strings.

        Raises `FileFormatError` if the entry is missing, contains anything except strings, or
        contains a string twice.
        """
        values = self.get(key, list)
        if not all(isinstance(value, str) for value in values):
            raise FileFormatError(f"{self.place}.{key}: expected names only")
        if len(set(values)) < len(values):
            raise FileFormatError(f"{self.place}.{key}: a name occurs twice")
        return tuple(values)

    def rows(self, key: str) -> Iterator[Table]:
        """Iterate over the tables of a list."""
        for i, value in enumerate(self.get(key, list)):
            yield Table(f"{self.place}.{key}[{i}]", value)

    def record(self, kind: type, *besides: str):
        """Return all keys as a record of names, with a stage if the record has one."""
        keys, types = _fields(kind)
        self.only(" ".join([keys, *besides]))
        return kind(**{key: self.get(key, type_) for key, type_ in types})

    def records(self, key: str, kind: type) -> tuple:
        """Return a list of records of the given class."""
        return tuple(row.record(kind) for row in self.rows(key))


@cache
def _words(keys: str) -> frozenset[str]:
    return frozenset(keys.split())


@cache
def _fields(kind: type) -> tuple[str, tuple[tuple[str, type], ...]]:
    """Return the names of a record's fields and the manifest type of each field."""
    types = tuple((f.name, int if f.name == "stage" else str) for f in fields(kind))
    return " ".join(name for name, _ in types), types
