"""What stands beside a graph or a program: notes on its rows and inputs, and a reference vector."""

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
    """What was read beside the file of a runtime."""

    vector: ReferenceVector
    """The walk to compare with."""
    notes: Table
    """What the file says of itself."""
    places: Places
    """Where components stand in the vector's arrays."""
    inputs: np.ndarray
    """(I, N): what the inputs hold, in the order of the notes."""


def notes_on(network: Network, vector: ReferenceVector, content: bytes) -> dict[str, object]:
    """What notes say of every file that a runtime reads.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
    content : bytes
        Of the file.
    """
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
    """Read notes and vector, and compare the hash of the file that a runtime reads.

    Parameters
    ----------
    files : mapping of file name to bytes
    main, notes : str
        Names of the file and of its notes.
    form : str
        What the notes have to say that they are.
    schema : int
        The newest version of them that can be read.

    Raises
    ------
    FileFormatError
        If a file is missing, is no such file, or not what the others belong to.
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
