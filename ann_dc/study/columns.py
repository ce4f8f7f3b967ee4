"""The columns of a table: their names, in a database and out of it, and what a cell may hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import NoneType
from typing import Any, TypeAlias

from ann_dc.errors import StoreError
from ann_dc.study.records import OUTCOME, POINT, Row, Value

MOST = 2000
"""Columns that a table of SQLite may have."""
LARGEST = 2**63
"""Whole numbers of SQLite are below it."""

Kinds: TypeAlias = dict[str, list[str]]
"""What each column has held: some of ``none``, ``bool``, ``int``, ``float``, ``str``."""

WORDS = {NoneType: "none", bool: "bool", int: "int", float: "float", str: "str"}


class Columns:
    """Names that were checked, with what turns rows into cells and back.

    A name is the name of a column in the database too. SQLite takes ``K`` and ``k`` for the same
    one: there, the later gets ``~2`` behind it.

    Parameters
    ----------
    names : sequence of str
        ``point`` is the first; none occurs twice.

    Raises
    ------
    StoreError
        If they cannot be the columns of a table.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        for name in self.names:
            if not isinstance(name, str) or not name or not name.isprintable():
                raise StoreError(f"columns: expected printable names, got {name!r}")
        twice = [name for place, name in enumerate(self.names) if name in self.names[:place]]
        if twice:
            raise StoreError(f"columns: {twice[0]!r} occurs twice; give each a name of its own")
        if self.names[:1] != (POINT,) or OUTCOME not in self.names or len(self.names) > MOST:
            raise StoreError(
                f"columns: expected {POINT!r}, then others with {OUTCOME!r} among them, at most "
                f"{MOST}; got {len(self.names)}: {', '.join(self.names)[:200]}"
            )

    @property
    def quoted(self) -> dict[str, str]:
        """The names for SQL, by name, in order."""
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
        """What is stored of a row, in order; None where it has nothing.

        Parameters
        ----------
        row : Row

        Raises
        ------
        StoreError
            If it has another column, or a value that no cell can hold.
        """
        if unknown := row.keys() - set(self.names):
            raise StoreError(
                f"row of point {row.get(POINT)}: unknown columns {', '.join(map(repr, unknown))}; "
                "there are: " + ", ".join(self.names)
            )
        found = [_cell(name, row.get(name)) for name in self.names]
        if type(found[0]) is not int or found[0] < 0:
            raise StoreError(f"{POINT}: expected a whole number from zero on, got {found[0]!r}")
        return found

    def kinds(self, table: Sequence[Sequence[Value]], before: Kinds) -> Kinds:
        """What each column has held, with a table of cells that joins it.

        Parameters
        ----------
        table : sequence of sequence of Value
            From `cells`.
        before : Kinds
        """
        found = {}
        for name, values in zip(self.names, zip(*table)):
            words = {WORDS[kind] for kind in set(map(type, values))}
            found[name] = sorted(words.union(before.get(name, ())))
        return found or before

    def truths(self, kinds: Kinds) -> list[int]:
        """Places of the columns that hold true and false, as 0 and 1 in the database.

        Parameters
        ----------
        kinds : Kinds
        """
        return [place for place, name in enumerate(self.names) if "bool" in kinds.get(name, ())]


def with_truths(cells: Sequence[Any], truths: Sequence[int]) -> list[Value]:
    """Cells as they were given, from those of the database.

    Parameters
    ----------
    cells : sequence
    truths : sequence of int
        Places of columns that hold true and false.

    Examples
    --------
    >>> with_truths([3, 1, 0.5, None], [1, 3])
    [3, True, 0.5, None]
    """
    found = list(cells)
    for place in truths:
        if type(found[place]) is int and found[place] in (0, 1):
            found[place] = bool(found[place])
    return found


def plain_row(row: Mapping[str, Any]) -> Row:
    """A row as a store gives it back.

    Parameters
    ----------
    row : mapping of str to value
        NumPy's numbers too.

    Raises
    ------
    StoreError
        If a value is one that no cell can hold.

    Examples
    --------
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
