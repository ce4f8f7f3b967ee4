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
from collections.abc import Mapping
from typing import Any

import numpy as np

from ann_dc.errors import ExportError, ExportPackageMissing, FileFormatError
from ann_dc.export.reference.rounding import compare
from ann_dc.export.reference.sidecar import check_vector, notes_on, read_beside
from ann_dc.export.reference.vector import VECTOR, ReferenceVector, check_states
from ann_dc.export.runtimes.linear_form import linear_form
from ann_dc.export.runtimes.nir_file import check_file
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.validation import checked

FORMAT = "ann_dc NIR graph"
SCHEMA = 1
GRAPH, NOTES = "network.nir", "nir.json"
NEAR = 1e-6
"""Tolerance of the end state, relative to the largest state of the vector's end or one."""
MOST = 5000
"""Maximum number of components, because the matrices of NIR are dense."""


@checked
def nir_files(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    """Export a linear network as a graph for `nir.read`.

    Raises `ExportError` if the network is not linear (the message names the nodes), is too large,
    or is not that of the vector, and `ExportPackageMissing` if nir is not installed.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> sorted(nir_files(network, reference_vector(network)))
    ['network.nir', 'nir.json', 'reference_vector.json']
    """
    check_vector(network, vector)
    form = linear_form(network)
    if network.size > MOST:
        raise ExportError(
            f"{network.title}: {network.size} neurons, and the matrices of NIR are dense; it takes "
            f"up to {MOST}: export fewer stages"
        )
    nir, stream = _nir(), io.BytesIO()
    nir.write(stream, _graph(network, form))
    content = stream.getvalue()
    notes = {
        "format": FORMAT,
        "schema": SCHEMA,
        "states": [network.label(i) for i in range(network.size)],
        **notes_on(network, vector, content),
    }
    return {
        GRAPH: content,
        NOTES: (json.dumps(notes) + "\n").encode(),
        VECTOR: vector.as_json(),
    }


@checked
def nir_check(files: Mapping[str, bytes]) -> str:
    """Read a graph and repeat the steps of the test vector with its node equations.

    A graph whose hash differs from that in ``nir.json`` is not read. Returns the result as a
    sentence. Raises `FileFormatError` if a file is missing or changed, or the graph takes different
    steps, and `ExportPackageMissing` if nir is not installed.
    """
    vector, _, places, inputs = read_beside(files, GRAPH, NOTES, FORMAT, SCHEMA)
    given = inputs.ravel() if inputs.size else np.zeros(1)
    check_file(GRAPH, files[GRAPH], len(places), len(given))
    graph = _read(files[GRAPH])
    _check_nodes(graph, len(places), len(given))

    def walk(start: np.ndarray, count: int) -> np.ndarray:
        v = places.pack(start)
        for _ in range(count):
            v = v + vector.step * _moves(graph, v, given)
        return places.unpack(v, vector.start)

    worst = compare(vector, walk)
    kinds = ", ".join(type(node).__name__ for node in graph.nodes.values())
    told = f"{kinds}: {max(vector.early)} steps of the graph within {worst:.0e} of the reference"
    if not vector.settles:
        return f"{told} vector"
    off = check_states(walk(vector.start, vector.steps), vector.end, NEAR)
    return f"{told} vector, {vector.steps} within {off:.0e} of its end"


def _graph(network: Network, form) -> Any:
    nir, row, n = _nir(), network.layout, network.size
    linear = nir.Linear(weight=form.states.toarray())
    biased = nir.Affine(weight=linear.weight, bias=form.bias) if form.bias.any() else linear
    nodes: dict[str, Any] = {"synapses": biased}
    edges, last = [("neurons", "synapses")], "neurons"
    rates = row.state_rates
    if network.preconditioner.kind is not PreconditionerKind.DIAGONAL:
        whole = network.preconditioner.factors(row).matrix().toarray()
        nodes["preconditioner"], rates, last = (
            nir.Linear(weight=whole),
            np.ones(n),
            "preconditioner",
        )
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


TYPES = {"input_weights": {"Linear"}, "synapses": {"Affine", "Linear"},
         "preconditioner": {"Linear"},
         "neurons": {"I"}, "input": {"Input"}, "output": {"Output"}}  # fmt: skip


def _check_nodes(graph: Any, size: int, inputs: int) -> None:
    """Check nodes, edges and matrix sizes against those that `nir_files` writes."""
    columns = {"input_weights": inputs, "synapses": size, "preconditioner": size}
    allowed = {
        ("input", "input_weights"), ("input_weights", "neurons"),
        ("input_weights", "preconditioner"),
        ("synapses", "neurons"), ("synapses", "preconditioner"), ("preconditioner", "neurons"),
        ("neurons", "synapses"), ("neurons", "output"),
    }  # fmt: skip
    nodes = graph.nodes
    fits = all(type(node).__name__ in TYPES.get(name, ()) for name, node in nodes.items())
    if not fits or not {"neurons", "synapses"} <= nodes.keys() or not {*graph.edges} <= allowed:
        raise FileFormatError(f"{GRAPH}: its nodes are not those of an exported network")
    shapes = {name: (size, columns[name]) for name in columns.keys() & nodes.keys()}
    wrong = [name for name, shape in shapes.items() if nodes[name].weight.shape != shape]
    bias = getattr(nodes["synapses"], "bias", np.zeros(size))
    if wrong or nodes["neurons"].r.shape != (size,) or bias.shape != (size,):
        raise FileFormatError(f"{GRAPH}: a matrix does not fit {size} neurons, {inputs} inputs")


def _read(content: bytes) -> Any:
    nir = _nir()
    try:
        return nir.read(io.BytesIO(content))
    except Exception as error:  # whatever h5py and nir make of another file
        raise FileFormatError(f"{GRAPH}: no NIR graph: {error}") from error


def _nir() -> Any:
    try:
        import nir
    except ImportError as error:
        raise ExportPackageMissing(
            f"{error.name or 'nir'} is not installed; install it with: pip install 'ann-dc[export]'"
        ) from error
    return nir
