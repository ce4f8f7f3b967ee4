"""The index of an export: whose network it is, and what each of its files has to be."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ann_dc.atomic_files import read_whole
from ann_dc.errors import FileFormatError
from ann_dc.network.network import Network
from ann_dc.weights.manifest import Table, read_manifest
from ann_dc.weights.network_file import load

INDEX = "export.json"
"""Its name, in the folder that it describes."""
FORMAT, SCHEMA = "ann_dc export", 1
WEIGHTS = "weights"
"""Format from which a network can be read."""
LARGEST_INDEX = 1_000_000
LARGEST_FILE = 2_000_000_000
"""Bytes of what is read."""

_PLAIN = re.compile(r"(?:[\w][\w .+-]*/)?[\w][\w .+-]*")
"""A file, or one in a folder beside it: nothing hidden, nothing above."""


@dataclass(frozen=True, kw_only=True)
class Index:
    """What a folder says of itself.

    Attributes
    ----------
    to : str
        Name of the format.
    title : str
        Of the network.
    version : str
        Of the ann_dc that wrote it.
    wiring, content : str
        Hashes of the network.
    settings : mapping of str to value
        Of the format.
    files : mapping of str to str
        SHA-256 of every other file, by its name.
    """

    to: str
    title: str
    version: str
    wiring: str
    content: str
    settings: Mapping[str, Any]
    files: Mapping[str, str]

    def as_json(self) -> bytes:
        """The index as a file.

        Returns
        -------
        bytes
        """
        table = {
            "format": FORMAT,
            "schema": SCHEMA,
            "to": self.to,
            "title": self.title,
            "version": self.version,
            "wiring": self.wiring,
            "content": self.content,
            "settings": dict(self.settings),
            "files": dict(self.files),
        }
        table["sha256"] = hashlib.sha256(json.dumps(table).encode()).hexdigest()
        return (json.dumps(table, indent=1) + "\n").encode()


def hashes_of(files: Mapping[str, bytes]) -> dict[str, str]:
    """SHA-256 of contents, by the name of the file."""
    return {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}


def read_index(folder: Path) -> Index:
    """The index in a folder.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    FileFormatError
        If there is none, or it is not one that `as_json` wrote.
    """
    file = folder / INDEX
    content = read_whole(file, LARGEST_INDEX, "give a folder that ann-dc export wrote")
    try:
        table = read_manifest(content.decode("utf-8"), FORMAT, SCHEMA)
        return _index_of(table)
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{file}: not UTF-8 text: {error}") from error
    except FileFormatError as error:
        raise FileFormatError(f"{file}: {error}") from error


def _index_of(table: Table) -> Index:
    table.only("format schema to title version wiring content settings files sha256")
    named = table.get("files", dict)
    files = Table("manifest.files", named)
    for name in named:
        if not _PLAIN.fullmatch(name) or name == INDEX:
            raise FileFormatError(
                f"manifest.files: {name!r:.60} is no name of a file in the folder"
            )
    return Index(
        to=table.get("to", str),
        title=table.get("title", str),
        version=table.get("version", str),
        wiring=table.get("wiring", str),
        content=table.get("content", str),
        settings=table.get("settings", dict),
        files={name: files.get(name, str) for name in named},
    )


def check_index(folder: Path, index: Index) -> None:
    """See that an index is to the last bit what `as_json` wrote.

    Parameters
    ----------
    folder : Path
    index : Index
        That was read there.

    Raises
    ------
    FileFormatError
        If it is not.
    """
    file = folder / INDEX
    if read_whole(file, LARGEST_INDEX, "export the network again") != index.as_json():
        raise FileFormatError(
            f"{file}: not what was written (its own SHA-256 differs); export the network again"
        )


def below(folder: Path, name: str) -> list[Path]:
    """A file in a folder, and the folders between them.

    >>> [str(place) for place in below(Path("out"), "library/a.txt")]
    ['out/library/a.txt', 'out/library']
    """
    place = folder / name
    return [place, *place.parents[: len(place.parts) - len(folder.parts) - 1]]


def is_as_written(folder: Path, name: str, digest: str) -> bool:
    """Whether a file in a folder is still what an index says, and no link to another place."""
    if any(place.is_symlink() for place in below(folder, name)):
        return False
    try:
        content = read_whole(folder / name, LARGEST_FILE, "")
    except FileFormatError:
        return False
    return hashlib.sha256(content).hexdigest() == digest


def read_files(folder: Path, index: Index) -> dict[str, bytes]:
    """The files that an index names, each as it was written.

    Parameters
    ----------
    folder : Path
    index : Index

    Raises
    ------
    FileFormatError
        If one is missing, or another than was written.
    """
    found = {}
    for name, expected in index.files.items():
        found[name] = read_whole(folder / name, LARGEST_FILE, "export the network again")
        if hashlib.sha256(found[name]).hexdigest() != expected:
            raise FileFormatError(
                f"{folder / name}: not what was written (its SHA-256 differs): changed since, or "
                "left by an export that was interrupted; export the network again"
            )
    return found


def exported_network(folder: Path) -> Network:
    """The network of an export to weights.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    FileFormatError
        If it is an export to another format, or not what was written.
    """
    index = read_index(folder)
    if index.to != WEIGHTS:
        raise FileFormatError(
            f"{str(folder)!r} is an export to {index.to!r:.40}, from which no network is read; "
            "give the folder of an export to 'weights', a weight file, or the problem"
        )
    check_index(folder, index)
    name = next((name for name in read_files(folder, index) if name.startswith("network.")), "")
    return load(folder / name)
