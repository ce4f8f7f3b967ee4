"""Sidecar files of an export: test vector, notes, and the network of a table."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.export.reference.contents import file_of, text_of
from ann_dc.export.reference.places import Places
from ann_dc.export.reference.vector import VECTOR, EulerWalk, ReferenceVector, check_states
from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash
from ann_dc.weights.manifest import Table, read_manifest
from ann_dc.weights.network_file import packed, unpacked

MANIFEST = "manifest.json"
NETWORK = "network.npz"
NEAR = 1e-6
"""Tolerance of another machine's end state, relative to the largest state or one."""
SHARE = 0.01
"""Permitted deviation of the number of steps, relative to the vector's steps."""


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


# ---- vector and notes ------------------------------------------------------------------------


def check_vector(network: Network, vector: ReferenceVector) -> None:
    """Raise `ExportError` if a vector belongs to another network."""
    if vector.content != content_hash(network):
        raise ExportError(
            f"vector: it is another network's than {network.title!r:.200}; take "
            "ann_dc.export.reference.reference_vector(network)"
        )


def vector_of(files: Mapping[str, bytes]) -> ReferenceVector:
    """Read the test vector from the files.

    Raises `FileFormatError` if the vector is missing or invalid.
    """
    return ReferenceVector.from_json(file_of(files, VECTOR))


def notes_of(files: Mapping[str, bytes], name: str, form: str, schema: int) -> Table:
    """Read a JSON table; its places in messages begin with the name of the file.

    Raises `FileFormatError` if the file is missing, or not a table of format ``form`` with a schema
    up to ``schema``.
    """
    return read_manifest(text_of(files, name), form, schema, place=name)


# ---- notes on a runtime file -----------------------------------------------------------------


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


# ---- network of a table ----------------------------------------------------------------------


def beside(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    """Return the files of a network and its test vector.

    Raises `ExportError` if the vector belongs to another network.
    """
    check_vector(network, vector)
    return {NETWORK: packed(network), VECTOR: vector.as_json()}


def network_and_vector(files: Mapping[str, bytes]) -> tuple[Network, ReferenceVector]:
    """Read the network and the test vector written by `beside`.

    Raises `FileFormatError` if a file is missing or invalid, or if the two files do not belong
    together.
    """
    vector = vector_of(files)
    network = unpacked(file_of(files, NETWORK), Path(NETWORK))
    if content_hash(network) != vector.content:
        raise FileFormatError(
            f"{NETWORK}: its content is not that of {VECTOR}; one of them was changed: export the "
            "network again"
        )
    return network, vector


def walked(network: Network, files: Mapping[str, bytes]) -> str:
    """Run a loaded network and compare the states with its test vector.

    Returns the number of steps and the deviation as text. Raises `FileFormatError` if the vector
    belongs to another network or the states differ.
    """
    vector = vector_of(files)
    if vector.content != content_hash(network):
        raise FileFormatError(
            f"{VECTOR}: it is another network's; one of the files was changed: export the network "
            "again"
        )
    if vector.start.shape != network.live.shape:
        raise FileFormatError(f"{VECTOR}: its states do not fit the network; export it again")
    walker = EulerWalk(network, vector.step)
    off = vector.check(
        lambda start, count: network.unpack(walker.after(network.pack(start), count))
    )
    _check_end(network, vector, walker)
    return f"{max(vector.early)} steps within {off:.1e} of the reference vector"


def _check_end(network: Network, vector: ReferenceVector, walker: EulerWalk) -> None:
    """Check the number of steps, the end state and the residual against the vector."""
    steps, end, _ = walker.settled(network.pack(vector.start), vector.tolerance)
    if (steps < 0) != (vector.steps < 0) or abs(steps - vector.steps) > 1 + SHARE * vector.steps:
        raise FileFormatError(
            f"{VECTOR}.steps: {vector.steps}, but the network takes {steps}; export it again"
        )
    if vector.settles:
        check_states(network.unpack(end), vector.end, NEAR)
    residual = max(fast_evaluator(network).residuals(network.pack(vector.end)))
    if not np.isclose(residual, vector.residual, rtol=NEAR, atol=1e-3 * vector.tolerance):
        raise FileFormatError(
            f"{VECTOR}.residual: {vector.residual:.3g}, but that of its end is {residual:.3g}; "
            "export the network again"
        )
