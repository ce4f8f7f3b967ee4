"""Comma-separated tables of a network: its weight matrix and all named numbers.

'weights.csv' is the output of `to_csv`, for inspection. 'tensors.csv' has all numbers of the weight
file, one per line: array, shape, index, value. 'manifest.json' describes the arrays.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from typing import final

import numpy as np

from ann_dc.export.reference.contents import text_of
from ann_dc.export.reference.csv_tables import csv_text
from ann_dc.export.reference.sidecar import MANIFEST, check_vector, walked
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked
from ann_dc.weights.entries import NUMBER, Entries, Stored
from ann_dc.weights.matrix import to_csv
from ann_dc.weights.network_file import written
from ann_dc.weights.reading import network_of

MATRIX, TENSORS = "weights.csv", "tensors.csv"
HEAD = ["tensor", "shape", "index", "value"]


@checked
def csv_files(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    """Export a network as comma-separated tables, with manifest and test vector.

    Raises `ExportError` if the vector belongs to another network.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> files = csv_files(network, reference_vector(network))
    >>> sorted(files)
    ['manifest.json', 'reference_vector.json', 'tensors.csv', 'weights.csv']
    >>> files["tensors.csv"].decode().splitlines()[:2]
    ['tensor,shape,index,value', 'limits,9 2,0 0,-inf']
    """
    check_vector(network, vector)
    manifest, arrays = written(network)
    return {
        MATRIX: to_csv(network).encode(),
        TENSORS: _table(arrays).encode(),
        MANIFEST: f"{manifest}\n".encode(),
        VECTOR: vector.as_json(),
    }


@checked
def csv_check(files: Mapping[str, bytes]) -> str:
    """Rebuild a network from its tables, compare hashes and repeat the vector's steps.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing or the network
    differs from its manifest or its test vector.
    """
    entries = _TableEntries(text_of(files, TENSORS))
    network = network_of(text_of(files, MANIFEST), entries)
    return f"{len(entries.taken)} arrays as hashed; {walked(network, files)}"


def _table(arrays: Mapping[str, object]) -> str:
    return csv_text(HEAD, (row for name, given in arrays.items() for row in _rows(name, given)))


def _rows(name: str, given: object) -> Iterator[list[object]]:
    """Yield the lines of an array; an empty array has a line without a value."""
    values = np.array(given, float)
    shape = " ".join(map(str, values.shape))
    for number, value in enumerate(values.ravel().tolist() or [""]):
        yield [name, shape, _place(number, values.shape), value]


def _place(number: int, shape: tuple[int, ...]) -> str:
    """Return the index of the value at a given flat position."""
    index = []
    for length in reversed(shape):
        number, at = divmod(number, max(length, 1))
        index.append(at)
    return " ".join(map(str, reversed(index)))


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
