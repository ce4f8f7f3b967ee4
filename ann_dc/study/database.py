"""The database of a study: opened, made, looked at, and what goes wrong with it as sentences.

SQLite in WAL mode: a transaction that has ended stays, whatever becomes of the process. (That the
machine's power fails may cost the last ones, but never half of one.)
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
"""In the folder of a study."""
LAYOUT = "1"
"""Of the tables here; another has another meaning."""
PATIENCE = 60.0
"""Seconds that one waits for another who is just writing."""


class About(NamedTuple):
    """What is told of a study beside its rows.

    Attributes
    ----------
    identity : str
        As JSON.
    columns : Columns
    kinds : Kinds
        What each column has held.
    """

    identity: str
    columns: Columns
    kinds: Kinds


TABLES = {"meta", "rows", "curves"}


@contextlib.contextmanager
def told(folder: Path) -> Iterator[None]:
    """What goes wrong with a database, as a sentence about the folder of the study.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    StoreError
    """
    try:
        yield
    except AnnDcError:
        raise
    except sqlite3.IntegrityError as error:
        raise StoreError(
            f"{str(folder)!r}: a point has one row; discard the old one first ({error})"
        ) from error
    except UnicodeDecodeError as error:
        raise StoreError(f"{str(folder)!r}: the store is damaged ({error})") from error
    except (sqlite3.Error, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        raise StoreError(f"{str(folder)!r}: {reason}; {_remedy(error)}") from error


def _remedy(error: Exception) -> str:
    name = getattr(error, "sqlite_errorname", "")
    if name.startswith(("SQLITE_NOTADB", "SQLITE_CORRUPT")):
        return f"{FILE} in it is not the store of a study, or damaged; give another folder"
    if name.startswith(("SQLITE_FULL", "SQLITE_IOERR")):
        return (
            "is the disk full, or a limit of file sizes reached? Everything stored before is "
            "there: make room, and run the study again"
        )
    if name.startswith("SQLITE_BUSY"):
        return "another process writes to it; end that, and try again"
    return "give a folder of your own that may be written to"


def writable(folder: Path) -> sqlite3.Connection:
    """Open the database of a folder, which may be empty so far.

    Parameters
    ----------
    folder : Path
    """
    database = sqlite3.connect(folder / FILE, isolation_level=None, timeout=PATIENCE)
    with _closed_on_error(database):
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute("PRAGMA synchronous = NORMAL")
    return database


def readable(folder: Path) -> sqlite3.Connection:
    """Open the database of a folder for reading, also where nothing may be written.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    StoreError
        If there is none.
    """
    file = folder / FILE
    if not file.is_file():
        raise StoreError(f"{str(folder)!r}: there is no study in it ({FILE} is missing)")
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
    """All that is done within, or nothing; what is read within is of one moment.

    Parameters
    ----------
    database : sqlite3.Connection
    kind : str
        ``IMMEDIATE`` to write.
    """
    database.execute(f"BEGIN {kind}")
    try:
        yield
        database.execute("COMMIT")
    except BaseException:
        if database.in_transaction:  # a full disk ends it by itself
            database.execute("ROLLBACK")
        raise


def is_empty(database: sqlite3.Connection) -> bool:
    """Whether nothing was ever made in it.

    Parameters
    ----------
    database : sqlite3.Connection
    """
    return not database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]


def make_tables(database: sqlite3.Connection, about: About) -> None:
    """Make the tables of a study.

    Parameters
    ----------
    database : sqlite3.Connection
        That is empty.
    about : About
    """
    columns = about.columns.quoted
    point, *others = columns.values()
    told_of_it = {
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
        database.executemany("INSERT INTO meta VALUES (?, ?)", told_of_it.items())


def tell_anew(database: sqlite3.Connection, identity: str) -> None:
    """Replace what is told of the study.

    Parameters
    ----------
    database : sqlite3.Connection
    identity : str
    """
    with transaction(database, "IMMEDIATE"):
        database.execute("UPDATE meta SET value = ? WHERE name = 'identity'", (identity,))


def about_of(database: sqlite3.Connection, folder: Path) -> About:
    """What is told of the study in a database.

    Parameters
    ----------
    database : sqlite3.Connection
    folder : Path

    Raises
    ------
    StoreError
        If it is no study's, or one of another layout, or damaged.
    """
    found = database.execute("SELECT type, name FROM sqlite_master").fetchall()
    tables = {name for kind, name in found if kind == "table"}
    if tables != TABLES or not {kind for kind, _ in found} <= {"table", "index"}:
        raise StoreError(
            f"{str(folder)!r}: {FILE} in it is not the store of a study; give another folder"
        )
    meta = dict(database.execute("SELECT name, value FROM meta"))
    if meta.get("layout") != LAYOUT:
        raise StoreError(
            f"{str(folder)!r}: the store has layout {meta.get('layout')}, this version of ann_dc "
            f"reads layout {LAYOUT}; use the version that wrote it, or give another folder"
        )
    try:
        _mapping(meta["identity"])
        kinds = {name: [*map(str, words)] for name, words in _mapping(meta["kinds"]).items()}
        about = About(meta["identity"], Columns(json.loads(meta["columns"])), kinds)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise StoreError(f"{str(folder)!r}: the store is damaged ({error!r:.80})") from error
    there = [name for _, name, *_ in database.execute("PRAGMA table_info(rows)")]
    if len(there) != len(about.columns.names):
        raise StoreError(f"{str(folder)!r}: the store is damaged: columns of its rows are missing")
    return about


def _mapping(text: str) -> dict[str, Any]:
    return {**json.loads(text)}
