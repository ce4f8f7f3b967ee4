"""Index of an export: identity of the network and hash of every file."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ann_dc.errors import FileFormatError
from ann_dc.files import read_whole
from ann_dc.network.network import Network
from ann_dc.weights.manifest import Table, read_manifest
from ann_dc.weights.network_file import load

INDEX = "export.json"
"""File name of the index in its folder."""
FORMAT, SCHEMA = "ann_dc export", 1
WEIGHTS = "weights"
"""Format from which a network can be read."""
LARGEST_INDEX = 1_000_000
LARGEST_FILE = 2_000_000_000
"""Largest readable file in bytes."""

_PLAIN = re.compile(r"(?:[\w][\w .+-]*/)?[\w][\w .+-]*")
"""Pattern of a file in the folder or in a direct subfolder, without hidden or parent paths."""


@dataclass(frozen=True, kw_only=True)
class Index:
    """Index of an export folder.

    Attributes
    ----------
    to : str
        Name of the format.
    title : str
        Title of the network.
    version : str
        Version of ann_dc that wrote the folder.
    wiring, content : str
        Hashes of the network.
    settings : mapping of str to value
        Settings of the format.
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
        """Return the index as the content of its file."""
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
    """Compute the SHA-256 of file contents, by file name."""
    return {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}


def read_index(folder: Path) -> Index:
    """Read the index in a folder.

    Raises `FileFormatError` if the index is missing or was not written by `as_json`.
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
    """Check that the file of an index is bit-identical to the output of `as_json`.

    Raises `FileFormatError` otherwise.
    """
    file = folder / INDEX
    if read_whole(file, LARGEST_INDEX, "export the network again") != index.as_json():
        raise FileFormatError(
            f"{file}: not what was written (its own SHA-256 differs); export the network again"
        )


def below(folder: Path, name: str) -> list[Path]:
    """Return the path of a file in a folder, and the folders between them.

    >>> [str(place) for place in below(Path("out"), "library/a.txt")]
    ['out/library/a.txt', 'out/library']
    """
    place = folder / name
    return [place, *place.parents[: len(place.parts) - len(folder.parts) - 1]]


def is_as_written(folder: Path, name: str, digest: str) -> bool:
    """Return True if a file matches its hash in the index and is not a symbolic link."""
    if any(place.is_symlink() for place in below(folder, name)):
        return False
    try:
        content = read_whole(folder / name, LARGEST_FILE, "")
    except FileFormatError:
        return False
    return hashlib.sha256(content).hexdigest() == digest


def read_files(folder: Path, index: Index) -> dict[str, bytes]:
    """Read the files that an index names.

    Raises `FileFormatError` if a file is missing or differs from the index.
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
    """Return the network of an export in the weights format.

    Raises `FileFormatError` if the export has another format or was modified.
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
