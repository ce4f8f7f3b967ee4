"""A result as a folder, which is complete or refused.

=================  ===============================================================================
``manifest.json``  what a person may read: formulas, figures, sentences, and which arrays there are
``arrays.npz``     the arrays of the records, by place: ``run/trajectory/states``
``<name>.npz``     every network as a weight file of its own; `load` reads it
``SHA256SUMS``     what the others have to be; ``sha256sum --check SHA256SUMS`` says so too
=================  ===============================================================================

Nothing in it is ever executed or unpickled, and no name in it leads out of the folder.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ann_dc.errors import AnnDcError, FileFormatError
from ann_dc.network.network import Network
from ann_dc.solution.result_reader import Reader
from ann_dc.solution.result_writer import Writer
from ann_dc.weights.entries import Entries
from ann_dc.weights.manifest import Table, read_manifest
from ann_dc.weights.network_file import MAX_BYTES, packed, unpacked
from ann_dc.weights.npz import BROKEN, NpzEntries, packed_entries
from ann_dc.whole_files.files import read_whole, write_folder

FORMAT = "ann_dc solution"
SCHEMA = 1

MANIFEST, ARRAYS, SUMS = "manifest.json", "arrays.npz", "SHA256SUMS"
REMEDY = "give the path of a folder that a solution was saved to"
MAX_MANIFEST = 10_000_000
"""Largest `MANIFEST` in bytes."""
LONGEST_SUMS = 10_000
"""Bytes of `SUMS`, at most: a line a file."""
SUM = re.compile(r"([0-9a-f]{64})  ([a-z]{1,40}\.(?:npz|json))")
"""A line of `SUMS`: a digest, and a name in the folder itself."""


def save_result(
    folder: str | os.PathLike[str],
    networks: Mapping[str, Network],
    records: Mapping[str, object],
) -> None:
    """Write networks and records into a new folder, all of it or nothing.

    Parameters
    ----------
    folder : path-like
        That does not exist yet.
    networks : mapping of name to Network
    records : mapping of name to dataclass or None

    Raises
    ------
    OutputError
        If the folder exists or cannot be written, or a record cannot be saved.
    """
    writer = Writer()
    manifest = {
        "format": FORMAT,
        "schema": SCHEMA,
        "networks": list(networks),
        "records": {name: writer.value(record, name) for name, record in records.items()},
    }
    files = {MANIFEST: (json.dumps(manifest, indent=1, allow_nan=False) + "\n").encode()}
    files[ARRAYS] = packed_entries({}, writer.arrays)
    files |= {f"{name}.npz": packed(network) for name, network in networks.items()}
    sums = "".join(f"{_digest(content)}  {name}\n" for name, content in files.items())
    write_folder(folder, {**files, SUMS: sums.encode()})


class SavedResult:
    """What a folder holds; every record is taken once.

    Parameters
    ----------
    table : Table
        The manifest.
    entries : Entries
        The arrays.
    networks : dict of str to Network
    """

    def __init__(self, table: Table, entries: Entries, networks: dict[str, Network]) -> None:
        table.only("format schema networks records")
        self.networks, self._entries = networks, entries
        self._records = dict(table.get("records", dict))

    def network(self, name: str) -> Network:
        """A network by name.

        Raises
        ------
        FileFormatError
            If the folder holds none of that name.
        """
        if name not in self.networks:
            raise FileFormatError(f"manifest.networks: {name!r} is missing; save the result again")
        return self.networks[name]

    def record(self, name: str, hint: Any, network: Network | None = None) -> Any:
        """Take a record.

        Parameters
        ----------
        name : str
        hint : type
            A dataclass, or one that may be None.
        network : Network, optional
            What the record is about.

        Raises
        ------
        FileFormatError, UnknownNameError
            If there is none of that name, or what is there is no such record.
        AnnDcError
            If the record itself refuses what it is given.
        """
        if name not in self._records:
            raise FileFormatError(f"manifest.records: {name!r} is missing; save the result again")
        return Reader(self._entries, network).value(hint, self._records.pop(name), name)

    def finish(self) -> None:
        """Refuse what nobody took.

        Raises
        ------
        FileFormatError
            Naming what is left.
        """
        if self._records:
            raise FileFormatError(f"manifest.records: unknown {', '.join(sorted(self._records))}")
        self._entries.finish()


@contextlib.contextmanager
def opened_result(folder: str | os.PathLike[str]) -> Iterator[SavedResult]:
    """What `save_result` wrote; on leaving, all of it has to be taken.

    Parameters
    ----------
    folder : path-like

    Raises
    ------
    FileFormatError
        If the folder is not one that `save_result` wrote, or is not complete, or what is done
        with its content fails; the message begins with the folder.
    """
    place = Path(folder)
    try:
        files = _files(place)
        table = read_manifest(_taken(files, MANIFEST).decode(), FORMAT, SCHEMA)
        arrays = _taken(files, ARRAYS)
        networks = {
            name: unpacked(_taken(files, f"{name}.npz"), Path(f"{name}.npz"))
            for name in table.names("networks")
        }
        if files:
            raise FileFormatError(f"{SUMS}: names {', '.join(files)}, which the manifest does not")
        with zipfile.ZipFile(io.BytesIO(arrays)) as archive:
            saved = SavedResult(table, NpzEntries(archive, len(arrays)), networks)
            yield saved
            saved.finish()
    except AnnDcError as error:
        raise FileFormatError(f"{place}: {error}") from error
    except BROKEN as error:
        raise FileFormatError(f"{place}: not a complete result ({error}); save it again") from error


def _files(folder: Path) -> dict[str, bytes]:
    """The contents of all files that `SUMS` lists, each what it was when it was saved."""
    if not folder.is_dir():
        reason = "is a file" if folder.exists() else "does not exist"
        raise FileFormatError(f"{reason}; {REMEDY}")
    sums = read_whole(folder / SUMS, LONGEST_SUMS, REMEDY).decode("ascii", "replace")
    files: dict[str, bytes] = {}
    for line in sums.removesuffix("\n").split("\n"):
        found = SUM.fullmatch(line)
        if found is None or found[2] in files:
            raise FileFormatError(f"{SUMS}: {line!r:.120} is no line of it; save the result again")
        largest = MAX_MANIFEST if found[2] == MANIFEST else MAX_BYTES
        content = read_whole(folder / found[2], largest, "save the result again")
        if _digest(content) != found[1]:
            raise FileFormatError(f"{found[2]}: is not what was saved; save the result again")
        files[found[2]] = content
    return files


def _taken(files: dict[str, bytes], name: str) -> bytes:
    if name not in files:
        raise FileFormatError(f"{SUMS}: does not name {name[:60]!r}; save the result again")
    return files.pop(name)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
