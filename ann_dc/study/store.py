"""The rows of a study on disk: whole or not there, kept whatever happens to who writes them."""

from __future__ import annotations

import json
import os
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ann_dc.atomic_files import make_folder
from ann_dc.errors import OutputError, StoreError
from ann_dc.file_locks import Lock
from ann_dc.study import database as db, table_export as export
from ann_dc.study.columns import Columns, Kinds, with_truths
from ann_dc.study.identity import as_text, differences, lasting
from ann_dc.study.records import FAILED, LOST, OUTCOME, POINT, TIMED_OUT, Finished, Row
from ann_dc.study.stored_trajectories import unpacked

LOCK = "lock"
"""File in the folder of a study that says who is at work on it."""
PIECE = 10_000
"""Rows in memory at a time."""


class Store:
    """A table of rows in a folder, with curves beside them.

    `begin` makes or continues one, `open` reads one, also while another process writes to it. The
    folder has to lie on a disk of this machine. Its file 'study.sqlite' is an SQLite database:
    table ``rows`` has a column for each of the study's.

    Parameters
    ----------
    folder : Path
    database : sqlite3.Connection
    lock : Lock, optional
        Of who writes.

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
        """Make the store of a study, or continue the one that is there.

        Parameters
        ----------
        folder : path-like
            Made where there is none.
        identity : mapping
            Nested plain data: all that makes the study this one. What is under `WORDS` says only
            how rows are read, and may change.
        columns : sequence of str
            ``point`` first; ``outcome`` among them.

        Raises
        ------
        StoreError
            If another study is there (it says in what it differs), another process is at work on
            it, it is of another layout or no store at all, or the folder cannot be written to.
        """
        place, about = Path(folder), db.About(as_text(identity), Columns(columns), {})
        with db.told(place):
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
            if db.is_empty(database):
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
                db.tell_anew(database, given.identity)
            return cls(folder, database, lock)
        except BaseException:
            database.close()
            raise

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> Store:
        """Read the store of a study.

        Parameters
        ----------
        folder : path-like

        Raises
        ------
        StoreError
            If there is none, it is of another layout, or no store at all.
        """
        place = Path(folder)
        with db.told(place):
            database = db.readable(place)
            try:
                return cls(place, database)
            except BaseException:
                database.close()
                raise

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, ``point`` first."""
        return self._columns.names

    def append(self, finished: Sequence[Finished]) -> None:
        """Keep rows and their curves: all of them, or none.

        Parameters
        ----------
        finished : sequence of Finished
            Of points that have no row; nan becomes None.

        Raises
        ------
        StoreError
            If a point has a row, a column or a value is none that can be kept, or it cannot be
            written; everything that was stored before stays.
        """
        table = [self._columns.cells(one.row) for one in finished]
        kinds = self._columns.kinds(table, self._kinds)
        curves = [(one.row[POINT], one.curves) for one in finished if one.curves]
        places = ", ".join("?" * len(self.columns))
        with db.told(self.folder), db.transaction(self._database, "IMMEDIATE"):
            self._database.executemany(f"INSERT INTO rows VALUES ({places})", table)
            self._database.executemany("INSERT INTO curves VALUES (?, ?)", curves)
            if kinds != self._kinds:
                self._database.execute(
                    "UPDATE meta SET value = ? WHERE name = 'kinds'", [json.dumps(kinds)]
                )
        self._kinds = kinds

    def discard(self, points: Iterable[int]) -> None:
        """Forget rows and curves, so that the points are done again.

        Parameters
        ----------
        points : iterable of int

        Raises
        ------
        StoreError
            If it cannot be written; everything stays then.
        """
        numbers = [(point,) for point in points]
        with db.told(self.folder), db.transaction(self._database, "IMMEDIATE"):
            for table in ("rows", "curves"):
                self._database.executemany(f"DELETE FROM {table} WHERE point = ?", numbers)

    def finished(self) -> set[int]:
        """Numbers of the points that have a row."""
        return {point for (point,) in self._select("SELECT point FROM rows")}

    def failed(self) -> set[int]:
        """Numbers of the points that have a row and no result."""
        without = f"SELECT point FROM rows WHERE {self._columns.quoted[OUTCOME]} IN (?, ?, ?)"
        return {point for (point,) in self._select(without, FAILED, TIMED_OUT, LOST)}

    def outcomes(self) -> Counter[str]:
        """How many rows have which outcome."""
        outcome = self._columns.quoted[OUTCOME]
        counted = self._select(f"SELECT {outcome}, count(*) FROM rows GROUP BY {outcome}")
        return Counter({str(outcome): number for outcome, number in counted})

    def __len__(self) -> int:
        return self._select("SELECT count(*) FROM rows")[0][0]

    def rows(self) -> Iterator[Row]:
        """Every row, in the order of points."""
        for piece in self._pieces():
            for cells in piece:
                yield dict(zip(self.columns, cells))

    def curves(self, point: int) -> dict[str, np.ndarray]:
        """What a point did over time, by name; nothing where that was not kept.

        Parameters
        ----------
        point : int

        Raises
        ------
        StoreError
            If what is stored is no such file.
        """
        for (content,) in self._select("SELECT content FROM curves WHERE point = ?", point):
            return unpacked(content)
        return {}

    def to_frame(self) -> Any:
        """The table as a data frame of pandas, in the order of points.

        Units of measure are in ``attrs["units"]``, by column, where they are known.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        PandasMissing
            If pandas is not installed.
        """
        with db.told(self.folder), db.transaction(self._database):
            return export.frame(self._pieces(), self._held(), self.identity)

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the table as a CSV file, numbers with all their digits.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        OutputError
            If the file cannot be written; what was there before stays.
        """
        with db.told(self.folder), db.transaction(self._database):
            export.write_csv(path, self._pieces(), self.columns)

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write the table as a Parquet file; the identity of the study is among its metadata.

        A column with texts and numbers is one of texts there.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        PyarrowMissing
            If pyarrow is not installed.
        OutputError
            If the file cannot be written; what was there before stays.
        """
        with db.told(self.folder), db.transaction(self._database):
            export.write_parquet(path, self._pieces(), self._held(), as_text(self.identity))

    def close(self) -> None:
        """Let others continue; nothing if it is closed already."""
        self._database.close()
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _select(self, query: str, *values: Any) -> list[tuple]:
        with db.told(self.folder):
            return self._database.execute(query, values).fetchall()

    def _held(self) -> Kinds:
        """What each column has held until now."""
        with db.told(self.folder):
            found = db.about_of(self._database, self.folder).kinds
        return {name: found.get(name, []) for name in self.columns}

    def _pieces(self) -> Iterator[list[list[Any]]]:
        """The table, some rows at a time."""
        last = -1
        query = "SELECT * FROM rows WHERE point > ? ORDER BY point LIMIT ?"
        truths = self._columns.truths(self._held())
        while piece := self._select(query, last, PIECE):
            yield [with_truths(cells, truths) for cells in piece]
            last = piece[-1][0]
