"""Sidecar files of an export: a reference vector, tables of notes, hashes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash
from ann_dc.weights.manifest import Table, read_manifest

SUMS = "SHA256SUMS"


def check_vector(network: Network, vector: ReferenceVector) -> None:
    """Raise `ExportError` if a vector belongs to another network."""
    if vector.content != content_hash(network):
        raise ExportError(
            f"vector: it is another network's than {network.title!r:.200}; take "
            "ann_dc.export.reference.reference_vector(network)"
        )


def file_of(files: Mapping[str, bytes], name: str) -> bytes:
    """Return the content of a file.

    Raises `FileFormatError` if the file does not exist.
    """
    if name not in files:
        raise FileFormatError(f"{name:.80}: missing; export the network again")
    return files[name]


def text_of(files: Mapping[str, bytes], name: str) -> str:
    """Return the text of a file.

    Raises `FileFormatError` if the file does not exist or is not UTF-8.
    """
    try:
        return file_of(files, name).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{name:.80}: not UTF-8 text: {error}") from error


def vector_of(files: Mapping[str, bytes]) -> ReferenceVector:
    """Read the test vector from the files.

    Raises `FileFormatError` if the vector is missing or invalid.
    """
    return ReferenceVector.from_json(file_of(files, VECTOR))


def notes_of(files: Mapping[str, bytes], name: str, form: str, schema: int) -> Table:
    """Read a JSON table; its places in messages begin with the name of the file.

    Raises `FileFormatError` if the file is missing, or not a table of format ``form`` with a schema
    up to ``schema``.
    """
    return read_manifest(text_of(files, name), form, schema, place=name)


def with_sums(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return files with the list of their hashes, in the format of ``sha256sum -c``."""
    sums = "".join(f"{hashlib.sha256(files[n]).hexdigest()}  {n}\n" for n in sorted(files))
    return {**files, SUMS: sums.encode()}


def check_sums(files: Mapping[str, bytes]) -> None:
    """Compare all files with the list of their hashes.

    Raises `FileFormatError` if a file is missing, changed, or not listed.
    """
    lines = [line.partition("  ") for line in text_of(files, SUMS).splitlines()]
    listed = {name: digest for digest, _, name in lines}
    unlisted = sorted(set(files) - set(listed) - {SUMS})
    if unlisted or len(listed) != len(lines):
        raise FileFormatError(f"{SUMS}: does not list {', '.join(unlisted)[:80] or 'a file once'}")
    for name, digest in listed.items():
        if hashlib.sha256(file_of(files, name)).hexdigest() != digest:
            raise FileFormatError(f"{name:.80}: is not what {SUMS} says; export it again")
