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
"""Maximum number of tables and lists in a text: each needs 70 bytes of memory and two of text."""
LONGEST = 50_000_000
"""Maximum number of characters of a text."""


def read_json(text: str) -> Any:
    """Parse a JSON text; a table with a duplicate key is invalid.

    Raises `FileFormatError` also for a text that needs far more memory than its numbers.
    """
    if len(text) > LONGEST:
        raise FileFormatError(f"unexpected JSON: more than {LONGEST} letters")
    if tables_in(text) > MOST_TABLES:
        raise FileFormatError(f"unexpected JSON: more than {MOST_TABLES} tables and lists")
    try:
        return json.loads(text, parse_constant=_no_number, object_pairs_hook=_each_once)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"not JSON: {error}") from error


def tables_in(text: str) -> int:
    """Count tables and lists in a JSON text, and brackets inside strings too."""
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
    """Parse a manifest of a format name and schema version; messages begin with its place.

    Raises `FileFormatError` if the text is not such a manifest.
    """
    try:
        given = read_json(text)
    except FileFormatError as error:
        raise FileFormatError(f"{place}: {error}") from error
    if not isinstance(given, dict) or given.get("format") != form:
        kind = form.removeprefix("ann_dc ")
        raise FileFormatError(f"{place}: does not contain {form!r}; save the {kind} again")
    version = given.get("schema")
    if version != schema or type(version) is not int:
        raise FileFormatError(
            f"{place}.schema: expected {schema}, got {version!r:.60}; load the file with the "
            "version of ann_dc that saved it"
        )
    return Table(place, given)


def weight_names(connections: Iterable[Connection]) -> list[str]:
    """Return entry names of the weights; further connections between two nodes are numbered."""
    seen: Counter[str] = Counter()
    names = []
    for connection in connections:
        seen[connection.name] += 1
        count = seen[connection.name]
        names.append(f"weight/{connection.name}" + (f"#{count}" if count > 1 else ""))
    return names


def _no_number(text: str):
    raise ValueError(f"{text} is not a JSON number")


def typed(kind: type, value: Any, place: str) -> Any:
    """Return a JSON value of a type, or raise `FileFormatError`; a bool is not a number."""
    if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
        raise FileFormatError(f"{place}: expected {kind.__name__}, got {value!r:.60}")
    return value


class Table:
    """JSON table, with its position in the manifest, with which messages begin.

    Every reading raises `FileFormatError` if an entry is missing or of another kind.
    """

    def __init__(self, place: str, given) -> None:
        if not isinstance(given, dict):
            raise FileFormatError(f"{place}: expected a table, got {given!r:.60}")
        self.place, self.given = place, given

    def only(self, keys: str) -> None:
        """Raise `FileFormatError` for keys that are not among ``keys``, separated by blanks."""
        unknown = self.given.keys() - _words(keys)
        if unknown:
            raise FileFormatError(f"{self.place}: unknown key {', '.join(sorted(unknown)):.300}")

    def has(self, key: str) -> bool:
        """Return True if the entry exists; used for entries that older files lack."""
        return key in self.given

    def get(self, key: str, kind: type):
        """Return an entry of the requested type, or raise `FileFormatError`."""
        if key not in self.given:
            raise FileFormatError(f"{self.place}.{key}: missing")
        return typed(kind, self.given[key], f"{self.place}.{key}")

    def inner(self, key: str) -> Table:
        """Return the table at a key."""
        return Table(f"{self.place}.{key}", self.get(key, dict))

    def texts(self, key: str) -> dict[str, str]:
        """Return the table at a key, whose entries are all texts."""
        table = self.inner(key)
        return {name: table.get(name, str) for name in table.given}

    def whole(self, key: str, low: int, high: int) -> int:
        """Return an integer in ``low .. high``, or raise `FileFormatError`."""
        value = self.get(key, int)
        if not low <= value <= high:
            raise FileFormatError(f"{self.place}.{key}: {value} is not in {low} .. {high}")
        return value

    def choice(self, key: str, available: Mapping):
        """Return the object of a name in ``available``, or raise `UnknownNameError`."""
        name = self.get(key, str)
        if name not in available:
            raise UnknownNameError.of(f"{self.place}.{key}:", name, available)
        return available[name]

    def names(self, key: str) -> tuple[str, ...]:
        """Return a list of distinct strings, or raise `FileFormatError`."""
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
