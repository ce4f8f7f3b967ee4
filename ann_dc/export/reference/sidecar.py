"""Sidecar files of an export: test vector, notes, and the network of a table."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.export.reference.contents import file_of, text_of
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


class Places:
    """Pairs (neuron, stage) of every component: one, or all stages of a shared neuron."""

    def __init__(self, pairs: Sequence[Sequence[Sequence[int]]]) -> None:
        self.pairs = pairs
        self._component = np.repeat(np.arange(len(pairs)), [len(p) for p in pairs])
        self._rows, self._stages = np.array([pair for p in pairs for pair in p]).reshape(-1, 2).T
        self._homes = np.array([p[-1] for p in pairs]).reshape(-1, 2).T

    def __len__(self) -> int:
        return len(self.pairs)

    @classmethod
    def of(cls, network: Network) -> Places:
        """Return the positions for the components of a network."""
        shared, stages = set(network.shared.tolist()), range(network.stages)
        return cls([
            [[row, k] for k in stages] if row in shared else [[row, stage]]
            for row, stage in network.places.tolist()
        ])  # fmt: skip

    @classmethod
    def read(cls, given: Any, shape: tuple[int, ...], where: str) -> Places:
        """Parse a JSON list, for arrays of a shape; `FileFormatError` begins with ``where``."""
        if not isinstance(given, list) or not given:
            raise FileFormatError(f"{where}: expected a list of places")
        for pairs in given:
            if not isinstance(pairs, list) or not pairs or not all(_fits(p, shape) for p in pairs):
                raise FileFormatError(f"{where}: expected places in arrays of shape {shape}")
        return cls(given)

    def pack(self, states: np.ndarray) -> np.ndarray:
        """Return state vectors (..., n) from states (..., P, N)."""
        return states[(..., *self._homes)]

    def unpack(self, x: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the states (P, N) with the components of a state vector (n,) inserted."""
        states = np.array(states)
        states[self._rows, self._stages] = x[self._component]
        return states


def _fits(pair: Any, shape: tuple[int, ...]) -> bool:
    whole = isinstance(pair, list) and len(pair) == 2 and all(type(k) is int for k in pair)
    return whole and all(0 <= k < size for k, size in zip(pair, shape))


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
            f"vector: belongs to another network than {network.title!r:.200}; use "
            "ann_dc.export.reference.reference_vector(network)"
        )


def vector_of(files: Mapping[str, bytes]) -> ReferenceVector:
    """Read the test vector from the files."""
    return ReferenceVector.from_json(file_of(files, VECTOR))


def notes_of(files: Mapping[str, bytes], name: str, form: str, schema: int) -> Table:
    """Read a JSON table of a format and schema; messages begin with the name of its file."""
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
    """Read the test vector and the notes on the file ``main``, and compare the hash of the file.

    Raises `FileFormatError` if a file is missing, invalid, or does not belong to the other files.
    """
    content, vector = file_of(files, main), vector_of(files)
    table = notes_of(files, notes, form, schema)
    if (table.get("wiring", str), table.get("content", str)) != (vector.wiring, vector.content):
        raise FileFormatError(f"{notes}: belongs to another network than {VECTOR}")
    if hashlib.sha256(content).hexdigest() != table.get("sha256", str):
        raise FileFormatError(
            f"{main}: its hash is not the one in {notes}, so it is not loaded, because a "
            "changed file may be unsafe; export the network again"
        )
    places = Places.read(table.get("places", list), vector.start.shape, f"{notes}.places")
    names = table.get("inputs", dict)
    if names.keys() != vector.inputs.keys():
        raise FileFormatError(f"{notes}.inputs: they are not those of {VECTOR}")
    inputs = np.array([vector.inputs[name] for name in names])
    return Beside(vector, table, places, inputs.reshape(-1, vector.start.shape[1]))


# ---- network of a table ----------------------------------------------------------------------


def beside(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    """Return the files of a network and its test vector."""
    check_vector(network, vector)
    return {NETWORK: packed(network), VECTOR: vector.as_json()}


def network_and_vector(files: Mapping[str, bytes]) -> tuple[Network, ReferenceVector]:
    """Read the network and the test vector written by `beside`.

    Raises `FileFormatError` if the two files are invalid or do not belong together.
    """
    vector = vector_of(files)
    network = unpacked(file_of(files, NETWORK), Path(NETWORK))
    if content_hash(network) != vector.content:
        raise FileFormatError(
            f"{NETWORK}: its content differs from {VECTOR}; export the network again"
        )
    return network, vector


def walked(network: Network, files: Mapping[str, bytes]) -> str:
    """Run a loaded network and return its deviation from the test vector as text.

    Raises `FileFormatError` if the vector belongs to another network or the states differ.
    """
    vector = vector_of(files)
    if vector.content != content_hash(network):
        raise FileFormatError(f"{VECTOR}: belongs to another network; export the network again")
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
