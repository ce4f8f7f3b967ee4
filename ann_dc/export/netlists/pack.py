"""Self-contained circuit folder: deck, library, BOM, scaling and expected results.

Run ``unzip``, then ``ngspice -b deck.cir``; Python is not needed. A check does not run the content.
It compares the hashes, and every part of the deck with the list of parts.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Mapping
from itertools import zip_longest

from ann_dc.errors import FileFormatError
from ann_dc.export.netlists.build import Build, build
from ann_dc.export.netlists.deck_file import DECK, FOLDER, checked_claims, deck_text, library_of
from ann_dc.export.netlists.flat_reader import flattened
from ann_dc.export.netlists.packages import REAL
from ann_dc.export.netlists.parts import (
    bill_text,
    expected_text,
    parts_of,
    parts_text,
    readme_text,
    scaling_text,
    waveforms_text,
    without_maker,
)
from ann_dc.export.reference.sidecar import check_sums, check_vector, text_of, vector_of, with_sums
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked

ZIP, PARTS = "pack.zip", "parts.csv"
LARGEST, DENSEST = 50_000_000, 50
"""Largest unpacked size in bytes, and largest ratio to the zip file size; exported folders have a
ratio of 5.
"""
ENTRIES = 1000

OPENED = 10
"""Largest ratio of the expanded deck to the list of parts, in characters; exported decks have a
ratio
of 1.
"""

BAD_ZIP = (
    *(zipfile.BadZipFile, zlib.error, struct.error),
    *(EOFError, LookupError, NotImplementedError, OSError, RuntimeError, ValueError),
)
"""Exceptions that reading a damaged zip file may raise."""


@checked
def pack_files(
    network: Network,
    vector: ReferenceVector,
    *,
    level: str = "macro",
    series: str = "exact",
    zipped: bool = False,
) -> dict[str, bytes]:
    """Export a circuit as a folder that ngspice runs without Python.

    The files are 'deck.cir', ``library/*``, 'bill.csv', 'parts.csv', 'scaling.csv',
    'expected_controls.csv', 'expected_waveforms.csv', 'README.md', 'reference_vector.json' and
    ``SHA256SUMS``. Raises `ExportError` with the reason if the network cannot be built at the level
    or is not that of the vector, and `UnknownNameError` for an unknown level or series.

    Parameters
    ----------
    level : str
        ``behavioural``, ``macro``, ``differential``, ``ota-c``, ``switched-capacitor``,
        ``transistor``, or a part set by name.
    series : str
        Series of the resistors in the deck: ``exact``, ``E12``, ``E24``, ``E96``, ``E24-pairs`` or
        ``E96-pairs``.
    zipped : bool
        Return a single file 'pack.zip' with all files, with reproducible bytes.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> files = pack_files(network, reference_vector(network), level="behavioural")
    >>> [name for name in files if name.startswith("library")]  # doctest: +NORMALIZE_WHITESPACE
    ['library/opamp.lib', 'library/switch.lib', 'library/integ.cir', 'library/pi_cell.cir',
     'library/inv.cir']
    """
    check_vector(network, vector)
    files = with_sums(_files(build(network, level, series), vector))
    return {ZIP: _zip(files)} if zipped else files


def _files(made: Build, vector: ReferenceVector) -> dict[str, bytes]:
    deck, library = deck_text(made), library_of(made)
    parts = parts_of(flattened(deck, library), made.level.name)
    texts = {
        DECK: deck,
        **library,
        "bill.csv": bill_text(made, parts),
        PARTS: parts_text(parts),
        "scaling.csv": scaling_text(made),
        "expected_controls.csv": expected_text(made),
        "expected_waveforms.csv": waveforms_text(made),
        "README.md": readme_text(made, parts),
    }
    return {name: text.encode() for name, text in texts.items()} | {VECTOR: vector.as_json()}


def _zip(files: Mapping[str, bytes]) -> bytes:
    """Pack the files into a zip file with reproducible bytes, without time stamps."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, files[name])
    return stream.getvalue()


@checked
def pack_check(files: Mapping[str, bytes]) -> str:
    """Check a circuit folder with a strict reader: hashes and every part of the deck.

    The deck is not run. Returns the result as a sentence. Raises `FileFormatError` if a file is
    missing, changed or unexpected, or the parts of the deck differ from the list.
    """
    inside = _unzipped(files[ZIP]) if set(files) == {ZIP} else dict(files)
    check_sums(inside)
    vector = vector_of(inside)
    claims = checked_claims(DECK, text_of(inside, DECK).splitlines(), vector)
    library = {n: text_of(inside, n) for n in inside if n.startswith(FOLDER + "/")}
    parts = compared_parts(text_of(inside, DECK), library, text_of(inside, PARTS))
    return (
        f"{len(inside) - 1} files with their hashes; {parts}; {claims}; it was not run: "
        f"ngspice -b {DECK} does"
    )


def compared_parts(deck: str, library: Mapping[str, str], listed: str) -> str:
    """Compare the parts of a deck with a list of parts, one by one.

    The deck includes the ``library`` files, and the list is the output of `parts_text`. Returns the
    number of parts, and the parts without a maker if the level is named after parts. Raises
    `FileFormatError` if the parts differ.
    """
    level = _level_of(deck)
    parts = parts_of(flattened(deck, library, OPENED * len(listed)), level)
    found = parts_text(parts)
    if found != listed:
        rows = zip_longest(found.splitlines(), listed.splitlines(), fillvalue="nothing")
        here, there = next((pair for pair in rows if pair[0] != pair[1]), (found, listed))
        raise FileFormatError(f"{PARTS}: says {there[:80]!r}, and the deck {here[:80]!r}")
    unnamed = without_maker(parts, level) if level in REAL else ""
    return f"{len(parts)} parts, each as listed" + f", no part to buy for: {unnamed}" * bool(
        unnamed
    )


def _level_of(deck: str) -> str:
    """Return the level name at the end of a deck's first line."""
    head = deck.partition("\n")[0]
    return head.rpartition("cells, ")[2].removesuffix(" level")


def _unzipped(content: bytes) -> dict[str, bytes]:
    """Unpack a zipped folder, up to the permitted size."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            _check_entries(entries, min(LARGEST, DENSEST * len(content)))
            return {entry.filename: _unpacked(archive, entry) for entry in entries}
    except FileFormatError:
        raise
    except BAD_ZIP as error:
        raise FileFormatError(f"{ZIP}: cannot be read: {error}") from error


def _check_entries(entries: list[zipfile.ZipInfo], most: int) -> None:
    if len(entries) > ENTRIES or sum(entry.file_size for entry in entries) > most:
        raise FileFormatError(f"{ZIP}: unpacks to more than {most} bytes or {ENTRIES} files")
    if len({entry.filename for entry in entries}) < len(entries):
        raise FileFormatError(f"{ZIP}: has a file twice")
    for entry in entries:
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise FileFormatError(f"{ZIP}: {entry.filename!r:.60} is packed in a way of its own")


def _unpacked(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    """Unpack a file up to its declared size and check its checksum."""
    with archive.open(entry) as stream:
        content = stream.read(entry.file_size)
        if len(content) < entry.file_size or stream.read(1):
            raise FileFormatError(f"{ZIP}: {entry.filename!r:.60} has another size than it says")
    return content
