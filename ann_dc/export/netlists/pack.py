"""Self-contained circuit folder: deck, library, BOM, scaling and expected results.

Run ``unzip``, then ``ngspice -b deck.cir``; Python is not needed. A check compares the hashes and
does not run the deck.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

from ann_dc.export.netlists.build import Build, build
from ann_dc.export.netlists.deck_file import DECK, deck_text, library_of
from ann_dc.export.netlists.flat_reader import flattened
from ann_dc.export.netlists.parts import (
    bill_text,
    expected_text,
    parts_of,
    parts_text,
    readme_text,
    scaling_text,
    waveforms_text,
)
from ann_dc.export.reference.contents import README, stated, with_sums
from ann_dc.export.reference.sidecar import check_vector
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked

ZIP, PARTS = "pack.zip", "parts.csv"
LONGEST_README = 100_000
"""Largest number of bytes that are read of a zipped README."""


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
        README: readme_text(made, parts),
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


def stated_in_pack(files: Mapping[str, bytes]) -> str:
    """Return the statements of a README, which a zipped folder contains."""
    if ZIP not in files:
        return stated(files)
    with zipfile.ZipFile(io.BytesIO(files[ZIP])) as archive, archive.open(README) as stream:
        return stated({README: stream.read(LONGEST_README)})
