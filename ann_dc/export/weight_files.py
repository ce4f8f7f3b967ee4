"""Weight file with its manifest, and the same numbers as comma-separated tables.

'weights.csv' is the output of `to_csv`, for inspection. 'tensors.csv' has all numbers of the weight
file, one per line: array, shape, index, value. 'manifest.json' describes the arrays.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import final

import numpy as np

from ann_dc.errors import FileFormatError, UnknownNameError
from ann_dc.export.reference.contents import csv_text, file_of, text_of
from ann_dc.export.reference.sidecar import MANIFEST, check_vector, walked
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked
from ann_dc.weights.entries import NUMBER, Entries, Stored
from ann_dc.weights.hashes import check_hashes
from ann_dc.weights.manifest import read_manifest
from ann_dc.weights.matrix import to_csv
from ann_dc.weights.network_file import packed, unpacked, written
from ann_dc.weights.reading import network_of
from ann_dc.weights.writing import arrays_of

FORMS = {"safetensors": "network.safetensors", "npz": "network.npz"}
"""Names of the weight file."""


MATRIX, TENSORS = "weights.csv", "tensors.csv"
HEAD = ["tensor", "shape", "index", "value"]


@checked
def weights_files(
    network: Network, vector: ReferenceVector, *, form: str = "safetensors"
) -> dict[str, bytes]:
    """Export the file that `save` writes, its manifest as text, and the test vector.

    The ``form`` is ``safetensors`` or ``npz``. Raises `UnknownNameError` for another form,
    `ExportError` if the vector belongs to another network, and `OutputError` if a node has a name
    that a file cannot have.
    """
    if form not in FORMS:
        raise UnknownNameError.of("form", form, FORMS)
    check_vector(network, vector)
    manifest, _ = written(network)
    return {
        FORMS[form]: packed(network, f".{form}"),
        MANIFEST: f"{manifest}\n".encode(),
        VECTOR: vector.as_json(),
    }


@checked
def weights_check(files: Mapping[str, bytes]) -> str:
    """Read a weight file, compare its manifest, and return the steps of the vector as a sentence.

    Raises `FileFormatError` if a file is missing or differs from the export.
    """
    there = [name for name in FORMS.values() if name in files]
    if len(there) != 1:
        raise FileFormatError(
            f"expected one of {', '.join(FORMS.values())}, got {' and '.join(there) or 'none'}; "
            "export the network again"
        )
    network = unpacked(file_of(files, there[0]), Path(there[0]))
    arrays = arrays_of(network)
    check_hashes(read_manifest(text_of(files, MANIFEST)), arrays)
    return f"{there[0]}: {len(arrays)} arrays as hashed; {walked(network, files)}"


@checked
def csv_files(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    """Export a network as comma-separated tables, with manifest and test vector.

    Raises `ExportError` if the vector belongs to another network.
    """
    check_vector(network, vector)
    manifest, arrays = written(network)
    return {
        MATRIX: to_csv(network).encode(),
        TENSORS: csv_text(HEAD, _rows(arrays)).encode(),
        MANIFEST: f"{manifest}\n".encode(),
        VECTOR: vector.as_json(),
    }


@checked
def csv_check(files: Mapping[str, bytes]) -> str:
    """Rebuild a network from its tables and return the steps of the vector as a sentence."""
    entries = _TableEntries(text_of(files, TENSORS))
    network = network_of(text_of(files, MANIFEST), entries)
    return f"{len(entries.taken)} arrays as hashed; {walked(network, files)}"


def _rows(arrays: Mapping[str, object]) -> Iterator[list[object]]:
    """Yield the lines of all arrays; an empty array has a line without a value."""
    for name, given in arrays.items():
        values = np.array(given, float)
        shape = _words(values.shape)
        for index, value in zip(np.ndindex(values.shape), values.ravel().tolist()):
            yield [name, shape, _words(index), value]
        if not values.size:
            yield [name, shape, _words([0] * values.ndim), ""]


def _words(numbers: Iterable[int]) -> str:
    return " ".join(map(str, numbers))


@final
class _TableEntries(Entries):
    """Arrays of a table; the lines of each array are in the order of their indices."""

    def __init__(self, text: str) -> None:
        self._arrays: dict[str, tuple[str, list[float]]] = {}
        for line in csv.DictReader(io.StringIO(text), strict=True):
            _, values = self._arrays.setdefault(line["tensor"], (line["shape"], []))
            if line["value"]:
                values.append(float(line["value"]))
        super().__init__(self._arrays)

    def stored(self, name: str) -> Stored:
        """Return the array of the given name."""
        lengths, values = self._arrays[name]
        shape = tuple(map(int, lengths.split()))
        return Stored(NUMBER, shape, np.array(values, "<f8").reshape(shape).tobytes())
