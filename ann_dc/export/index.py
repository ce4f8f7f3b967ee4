"""Index of an export: identity of the network and hash of every file."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
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

    ``to`` is the name of the format, ``title``, ``wiring`` and ``content`` are those of the
    network, ``version`` is that of the ann_dc that wrote the folder, and ``files`` are the SHA-256
    of every other file.
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
        table = {"format": FORMAT, "schema": SCHEMA, **asdict(self)}
        table["sha256"] = hashlib.sha256(json.dumps(table).encode()).hexdigest()
        return (json.dumps(table, indent=1) + "\n").encode()


def hashes_of(files: Mapping[str, bytes]) -> dict[str, str]:
    """Compute the SHA-256 of file contents, by file name."""
    return {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}


def read_index(folder: Path) -> Index:
    """Read the index in a folder, or raise `FileFormatError`."""
    file = folder / INDEX
    content = read_whole(file, LARGEST_INDEX, "use a folder that ann-dc export wrote")
    try:
        table = read_manifest(content.decode("utf-8"), FORMAT, SCHEMA)
        return _index_of(table)
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{file}: not UTF-8 text: {error}") from error
    except FileFormatError as error:
        raise FileFormatError(f"{file}: {error}") from error


def _index_of(table: Table) -> Index:
    table.only("format schema to title version wiring content settings files sha256")
    files = table.texts("files")
    for name in files:
        if not _PLAIN.fullmatch(name) or name == INDEX:
            raise FileFormatError(
                f"manifest.files: {name!r:.60} is not the name of a file in the folder"
            )
    texts = {key: table.get(key, str) for key in ("to", "title", "version", "wiring", "content")}
    return Index(**texts, settings=table.get("settings", dict), files=files)


def check_index(folder: Path, index: Index) -> None:
    """Raise `FileFormatError` if the file of an index differs from the output of `as_json`."""
    file = folder / INDEX
    if read_whole(file, LARGEST_INDEX, "export the network again") != index.as_json():
        raise FileFormatError(
            f"{file}: changed after it was written (SHA-256 of the index differs); export the "
            "network again"
        )


def below(folder: Path, name: str) -> list[Path]:
    """Return the path of a file in a folder, and the folders between them."""
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
    """Read the files that an index names, or raise `FileFormatError` if one differs from it."""
    found = {}
    for name, expected in index.files.items():
        found[name] = read_whole(folder / name, LARGEST_FILE, "export the network again")
        if hashlib.sha256(found[name]).hexdigest() != expected:
            raise FileFormatError(
                f"{folder / name}: differs from the written file (SHA-256): changed later, or "
                "left by an interrupted export; export the network again"
            )
    return found


def exported_network(folder: Path) -> Network:
    """Return the network of an export in the weights format, or raise `FileFormatError`."""
    index = read_index(folder)
    if index.to != WEIGHTS:
        raise FileFormatError(
            f"{str(folder)!r} is an export to {index.to!r:.40}, which contains no network to be "
            "read; use the folder of an export to 'weights', a weight file, or the problem"
        )
    check_index(folder, index)
    name = next((name for name in read_files(folder, index) if name.startswith("network.")), "")
    return load(folder / name)
