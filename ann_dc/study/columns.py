"""Columns of a study table: names in the table and the database, and cell values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import NoneType
from typing import Any, TypeAlias

from ann_dc.errors import StoreError
from ann_dc.study.records import OUTCOME, POINT, Row, Value

MOST = 2000
"""Largest number of columns in an SQLite table."""
LARGEST = 2**63
"""Exclusive limit of the magnitude of SQLite integers."""

Kinds: TypeAlias = dict[str, list[str]]
"""Types that each column has contained: some of ``none``, ``bool``, ``int``, ``float``, ``str``."""

WORDS = {NoneType: "none", bool: "bool", int: "int", float: "float", str: "str"}


class Columns:
    """Validated column names, with the conversion of records to cells and back.

    A name is also the name of the database column. SQLite does not distinguish ``K`` and ``k``, so
    the later name gets the suffix ``~2`` in the database. ``point`` is the first name and no name
    occurs twice. The constructor raises `StoreError` for names that cannot be columns of a table.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        for name in self.names:
            if not isinstance(name, str) or not name or not name.isprintable():
                raise StoreError(f"columns: expected printable names, got {name!r}")
        twice = [name for place, name in enumerate(self.names) if name in self.names[:place]]
        if twice:
            raise StoreError(f"columns: {twice[0]!r} occurs twice; use different names")
        if self.names[:1] != (POINT,) or OUTCOME not in self.names or len(self.names) > MOST:
            raise StoreError(
                f"columns: expected {POINT!r}, then others with {OUTCOME!r} among them, at most "
                f"{MOST}; got {len(self.names)}: {', '.join(self.names)[:200]}"
            )

    @property
    def quoted(self) -> dict[str, str]:
        """SQL identifiers by name, in order."""
        taken: set[str] = set()
        found = {}
        for name in self.names:
            own, turn = name, 2
            while own.lower() in taken:
                own, turn = f"{name}~{turn}", turn + 1
            taken.add(own.lower())
            found[name] = '"' + own.replace('"', '""') + '"'
        return found

    def cells(self, row: Row) -> list[Value]:
        """Return the cells of a record in order; None for missing values.

        Raises `StoreError` if the record has an unknown column or a value that a cell cannot store.
        """
        if unknown := row.keys() - set(self.names):
            raise StoreError(
                f"row of point {row.get(POINT)}: unknown columns {', '.join(map(repr, unknown))}; "
                "there are: " + ", ".join(self.names)
            )
        found = [_cell(name, row.get(name)) for name in self.names]
        if type(found[0]) is not int or found[0] < 0:
            raise StoreError(f"{POINT}: expected a whole number of at least 0, got {found[0]!r}")
        return found

    def kinds(self, table: Sequence[Sequence[Value]], before: Kinds) -> Kinds:
        """Return the types that each column has contained, including those of new cells."""
        found = {}
        for name, values in zip(self.names, zip(*table)):
            words = {WORDS[kind] for kind in set(map(type, values))}
            found[name] = sorted(words.union(before.get(name, ())))
        return found or before

    def truths(self, kinds: Kinds) -> list[int]:
        """Return the indices of boolean columns, which the database stores as 0 and 1."""
        return [place for place, name in enumerate(self.names) if "bool" in kinds.get(name, ())]


def with_truths(cells: Sequence[Any], truths: Sequence[int]) -> list[Value]:
    """Return database cells with booleans restored in the columns `truths`.

    >>> with_truths([3, 1, 0.5, None], [1, 3])
    [3, True, 0.5, None]
    """
    found = list(cells)
    for place in truths:
        if type(found[place]) is int and found[place] in (0, 1):
            found[place] = bool(found[place])
    return found


def plain_row(row: Mapping[str, Any]) -> Row:
    """Return a record as a store returns it, with NumPy numbers converted.

    Raises `StoreError` if a cell cannot store a value.

    >>> plain_row({"point": 1, "decay": float("nan"), "peak": float("inf")})
    {'point': 1, 'decay': None, 'peak': inf}
    """
    return {name: _cell(name, value) for name, value in row.items()}


def _cell(name: str, value: Any) -> Value:
    if value is None or value is True or value is False:
        return value
    if isinstance(value, float):
        return float(value) if value == value else None
    if isinstance(value, str):
        return str.__str__(value).encode("utf-8", "backslashreplace").decode()
    if isinstance(value, int):
        if -LARGEST <= value < LARGEST:
            return int(value)
    elif getattr(value, "shape", None) == ():  # a number of NumPy's
        return _cell(name, value.item())
    raise StoreError(
        f"{name}: expected a number of at most 64 bits, a text, true, false or none, got "
        f"{value!r:.80}"
    )
