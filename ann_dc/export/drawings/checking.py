"""Strict reader of pictures: only their metadata are used."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NoReturn
from xml.parsers import expat

from ann_dc.errors import FileFormatError
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash, wiring_hash
from ann_dc.weights.manifest import Table, read_manifest

VECTOR = "reference_vector.json"
SCHEMA = 1
LARGEST = 50_000_000
"""Largest file size in bytes."""

ROOT = {
    "xmlns": r"http://www\.w3\.org/2000/svg",
    "xmlns:xlink": r"http://www\.w3\.org/1999/xlink",
    "viewBox": r"[\d. ]+",
    "version": r"1\.1",
}
PLACE = {"x": r"[\d.e-]+", "y": r"[\d.e-]+", "width": r"[\d.]+(?:pt)?", "height": r"[\d.]+(?:pt)?"}
PROPERTY = r"(?:fill|stroke|font|text|opacity)[a-z-]*:[\w\s#.,%'-]*"
LOOK = {
    "style": rf"(?:{PROPERTY};\s*)*(?:{PROPERTY})?",
    "transform": r"[a-z]+\([\d., e-]+\)(?: [a-z]+\([\d., e-]+\))*",
    "id": r"[\w.-]+",
    "clip-path": r"url\(#[\w-]+\)",
}
ELEMENTS = {
    "svg": {**ROOT, **PLACE},
    "metadata": {},
    "defs": {},
    "style": {"type": "text/css"},
    "clipPath": {"id": LOOK["id"]},
    "rect": {**PLACE, **LOOK},
    "path": {"d": r"[MLCQzZ\d.\s e-]*", **LOOK},
    "text": {**PLACE, **LOOK},
    "g": LOOK,
}
"""Permitted SVG elements, with a pattern for the value of each attribute."""
STYLE = re.compile(
    r"(?:@font-face \{font-family: \w+; font-weight: \w+; "
    r"src: url\(data:font/ttf;base64,[A-Za-z0-9+/=]+\);\})*"
    r"(?:\*\{stroke-linejoin: round; stroke-linecap: butt\})?"
)
"""Permitted style: embedded fonts only; nothing is fetched."""
ACTIONS = (
    "JavaScript Launch URI SubmitForm ImportData GoToR GoToE Rendition RichMedia EmbeddedFile XFA "
    "ObjStm Encrypt"
)
ACTION = re.compile(
    "|".join(
        "/" + "".join(f"(?:{letter}|#{ord(letter):02x}|#{ord(letter):02X})" for letter in name)
        for name in ACTIONS.split()
    ).encode()
)
"""PDF entries that trigger actions or hide content; each letter may be written as a number."""


def told_of(network: Network, form: str, what: str) -> dict[str, object]:
    """Return the metadata of a picture of a network."""
    return {
        "format": f"ann_dc {form}",
        "schema": SCHEMA,
        "title": network.title,
        "of": what,
        "wiring": wiring_hash(network),
        "content": content_hash(network),
    }


def read_vector(files: Mapping[str, bytes]) -> ReferenceVector:
    """Read the test vector from the files.

    Raises `FileFormatError` if the vector is missing or a file is too large.
    """
    for name, content in files.items():
        if len(content) > LARGEST:
            raise FileFormatError(f"{name}: {len(content)} bytes are no picture of ours")
    if VECTOR not in files:
        raise FileFormatError(f"{VECTOR}: missing; export the network again")
    return ReferenceVector.from_json(files[VECTOR])


def check_svg(name: str, content: bytes, form: str, vector: ReferenceVector) -> Table:
    """Return the metadata of an SVG file after comparing them with a test vector.

    Raises `FileFormatError` if the file is not well formed, has a document type, is not a picture
    of this format, or belongs to another network.
    """
    table = read_manifest(_metadata(name, content), f"ann_dc {form}", SCHEMA)
    for key, expected in (("wiring", vector.wiring), ("content", vector.content)):
        if table.get(key, str) != expected:
            raise FileFormatError(
                f"{name}: its hash of the {key} is not that of {VECTOR}; export them together"
            )
    return table


def check_pdf(name: str, content: bytes, vector: ReferenceVector) -> None:
    """Compare the metadata of a PDF file with a test vector.

    Raises `FileFormatError` if the file is incomplete, contains an action, or has other hashes.
    """
    whole = content.startswith(b"%PDF-") and content.rstrip().endswith(b"%%EOF")
    if not whole:
        raise FileFormatError(f"{name}: no whole PDF file")
    action = ACTION.search(content)
    if action:
        raise FileFormatError(f"{name}: {action[0].decode()!r} is in no picture of ours")
    if vector.wiring.encode() not in content or vector.content.encode() not in content:
        raise FileFormatError(f"{name}: its hashes are not those of {VECTOR}; export them together")


def _check_element(name: str, tag: str, attributes: Mapping[str, str]) -> None:
    """Reject elements that pictures do not use: scripts, links and external images."""
    if tag not in ELEMENTS:
        raise FileFormatError(f"{name}: <{tag:.40}> is in no picture of ours")
    for key, value in attributes.items():
        wanted = ELEMENTS[tag].get(key)
        if wanted is None or not re.fullmatch(wanted, value):
            raise FileFormatError(f"{name}: {key:.40}={value!r:.60} of <{tag}> is none of ours")


class _Reader:
    """Parser callbacks that process an SVG file element by element."""

    def __init__(self, name: str) -> None:
        self.name, self.path, self.style = name, [], ""
        self.metadata = ""

    def refuse(self, *_: object) -> NoReturn:
        raise FileFormatError(
            f"{self.name}: has a document type, entities or instructions, which are not read"
        )

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if (tag == "svg") == bool(self.path):
            raise FileFormatError(f"{self.name}: {tag!r:.40} is no SVG")
        _check_element(self.name, tag, attributes)
        self.path.append(tag)
        self.style = ""

    def letters(self, text: str) -> None:
        if self.path[-1] == "style":
            self.style += text
        elif self.path[1:] == ["metadata"]:
            self.metadata += text

    def end(self, tag: str) -> None:
        self.path.pop()
        if tag == "style" and not STYLE.fullmatch(self.style.strip()):
            raise FileFormatError(f"{self.name}: has a style that is none of ours")


def _metadata(name: str, content: bytes) -> str:
    """Return the text of the single ``metadata`` element of an SVG file."""
    parser, reader = expat.ParserCreate("utf-8"), _Reader(name)
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = reader.refuse
    parser.ExternalEntityRefHandler = parser.ProcessingInstructionHandler = reader.refuse
    parser.StartElementHandler, parser.EndElementHandler = reader.start, reader.end
    parser.CharacterDataHandler = reader.letters
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise FileFormatError(f"{name}: not well-formed XML: {error}") from error
    return reader.metadata
