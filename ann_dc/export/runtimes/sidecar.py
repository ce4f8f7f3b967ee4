"""Sidecar files of a graph or program: notes on rows and inputs, and test vector."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.export.reference.places import Places
from ann_dc.export.reference.sidecar import file_of, notes_of, vector_of
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.weights.manifest import Table


class Beside(NamedTuple):
    """Content of the sidecar files of a runtime file."""

    vector: ReferenceVector
    """Test vector."""
    notes: Table
    """Notes on the runtime file."""
    places: Places
    """Positions of components in the vector's arrays."""
    inputs: np.ndarray
    """Values of the inputs (I, N), in the order of the notes."""


def notes_on(network: Network, vector: ReferenceVector, content: bytes) -> dict[str, object]:
    """Return the notes common to all runtime files, for the given file content."""
    return {
        "sha256": hashlib.sha256(content).hexdigest(),
        "wiring": vector.wiring,
        "content": vector.content,
        "places": Places.of(network).pairs,
        "inputs": {name: list(network.input_scale(name)) for name in network.cell.inputs},
    }


def read_beside(
    files: Mapping[str, bytes], main: str, notes: str, form: str, schema: int
) -> Beside:
    """Read notes and test vector, and compare the hash of the runtime file.

    The arguments ``main`` and ``notes`` are the names of the file and of its notes. The notes must
    have the format ``form`` with a schema up to ``schema``. Raises `FileFormatError` if a file is
    missing, is invalid, or does not belong to the other files.
    """
    content, vector = file_of(files, main), vector_of(files)
    table = notes_of(files, notes, form, schema)
    if (table.get("wiring", str), table.get("content", str)) != (vector.wiring, vector.content):
        raise FileFormatError(f"{notes}: it is another network's than {VECTOR}")
    if hashlib.sha256(content).hexdigest() != table.get("sha256", str):
        raise FileFormatError(
            f"{main}: its hash is not the one in {notes}, so it is not loaded: whatever reads it "
            "may be harmed by a changed file; export the network again"
        )
    places = Places.read(table.get("places", list), vector.start.shape, f"{notes}.places")
    names = table.get("inputs", dict)
    if names.keys() != vector.inputs.keys():
        raise FileFormatError(f"{notes}.inputs: they are not those of {VECTOR}")
    inputs = np.array([vector.inputs[name] for name in names])
    return Beside(vector, table, places, inputs.reshape(-1, vector.start.shape[1]))
