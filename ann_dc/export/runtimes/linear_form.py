r"""Linear network as matrices from states and inputs to net inputs.

.. math:: d = A x + B u + b, \qquad \dot x = M d ,

with u the values of the inputs at all stages, in network units. Every word of the `Program` is
represented by a row of [A B b]; the program of a linear network has sums only.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy import sparse

from ann_dc.errors import ExportError
from ann_dc.lowering.program import ONE, UPDATE
from ann_dc.lowering.writing import program_of
from ann_dc.network.cell import Function, Sum
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.diagonal import Diagonal

Form: TypeAlias = dict[int, float]
"""Row of [A B b]: columns and values."""


class LinearForm(NamedTuple):
    """Matrices of d = A x + B u + b, with n components and I inputs at N stages."""

    states: sparse.csr_array
    """Matrix A (n, n)."""
    inputs: sparse.csr_array
    """Matrix B (n, I N), ordered by input, then by stage."""
    bias: np.ndarray
    """Vector b (n,)."""


def linear_form(network: Network) -> LinearForm:
    """Return the matrices of a network.

    Raises `ExportError`, which names the nodes, if the network is not linear.
    """
    _check_linear(network)
    # the preconditioner is a matrix of its own
    program = program_of(replace(network, preconditioner=Diagonal()), 1.0)
    inputs = [program.inputs[name] for name in network.cell.inputs]
    given = np.concatenate([program.states, *inputs, [ONE]])
    forms: dict[int, Form] = {word: {column: 1.0} for column, word in enumerate(given.tolist())}
    for kind, target, a, b, _ in program.operations.tolist():
        if kind != UPDATE:
            edges = zip(program.sources[a:b].tolist(), program.weights[a:b].tolist())
            forms[target] = _summed(forms, edges)
    table, n = _table([forms[word] for word in program.drives.tolist()], len(given)), network.size
    return LinearForm(table[:, :n], table[:, n:-1], table[:, [-1]].toarray().ravel())


def _check_linear(network: Network) -> None:
    cell = network.cell
    blocks = [
        f"{b.name} ({'function ' + b.function if isinstance(b, Function) else 'product'})"
        for b in cell.blocks
        if not isinstance(b, Sum)
    ]
    rails = [
        f"{n.name} (rails)"
        for n in cell.neurons
        if np.isfinite([n.limiter.low, n.limiter.high]).any()
    ]
    found = blocks + rails
    if found:
        told = ", ".join(found[:12]) + (f" and {len(found) - 12} more" if len(found) > 12 else "")
        raise ExportError(
            f"{network.title}: NIR has linear nodes only, not {told}; export a network without "
            "them, or to ONNX, C or Verilog-A"
        )


def _summed(forms: Mapping[int, Form], edges: Iterable[tuple[int, float]]) -> Form:
    total: Form = defaultdict(float)
    for word, weight in edges:
        for column, factor in forms[word].items():
            total[column] += weight * factor
    return total


def _table(rows: Sequence[Form], width: int) -> sparse.csr_array:
    entries = [(k, column, value) for k, row in enumerate(rows) for column, value in row.items()]
    k, column, value = np.array(entries, float).reshape(-1, 3).T
    at = k.astype(np.int64), column.astype(np.int64)
    return sparse.csr_array(sparse.coo_array((value, at), shape=(len(rows), width)))
