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
from ann_dc.study.identity import as_text, differences, lasting
from ann_dc.study.records import FAILED, LOST, OUTCOME, POINT, TIMED_OUT, Finished, Row
from ann_dc.study.stored_trajectories import unpacked

LOCK = "lock"
"""File in the folder of a study that identifies the writing process."""
PIECE = 10_000
"""Number of records in memory at a time."""


class Store:
    """Table of records in a folder, with trajectories.

    `begin` creates or continues a store. `open` reads a store, also while another process writes.
    The folder must be on a local disk. Its file 'study.sqlite' is an SQLite database whose table
    ``rows`` has one column per study column. The writing process holds the lock.

    Examples
    --------
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

        The identity is nested plain data; its entries `WORDS` affect only the interpretation of
        records and may change. Column names begin with ``point`` and contain ``outcome``.

        Raises `StoreError` if the folder contains another study (the message lists the
        differences), another layout or other files. Also if another process is writing or the
        folder cannot be written.
        """
        place, about = Path(folder), db.About(as_text(identity), Columns(columns), {})
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
            changed = differences(lasting(stored.identity), lasting(given.identity)) or differences(
                *(as_text({"columns": about.columns.names}) for about in (stored, given))
            )
            if changed:
                raise StoreError(
                    f"{str(folder)!r} holds another study than this one: {changed} (stored -> "
                    "given); give another folder, or the study as it was"
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
            export.write_parquet(path, self._pieces(), self._held(), as_text(self.identity))

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
