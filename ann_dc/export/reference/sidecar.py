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
    """Refuse a vector that is another network's.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector

    Raises
    ------
    ExportError
    """
    if vector.content != content_hash(network):
        raise ExportError(
            f"vector: it is another network's than {network.title!r:.200}; take "
            "ann_dc.export.reference.reference_vector(network)"
        )


def file_of(files: Mapping[str, bytes], name: str) -> bytes:
    """The content of a file.

    Parameters
    ----------
    files : mapping of file name to bytes
    name : str

    Raises
    ------
    FileFormatError
        If there is none of that name.
    """
    if name not in files:
        raise FileFormatError(f"{name:.80}: missing; export the network again")
    return files[name]


def text_of(files: Mapping[str, bytes], name: str) -> str:
    """The text of a file.

    Parameters
    ----------
    files : mapping of file name to bytes
    name : str

    Raises
    ------
    FileFormatError
        If there is none of that name, or it is not UTF-8.
    """
    try:
        return file_of(files, name).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{name:.80}: not UTF-8 text: {error}") from error


def vector_of(files: Mapping[str, bytes]) -> ReferenceVector:
    """The reference vector among files.

    Parameters
    ----------
    files : mapping of file name to bytes

    Raises
    ------
    FileFormatError
        If there is none, or it is no vector.
    """
    return ReferenceVector.from_json(file_of(files, VECTOR))


def notes_of(files: Mapping[str, bytes], name: str, form: str, schema: int) -> Table:
    """The JSON table in a file, whose places begin with the file's name.

    Parameters
    ----------
    files : mapping of file name to bytes
    name : str
    form : str
        What it has to say that it is.
    schema : int
        The newest version of it that can be read.

    Raises
    ------
    FileFormatError
        If there is none of that name, or it is no such table.
    """
    return read_manifest(text_of(files, name), form, schema, place=name)


def with_sums(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Files with the list of their hashes, as ``sha256sum -c`` reads it.

    Parameters
    ----------
    files : mapping of file name to bytes
        Without a list.
    """
    sums = "".join(f"{hashlib.sha256(files[n]).hexdigest()}  {n}\n" for n in sorted(files))
    return {**files, SUMS: sums.encode()}


def check_sums(files: Mapping[str, bytes]) -> None:
    """Compare all files with the list of their hashes.

    Parameters
    ----------
    files : mapping of file name to bytes

    Raises
    ------
    FileFormatError
        If one is missing, changed, or not listed.
    """
    lines = [line.partition("  ") for line in text_of(files, SUMS).splitlines()]
    listed = {name: digest for digest, _, name in lines}
    unlisted = sorted(set(files) - set(listed) - {SUMS})
    if unlisted or len(listed) != len(lines):
        raise FileFormatError(f"{SUMS}: does not list {', '.join(unlisted)[:80] or 'a file once'}")
    for name, digest in listed.items():
        if hashlib.sha256(file_of(files, name)).hexdigest() != digest:
            raise FileFormatError(f"{name:.80}: is not what {SUMS} says; export it again")
