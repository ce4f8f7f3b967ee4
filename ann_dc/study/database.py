"""SQLite database of a study: creation, access and error descriptions.

In WAL mode a completed transaction survives the end of the process. A power failure may lose the
last transactions, but never part of a transaction.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from ann_dc.errors import AnnDcError, StoreError
from ann_dc.study.columns import Columns, Kinds
from ann_dc.study.records import OUTCOME

FILE = "study.sqlite"
"""File name in the folder of a study."""
LAYOUT = "1"
"""Version of the table layout."""
PATIENCE = 60.0
"""Seconds to wait for another process that is writing."""


class About(NamedTuple):
    """Description of a study, stored in addition to its records; the identity is JSON."""

    identity: str
    columns: Columns
    kinds: Kinds


TABLES = {"meta", "rows", "curves"}


@contextlib.contextmanager
def named_errors(folder: Path) -> Iterator[None]:
    """Convert database errors to a `StoreError` that names the folder of the study."""
    try:
        yield
    except AnnDcError:
        raise
    except sqlite3.IntegrityError as error:
        raise StoreError(
            f"{str(folder)!r}: a case has one record; discard the old one first ({error})"
        ) from error
    except UnicodeDecodeError as error:
        raise StoreError(f"{str(folder)!r}: the database is damaged ({error})") from error
    except (sqlite3.Error, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        raise StoreError(f"{str(folder)!r}: {reason}; {_remedy(error)}") from error


def _remedy(error: Exception) -> str:
    name = getattr(error, "sqlite_errorname", "")
    if name.startswith(("SQLITE_NOTADB", "SQLITE_CORRUPT")):
        return f"{FILE} is not a study database, or is damaged; use another folder"
    if name.startswith(("SQLITE_FULL", "SQLITE_IOERR")):
        return (
            "the disk may be full, or a limit of file sizes reached; earlier records are "
            "stored: free space and run the study again"
        )
    if name.startswith("SQLITE_BUSY"):
        return "another process writes to it; terminate that process and try again"
    return "use a writable folder"


def writable(folder: Path) -> sqlite3.Connection:
    """Open the database of a folder, which may be empty."""
    database = sqlite3.connect(folder / FILE, isolation_level=None, timeout=PATIENCE)
    with _closed_on_error(database):
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute("PRAGMA synchronous = NORMAL")
    return database


def readable(folder: Path) -> sqlite3.Connection:
    """Open the database of a folder for reading, also on read-only storage.

    Raises `StoreError` if the database is missing.
    """
    file = folder / FILE
    if not file.is_file():
        raise StoreError(f"{str(folder)!r}: expected a study ({FILE} is missing)")
    address = f"file:{quote(str(file.absolute()))}?mode=ro"
    database = sqlite3.connect(address, uri=True, isolation_level=None, timeout=PATIENCE)
    with _closed_on_error(database):
        try:
            database.execute("SELECT count(*) FROM sqlite_master")
        except sqlite3.OperationalError:
            log = file.with_name(f"{FILE}-wal")
            if log.exists() and log.stat().st_size:
                raise
            database.close()  # what cannot be written to changes no more
            database = sqlite3.connect(f"{address}&immutable=1", uri=True, isolation_level=None)
        database.execute("PRAGMA trusted_schema = OFF")
    return database


@contextlib.contextmanager
def _closed_on_error(database: sqlite3.Connection) -> Iterator[None]:
    try:
        yield
    except BaseException:
        database.close()
        raise


@contextlib.contextmanager
def transaction(database: sqlite3.Connection, kind: str = "DEFERRED") -> Iterator[None]:
    """Run a block as one transaction, with a consistent snapshot for reads.

    The kind ``IMMEDIATE`` is required for writing.
    """
    database.execute(f"BEGIN {kind}")
    try:
        yield
        database.execute("COMMIT")
    except BaseException:
        if database.in_transaction:  # a full disk ends it by itself
            database.execute("ROLLBACK")
        raise


def make_tables(database: sqlite3.Connection, about: About) -> None:
    """Create the tables of a study if the database is empty."""
    if database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        return
    columns = about.columns.quoted
    point, *others = columns.values()
    entries = {
        "layout": LAYOUT,
        "identity": about.identity,
        "columns": json.dumps(about.columns.names),
        "kinds": json.dumps(about.kinds),
    }
    database.execute("PRAGMA journal_mode = WAL")
    with transaction(database, "IMMEDIATE"):
        database.execute("CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT)")
        database.execute(f"CREATE TABLE rows ({point} INTEGER PRIMARY KEY, {', '.join(others)})")
        database.execute(f"CREATE INDEX by_outcome ON rows ({columns[OUTCOME]})")
        database.execute("CREATE TABLE curves (point INTEGER PRIMARY KEY, content BLOB)")
        database.executemany("INSERT INTO meta VALUES (?, ?)", entries.items())


def update_entry(database: sqlite3.Connection, name: str, value: str) -> None:
    """Replace an entry of the description of the study."""
    database.execute("UPDATE meta SET value = ? WHERE name = ?", (value, name))


def about_of(database: sqlite3.Connection, folder: Path) -> About:
    """Return the description of the study in a database.

    Raises `StoreError` if the database is damaged, has another layout or does not contain a study.
    """
    found = database.execute("SELECT type, name FROM sqlite_master").fetchall()
    tables = {name for kind, name in found if kind == "table"}
    if tables != TABLES or not {kind for kind, _ in found} <= {"table", "index"}:
        raise StoreError(f"{str(folder)!r}: {FILE} is not a study database; use another folder")
    meta = dict(database.execute("SELECT name, value FROM meta"))
    if meta.get("layout") != LAYOUT:
        raise StoreError(
            f"{str(folder)!r}: the database has layout {meta.get('layout')}, this version of "
            f"ann_dc reads layout {LAYOUT}; use the version that wrote it, or another folder"
        )
    try:
        _mapping(meta["identity"])
        kinds = {name: [*map(str, words)] for name, words in _mapping(meta["kinds"]).items()}
        about = About(meta["identity"], Columns(json.loads(meta["columns"])), kinds)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise StoreError(f"{str(folder)!r}: the database is damaged ({error!r:.80})") from error
    there = [name for _, name, *_ in database.execute("PRAGMA table_info(rows)")]
    if len(there) != len(about.columns.names):
        raise StoreError(
            f"{str(folder)!r}: the database is damaged: columns of its rows are missing"
        )
    return about


def _mapping(text: str) -> dict[str, Any]:
    return {**json.loads(text)}
