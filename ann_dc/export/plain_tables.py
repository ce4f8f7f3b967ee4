"""Comma-separated tables of a network: its weight matrix and all named numbers.

'weights.csv' is the output of `to_csv`, for inspection. 'tensors.csv' has all numbers of the weight
file, one per line: array, shape, index, value. 'manifest.json' describes the arrays.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from typing import final

import numpy as np

from ann_dc.errors import AnnDcError, FileFormatError
from ann_dc.export.plain_sidecar import MANIFEST, walked
from ann_dc.export.reference.sidecar import check_vector, text_of
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
    ['tensor,shape,index,value', 'rails,9 2,0 0,-inf']
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

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing or differs from
    the export.
    """
    entries = _TableEntries(text_of(files, TENSORS))
    try:
        network = network_of(text_of(files, MANIFEST), entries)
    except FileFormatError:
        raise
    except AnnDcError as error:
        raise FileFormatError(f"{MANIFEST}: {error}") from error
    if to_csv(network) != text_of(files, MATRIX):
        raise FileFormatError(f"{MATRIX}: not the weights of {TENSORS}; export the network again")
    return f"{len(entries.taken)} arrays as hashed; {walked(network, files)}"


def _table(arrays: Mapping[str, object]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEAD)
    for name, given in arrays.items():
        values = np.array(given, float)
        shape = " ".join(map(str, values.shape))
        for number, value in enumerate(values.ravel().tolist() or [""]):
            writer.writerow([name, shape, _place(number, values.shape), value])
    return text.getvalue()


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
        self._arrays: dict[str, tuple[tuple[int, ...], list[float]]] = {}
        try:
            head, *lines = csv.reader(io.StringIO(text), strict=True)
            if head != HEAD:
                raise ValueError(f"expected the columns {', '.join(HEAD)}")
            for number, line in enumerate(lines, 2):
                self._take(number, *line)
        except (csv.Error, TypeError, ValueError, OverflowError) as error:
            raise FileFormatError(f"{TENSORS}: {error}; export the network again") from error
        super().__init__(self._arrays)

    def _take(self, number: int, name: str, shape: str, index: str, value: str) -> None:
        lengths = tuple(int(length) for length in shape.split())
        known, values = self._arrays.setdefault(name, (lengths, []))
        number_of_them = math.prod(lengths)
        read = [float(value)] if number_of_them else []
        as_written = [*map(repr, read), ""][0]
        is_next = known == lengths and index == _place(len(values), lengths)
        if not is_next or value != as_written or len(values) >= max(number_of_them, 1):
            raise ValueError(f"line {number} is none that was written")
        values += read

    def stored(self, name: str) -> Stored:
        """Return the array of the given name after checking that all its lines exist."""
        shape, values = self._arrays[name]
        if len(values) != math.prod(shape):
            raise FileFormatError(f"{TENSORS}: {name!r} has {len(values)} values of shape {shape}")
        return Stored(NUMBER, shape, np.array(values, "<f8").tobytes())
