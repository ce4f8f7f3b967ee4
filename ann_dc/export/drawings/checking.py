"""Pictures read with distrust: what they tell of themselves, and nothing else of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn
from xml.parsers import expat

from ann_dc.errors import FileFormatError
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.export.weights.hashes import content_hash, wiring_hash
from ann_dc.export.weights.manifest import Table, read_manifest
from ann_dc.network.network import Network

VECTOR = "reference_vector.json"
SCHEMA = 1
LARGEST = 50_000_000
"""Bytes of a file at most."""


def told_of(network: Network, form: str, what: str) -> dict[str, object]:
    """What a picture of a ``network`` tells of itself."""
    return {
        "format": f"ann_dc {form}",
        "schema": SCHEMA,
        "title": network.title,
        "of": what,
        "wiring": wiring_hash(network),
        "content": content_hash(network),
    }


def read_vector(files: Mapping[str, bytes]) -> ReferenceVector:
    """The reference vector among ``files``.

    Raises
    ------
    FileFormatError
        If there is none, or a file is too large.
    """
    for name, content in files.items():
        if len(content) > LARGEST:
            raise FileFormatError(f"{name}: {len(content)} bytes are no picture of ours")
    if VECTOR not in files:
        raise FileFormatError(f"{VECTOR}: missing; export the network again")
    return ReferenceVector.from_json(files[VECTOR])


def check_svg(name: str, content: bytes, form: str, vector: ReferenceVector) -> Table:
    """What an SVG file tells of itself, after it was compared with a reference vector.

    Raises
    ------
    FileFormatError
        If it is not well formed, has a document type, is no such picture, or one of another
        network.
    """
    table = read_manifest(_metadata(name, content), f"ann_dc {form}", SCHEMA)
    for key, expected in (("wiring", vector.wiring), ("content", vector.content)):
        if table.get(key, str) != expected:
            raise FileFormatError(
                f"{name}: its hash of the {key} is not that of {VECTOR}; export them together"
            )
    return table


def check_pdf(name: str, content: bytes, vector: ReferenceVector) -> None:
    """Compare what a PDF file says of itself with a reference vector.

    Raises
    ------
    FileFormatError
    """
    whole = content.startswith(b"%PDF-") and content.rstrip().endswith(b"%%EOF")
    if not whole:
        raise FileFormatError(f"{name}: no whole PDF file")
    if vector.wiring.encode() not in content or vector.content.encode() not in content:
        raise FileFormatError(f"{name}: its hashes are not those of {VECTOR}; export them together")


def _metadata(name: str, content: bytes) -> str:
    """The text of the one ``metadata`` element of an SVG file."""
    parser, path, found = expat.ParserCreate("utf-8"), [], []

    def refuse(*_: object) -> NoReturn:
        raise FileFormatError(f"{name}: has a document type or entities, which are not read")

    def start(tag: str, _: dict) -> None:
        if not path and tag != "svg":
            raise FileFormatError(f"{name}: {tag!r:.40} is no SVG")
        path.append(tag)

    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.ExternalEntityRefHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: path.pop()
    parser.CharacterDataHandler = lambda s: found.append(s) if path[1:] == ["metadata"] else None
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise FileFormatError(f"{name}: not well-formed XML: {error}") from error
    return "".join(found)
