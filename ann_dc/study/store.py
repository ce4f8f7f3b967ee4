"""Store of study records on disk with atomic writes."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ann_dc.errors import OutputError, StoreError
from ann_dc.files import Lock, make_folder
from ann_dc.study import database as db, table_export as export
from ann_dc.study.columns import Columns, Kinds, with_truths
from ann_dc.study.records import FAILED, LOST, OUTCOME, POINT, TIMED_OUT, Finished, Row
from ann_dc.study.stored_trajectories import unpacked

LOCK = "lock"
"""File in the folder of a study that identifies the writing process."""
PIECE = 10_000
"""Number of records in memory at a time."""
INTERPRETATION = ("title", "spec")
"""Entries of an identity that affect only the interpretation of records."""
MOST_DIFFERENCES = 6
"""Number of differences listed in a message; further ones are counted."""
LONGEST = 60
"""Largest number of characters of a value in a message."""


class Store:
    """Table of records in a folder, with trajectories.

    `begin` creates or continues a store. `open` reads a store, also while another process writes.
    The folder must be on a local disk. Its file 'study.sqlite' is an SQLite database whose table
    ``rows`` has one column per study column. The writing process holds the lock.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     columns = ["point", "rho", "outcome"]
    ...     with Store.begin(folder, {"seed": 0}, columns) as store:
    ...         store.append([Finished({"point": 0, "rho": 1.5, "outcome": "settled"})])
    ...     with Store.open(folder) as store:
    ...         print(len(store), *store.rows())
    1 {'point': 0, 'rho': 1.5, 'outcome': 'settled'}
    """

    def __init__(
        self, folder: Path, database: sqlite3.Connection, lock: Lock | None = None
    ) -> None:
        self.folder, self._database, self._lock = folder, database, lock
        identity, self._columns, self._kinds = db.about_of(database, folder)
        self.identity: dict[str, Any] = json.loads(identity)

    @classmethod
    def begin(
        cls, folder: str | os.PathLike[str], identity: Mapping[str, Any], columns: Sequence[str]
    ) -> Store:
        """Create the store of a study in a folder, or continue the existing one.

        The identity is nested plain data; its entries `INTERPRETATION` may change. Column names
        begin with ``point`` and contain ``outcome``.

        Raises `StoreError` if the folder contains another study (the message lists the
        differences), another layout or other files. Also if another process is writing or the
        folder cannot be written.
        """
        place, about = Path(folder), db.About(json.dumps(identity), Columns(columns), {})
        with db.named_errors(place):
            try:
                make_folder(place)
            except OutputError as error:
                raise StoreError(str(error)) from error
            lock = Lock(place / LOCK, on="this study", error=StoreError)
            try:
                return cls._begun(place, about, lock)
            except BaseException:
                lock.release()
                raise

    @classmethod
    def _begun(cls, folder: Path, given: db.About, lock: Lock) -> Store:
        database = db.writable(folder)
        try:
            db.make_tables(database, given)
            stored = db.about_of(database, folder)
            changed = differences(
                _lasting(stored.identity), _lasting(given.identity)
            ) or differences(
                *(json.dumps({"columns": about.columns.names}) for about in (stored, given))
            )
            if changed:
                raise StoreError(
                    f"{str(folder)!r} contains another study: {changed} (stored -> given); use "
                    "another folder, or the stored study"
                )
            if stored.identity != given.identity:
                db.update_entry(database, "identity", given.identity)
            return cls(folder, database, lock)
        except BaseException:
            database.close()
            raise

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> Store:
        """Open the store of a study for reading.

        Raises `StoreError` if the folder does not contain a store of this layout.
        """
        place = Path(folder)
        with db.named_errors(place):
            database = db.readable(place)
            try:
                return cls(place, database)
            except BaseException:
                database.close()
                raise

    @property
    def columns(self) -> tuple[str, ...]:
        """Column names, ``point`` first."""
        return self._columns.names

    def append(self, finished: Sequence[Finished]) -> None:
        """Store records and trajectories of cases without a record in one transaction.

        Nan becomes None. Raises `StoreError` if a case already has a record, a column or value is
        invalid, or writing fails. Earlier content then remains.
        """
        table = [self._columns.cells(one.row) for one in finished]
        kinds = self._columns.kinds(table, self._kinds)
        curves = [(one.row[POINT], one.curves) for one in finished if one.curves]
        places = ", ".join("?" * len(self.columns))
        with db.named_errors(self.folder), db.transaction(self._database, "IMMEDIATE"):
            self._database.executemany(f"INSERT INTO rows VALUES ({places})", table)
            self._database.executemany("INSERT INTO curves VALUES (?, ?)", curves)
            if kinds != self._kinds:
                db.update_entry(self._database, "kinds", json.dumps(kinds))
        self._kinds = kinds

    def discard(self, points: Iterable[int]) -> None:
        """Delete records and trajectories, so that the cases are run again.

        Raises `StoreError` if writing fails; the content then remains.
        """
        numbers = [(point,) for point in points]
        with db.named_errors(self.folder), db.transaction(self._database, "IMMEDIATE"):
            for table in ("rows", "curves"):
                self._database.executemany(f"DELETE FROM {table} WHERE point = ?", numbers)

    def finished(self) -> set[int]:
        """Return the numbers of the cases with a record."""
        return {point for (point,) in self._select("SELECT point FROM rows")}

    def failed(self) -> set[int]:
        """Return the numbers of the cases with a record but without a result."""
        without = f"SELECT point FROM rows WHERE {self._columns.quoted[OUTCOME]} IN (?, ?, ?)"
        return {point for (point,) in self._select(without, FAILED, TIMED_OUT, LOST)}

    def __len__(self) -> int:
        return self._select("SELECT count(*) FROM rows")[0][0]

    def rows(self) -> Iterator[Row]:
        """Yield all records in the order of cases."""
        for piece in self._pieces():
            for cells in piece:
                yield dict(zip(self.columns, cells))

    def curves(self, point: int) -> dict[str, np.ndarray]:
        """Return the trajectories of a case by name; empty if they were not stored.

        Raises `StoreError` if the stored bytes are invalid.
        """
        for (content,) in self._select("SELECT content FROM curves WHERE point = ?", point):
            return unpacked(content)
        return {}

    def to_frame(self) -> Any:
        """Return the table as a pandas data frame in the order of cases.

        Known units of measure are stored in ``attrs["units"]`` by column. Raises `PandasMissing` if
        pandas is not installed.
        """
        with db.named_errors(self.folder), db.transaction(self._database):
            return export.frame(self._pieces(), self._held(), self.identity)

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the table as a CSV file, numbers with full precision.

        Raises `OutputError` if the file cannot be written; an existing file is then unchanged.
        """
        with db.named_errors(self.folder), db.transaction(self._database):
            export.write_csv(path, self._pieces(), self.columns)

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write the table as a Parquet file with the study identity as metadata.

        A column with text and numbers is stored as text. Raises `PyarrowMissing` if pyarrow is not
        installed and `OutputError` if the file cannot be written. An existing file is then
        unchanged.
        """
        with db.named_errors(self.folder), db.transaction(self._database):
            export.write_parquet(path, self._pieces(), self._held(), json.dumps(self.identity))

    def close(self) -> None:
        """Release the lock and close the database; do nothing if already closed."""
        self._database.close()
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _select(self, query: str, *values: Any) -> list[tuple]:
        with db.named_errors(self.folder):
            return self._database.execute(query, values).fetchall()

    def _held(self) -> Kinds:
        """Return the types that each column has contained so far."""
        with db.named_errors(self.folder):
            found = db.about_of(self._database, self.folder).kinds
        return {name: found.get(name, []) for name in self.columns}

    def _pieces(self) -> Iterator[list[list[Any]]]:
        """Yield the table in blocks of records."""
        last = -1
        query = "SELECT * FROM rows WHERE point > ? ORDER BY point LIMIT ?"
        truths = self._columns.truths(self._held())
        while piece := self._select(query, last, PIECE):
            yield [with_truths(cells, truths) for cells in piece]
            last = piece[-1][0]


# ---- differences between the identities of two studies ------------------------------------------


def _lasting(identity: str) -> str:
    """Return the part of an identity (JSON) that determines the records (not `INTERPRETATION`).

    >>> _lasting('{"title": "chips", "seed": 0}')
    '{"seed": 0}'
    """
    determining = {
        name: value for name, value in json.loads(identity).items() if name not in INTERPRETATION
    }
    return json.dumps(determining)


def differences(stored: str, given: str) -> str:
    """Return a description of the differences between two identities (JSON), or "".

    >>> differences('{"vary": {"N": [9, 18]}, "seed": 0}', '{"vary": {"N": [9, 36, 72]}}')
    'seed: 0 -> none; vary.N[1]: 18 -> 36; vary.N[2]: none -> 72'
    """
    if stored == given:
        return ""
    before, after = dict(_leaves(json.loads(stored))), dict(_leaves(json.loads(given)))
    names = [*before, *(name for name in after if name not in before)]
    changes = [
        f"{name}: {_shortened(before.get(name))} -> {_shortened(after.get(name))}"
        for name in sorted(names)
        if before.get(name) != after.get(name)
    ]
    if len(changes) > MOST_DIFFERENCES:
        changes[MOST_DIFFERENCES:] = [f"and {len(changes) - MOST_DIFFERENCES} more"]
    return "; ".join(changes) or "the order of its entries"


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Yield each single value (or empty container) as JSON with its dotted name."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}".removeprefix("."))
    elif isinstance(value, list) and value:
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{name}[{index}]")
    else:
        yield name, json.dumps(value)


def _shortened(value: str | None) -> str:
    if value is None:
        return "none"
    return value if len(value) <= LONGEST else f"{value[:LONGEST]}..."
