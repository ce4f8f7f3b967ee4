r"""Linear network as a graph of NIR, the neuromorphic intermediate representation.

.. math:: \dot v = r \odot (A v + B u + b)

==================  ===========  ==================================================================
``input``           Input        u (I N,): the values of all inputs, in network units; one unused
                                 number for a network without inputs, since a graph has an input
``input_weights``   Linear       B
``synapses``        Affine       A, b: connections between neurons; Linear if b is zero, for readers
                                 that do not support a bias
``preconditioner``          Linear       M, unless it is diagonal
``neurons``         I            v' = r i, with r = 1 / tau, or one after a preconditioner
``output``          Output       v (n,): the states
==================  ===========  ==================================================================

NIR has no products, functions or saturation limits; networks that need them are rejected. NIR also
has no initial values; these are in the test vector.

References
----------
.. [1] J. E. Pedersen et al., Neuromorphic intermediate representation: a unified instruction set
   for interoperable brain-inspired computing, Nature Communications 15, 2024, 8122.
"""

from __future__ import annotations

import io
import json
import math
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy import sparse

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.reference.contents import package
from ann_dc.export.reference.sidecar import check_vector, notes_on, read_beside
from ann_dc.export.reference.vector import VECTOR, ReferenceVector, check_states, compare
from ann_dc.lowering.program import ONE, UPDATE
from ann_dc.lowering.writing import program_of
from ann_dc.network.cell import Function, Sum
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.validation import checked

FORMAT = "ann_dc NIR graph"
SCHEMA = 1
GRAPH, NOTES = "network.nir", "nir.json"
NEAR = 1e-6
"""Tolerance of the end state, relative to the largest state of the vector's end or one."""
MOST = 5000
"""Maximum number of components, because the matrices of NIR are dense."""

TYPES = {"input_weights": {"Linear"}, "synapses": {"Affine", "Linear"},
         "preconditioner": {"Linear"},
         "neurons": {"I"}, "input": {"Input"}, "output": {"Output"}}  # fmt: skip
_Form: TypeAlias = dict[int, float]
"""Row of [A B b]: columns and values."""
GROUPS = {"node", "node/nodes", *(f"node/nodes/{name}" for name in TYPES)}
EDGES = 8
"""Maximum number of edges of a graph; an exported graph has five to seven."""


@checked
def nir_files(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    """Export a linear network as a graph for `nir.read`.

    Raises `ExportError` if the network is not linear (the message names the nodes), is too large,
    or is not that of the vector, and `ExportPackageMissing` if nir is not installed.
    """
    check_vector(network, vector)
    form = _linear_form(network)
    if network.size > MOST:
        raise ExportError(
            f"{network.title}: {network.size} neurons, and the matrices of NIR are dense; the "
            f"limit is {MOST}: export fewer stages"
        )
    nir, stream = package("nir", "export"), io.BytesIO()
    nir.write(stream, _graph(network, form))
    content = stream.getvalue()
    notes = {
        "format": FORMAT,
        "schema": SCHEMA,
        "states": [network.label(i) for i in range(network.size)],
        **notes_on(network, vector, content),
    }
    return {GRAPH: content, NOTES: (json.dumps(notes) + "\n").encode(), VECTOR: vector.as_json()}


@checked
def nir_check(files: Mapping[str, bytes]) -> str:
    """Read a graph and repeat the steps of the test vector with its node equations.

    A graph whose hash differs from that in ``nir.json`` is not read. Returns the result as a
    sentence. Raises `FileFormatError` if the graph takes different steps.
    """
    vector, _, places, inputs = read_beside(files, GRAPH, NOTES, FORMAT, SCHEMA)
    given = inputs.ravel() if inputs.size else np.zeros(1)
    graph = _read(files[GRAPH], len(places), len(given))
    _check_nodes(graph)

    def walk(start: np.ndarray, count: int) -> np.ndarray:
        v = places.pack(start)
        for _ in range(count):
            v = v + vector.step * _moves(graph, v, given)
        return places.unpack(v, vector.start)

    worst = compare(vector, walk)
    kinds = ", ".join(type(node).__name__ for node in graph.nodes.values())
    reported = (
        f"{kinds}: {max(vector.early)} steps of the graph within {worst:.0e} of the reference"
    )
    if not vector.settles:
        return f"{reported} vector"
    off = check_states(walk(vector.start, vector.steps), vector.end, NEAR)
    return f"{reported} vector, {vector.steps} within {off:.0e} of its end"


def _graph(network: Network, form) -> Any:
    nir, row, n = package("nir", "export"), network.layout, network.size
    linear = nir.Linear(weight=form.states.toarray())
    biased = nir.Affine(weight=linear.weight, bias=form.bias) if form.bias.any() else linear
    nodes: dict[str, Any] = {"synapses": biased}
    edges, last = [("neurons", "synapses")], "neurons"
    rates = row.state_rates
    if network.preconditioner.kind is not PreconditionerKind.DIAGONAL:
        whole = network.preconditioner.factors(row).matrix().toarray()
        nodes["preconditioner"], rates = nir.Linear(weight=whole), np.ones(n)
        last = "preconditioner"
        edges.append(("preconditioner", "neurons"))
    edges.append(("synapses", last))
    fed = form.inputs.toarray() if form.inputs.shape[1] else np.zeros((n, 1))
    nodes["input"] = nir.Input({"input": np.array([fed.shape[1]])})
    nodes["input_weights"] = nir.Linear(weight=fed)
    edges += [("input", "input_weights"), ("input_weights", last)]
    nodes["neurons"] = nir.I(r=rates)
    nodes["output"] = nir.Output({"output": np.array([n])})
    edges.append(("neurons", "output"))
    return nir.NIRGraph(nodes=nodes, edges=edges)


# ---- running ---------------------------------------------------------------------------------


def _moves(graph: Any, v: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Return dv/dt of the graph's integrators, node by node along its edges."""
    into: dict[str, list[str]] = {}
    for source, target in graph.edges:
        into.setdefault(target, []).append(source)

    def says(name: str) -> np.ndarray:
        kind = type(graph.nodes[name]).__name__
        if kind == "I":
            return v
        if kind == "Input":
            return given
        node, arriving = graph.nodes[name], hears(name)
        return node.weight @ arriving + (node.bias if kind == "Affine" else 0.0)

    def hears(name: str) -> np.ndarray:
        return sum((says(source) for source in into.get(name, ())), np.zeros(()))

    return graph.nodes["neurons"].r * hears("neurons")


def _check_nodes(graph: Any) -> None:
    """Check nodes and edges against those that `nir_files` writes."""
    allowed = {
        ("input", "input_weights"), ("input_weights", "neurons"),
        ("input_weights", "preconditioner"),
        ("synapses", "neurons"), ("synapses", "preconditioner"), ("preconditioner", "neurons"),
        ("neurons", "synapses"), ("neurons", "output"),
    }  # fmt: skip
    nodes = graph.nodes
    fits = all(type(node).__name__ in TYPES.get(name, ()) for name, node in nodes.items())
    if not fits or not {"neurons", "synapses"} <= nodes.keys() or not {*graph.edges} <= allowed:
        raise FileFormatError(f"{GRAPH}: its nodes differ from those of an exported network")


class _LinearForm(NamedTuple):
    """Matrices of d = A x + B u + b, with n components and I inputs at N stages."""

    states: sparse.csr_array
    """Matrix A (n, n)."""
    inputs: sparse.csr_array
    """Matrix B (n, I N), ordered by input, then by stage."""
    bias: np.ndarray
    """Vector b (n,)."""


def _linear_form(network: Network) -> _LinearForm:
    """Return the matrices of a network, or raise `ExportError` with the nodes that are not linear.

    Every word of the `Program` is a row of [A B b]; a linear network's program has sums only.
    """
    _check_linear(network)
    # the preconditioner is a matrix of its own
    program = program_of(replace(network, preconditioner=Diagonal()), 1.0)
    inputs = [program.inputs[name] for name in network.cell.inputs]
    given = np.concatenate([program.states, *inputs, [ONE]])
    forms: dict[int, _Form] = {word: {column: 1.0} for column, word in enumerate(given.tolist())}
    for kind, target, a, b, _ in program.operations.tolist():
        if kind != UPDATE:
            edges = zip(program.sources[a:b].tolist(), program.weights[a:b].tolist())
            forms[target] = _summed(forms, edges)
    table, n = _table([forms[word] for word in program.drives.tolist()], len(given)), network.size
    return _LinearForm(table[:, :n], table[:, n:-1], table[:, [-1]].toarray().ravel())


def _check_linear(network: Network) -> None:
    cell = network.cell
    blocks = [
        f"{b.name} ({'function ' + b.function if isinstance(b, Function) else 'product'})"
        for b in cell.blocks
        if not isinstance(b, Sum)
    ]
    limits = [
        f"{n.name} (rails)"
        for n in cell.neurons
        if np.isfinite([n.limiter.low, n.limiter.high]).any()
    ]
    found = blocks + limits
    if found:
        reported = ", ".join(found[:12]) + (
            f" and {len(found) - 12} more" if len(found) > 12 else ""
        )
        raise ExportError(
            f"cell: NIR has linear nodes only, got {reported}; use onnx, torch_program or "
            "verilog_a, or a network without them"
        )


def _summed(forms: Mapping[int, _Form], edges: Iterable[tuple[int, float]]) -> _Form:
    total: _Form = defaultdict(float)
    for word, weight in edges:
        for column, factor in forms[word].items():
            total[column] += weight * factor
    return total


def _table(rows: Sequence[_Form], width: int) -> sparse.csr_array:
    entries = [(k, column, value) for k, row in enumerate(rows) for column, value in row.items()]
    k, column, value = np.array(entries, float).reshape(-1, 3).T
    at = k.astype(np.int64), column.astype(np.int64)
    return sparse.csr_array(sparse.coo_array((value, at), shape=(len(rows), width)))


def _read(content: bytes, size: int, inputs: int) -> Any:
    """Read a NIR file of ``size`` states and ``inputs`` inputs at all stages.

    A dataset of unexpected shape or type, in another file, behind a link, or larger than declared
    when unpacked is invalid, and nothing is read.
    """
    nir, shapes = package("nir", "export"), _shapes(size, inputs)
    import h5py

    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            for path, dataset in _datasets(file):
                _check_dataset(f"{GRAPH}: {path}", dataset, shapes.get(path))
        return nir.read(io.BytesIO(content))
    except FileFormatError:
        raise
    except Exception as error:  # whatever h5py and nir make of another file
        raise FileFormatError(f"{GRAPH}: not a NIR graph: {error}") from error


def _shapes(size: int, inputs: int) -> Mapping[str, tuple[str, tuple[int, ...]]]:
    """Return the kind of values and the shape of every dataset."""
    found: dict[str, tuple[str, tuple[int, ...]]] = {
        "version": ("O", ()),
        "node/type": ("O", ()),
        "node/edges": ("O", (EDGES, 2)),
        "node/nodes/input/shape": ("i", (1,)),
        "node/nodes/output/shape": ("i", (1,)),
        "node/nodes/input_weights/weight": ("f", (size, inputs)),
        "node/nodes/synapses/weight": ("f", (size, size)),
        "node/nodes/synapses/bias": ("f", (size,)),
        "node/nodes/preconditioner/weight": ("f", (size, size)),
        "node/nodes/neurons/r": ("f", (size,)),
    }
    return found | {f"node/nodes/{node}/type": ("O", ()) for node in TYPES}


def _datasets(group: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield all datasets with their paths; links are rejected."""
    import h5py

    for key in group:
        place = f"{path}{key}"
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            raise FileFormatError(f"{GRAPH}: {place:.80} is a link")
        item = group[key]
        if isinstance(item, h5py.Dataset):
            yield place, item
        elif place in GROUPS:
            yield from _datasets(item, f"{place}/")
        else:
            raise FileFormatError(f"{GRAPH}: {place:.80} does not occur in an exported network")


def _check_dataset(place: str, dataset: Any, wanted: tuple[str, tuple[int, ...]] | None) -> None:
    kind, shape = wanted or ("", ())
    fits = dataset.shape == shape
    if place.endswith("edges") and len(dataset.shape) == 2:
        fits = dataset.shape[0] <= EDGES and dataset.shape[1] == 2
    if dataset.dtype.kind != kind or dataset.dtype.itemsize > 8 or not fits:
        raise FileFormatError(
            f"{place:.100}: {dataset.shape} of {dataset.dtype!s:.20} does not fit the network"
        )
    if dataset.is_virtual or dataset.external:
        raise FileFormatError(f"{place:.100}: its numbers are in another file")
    if dataset.id.get_create_plist().get_nfilters() != (dataset.compression == "gzip"):
        raise FileFormatError(f"{place:.100}: has an unsupported compression")
    if dataset.chunks:
        _check_chunks(place, dataset)


def _check_chunks(place: str, dataset: Any) -> None:
    """Raise `FileFormatError` for chunks that unpack to more than their size."""
    whole = math.prod(dataset.chunks) * dataset.dtype.itemsize
    if any(chunk > length for chunk, length in zip(dataset.chunks, dataset.shape)):
        raise FileFormatError(f"{place:.100}: its chunks are larger than the data")
    for number in range(dataset.id.get_num_chunks()):
        _, packed = dataset.id.read_direct_chunk(dataset.id.get_chunk_info(number).chunk_offset)
        if dataset.compression and len(zlib.decompressobj().decompress(packed, whole + 1)) > whole:
            raise FileFormatError(f"{place:.100}: a chunk unpacks to more than its size")
