"""Weight matrix of a cell array, with a name for every row and column."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ann_dc.network.cell import ONE, Sum
from ann_dc.network.network import Network
from ann_dc.validation import checked

LARGEST_TABLE = 200_000
"""Largest number of matrix entries written as a table; larger matrices are written as a list."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightMatrix:
    """Weight matrix W: W s is the net input of every neuron and sum for node values s.

    Values are in network units. Rows and columns are ordered by stage, and within a stage as in the
    cell. Only live neurons have rows and columns: a fixed neuron is read from its input, and a
    neuron shared by all cells is read from the last cell. Outputs of multipliers and functions are
    not weights, so these blocks have a column and no row.

    Attributes
    ----------
    rows : tuple of str
        Names of live neurons and sums, such as ``mu[3].x`` and ``c.x[3]``.
    columns : tuple of str
        Names of live neurons, inputs and blocks, followed by the constant ``one``.
    values : sparse array
        Weights, shape (rows, columns).
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: sparse.csr_array


@checked
def to_matrix(network: Network) -> WeightMatrix:
    """Assemble the weights of all connections between all nodes of a cell array.

    Examples
    --------
    A chain of two leaky integrators, driven from the left:

    >>> from ann_dc.network import Cell, Connection, Neuron, Template
    >>> chain = Network(
    ...     cell=Cell(neurons=(Neuron(name="x"),), inputs=("drive",), connections=(
    ...         Connection(source="x", target="x", weight=-1.0),
    ...         Connection(source="x", target="x", template=Template.PREVIOUS))),
    ...     stages=2, inputs={"drive": 1.0}, left_boundary={"x": "drive"})
    >>> matrix = to_matrix(chain)
    >>> matrix.rows, matrix.columns
    (('x[0]', 'x[1]'), ('x[0]', 'drive[0]', 'x[1]', 'drive[1]', 'one'))
    >>> matrix.values.toarray().tolist()
    [[-1.0, 1.0, 0.0, 0.0, 0.0], [1.0, 0.0, -1.0, 0.0, 0.0]]
    """
    rows, columns, stages = _rows(network), _columns(network), np.arange(network.stages)
    index = network.node_index
    parts = [np.empty((3, 0))]
    for wire in network.cell.connections:
        source = stages + wire.template + 1
        row = rows.place[index[wire.target], 1:-1]
        column = columns.place[index[wire.source]][np.clip(source, 0, network.stages + 1)]
        there = (row >= 0) & (column >= 0) & (source >= 0) & (source <= network.stages + 1)
        weight = np.broadcast_to(np.asarray(wire.weight, float), network.stages)
        parts.append(np.array([weight, row, column])[:, there])
    weights, at_row, at_column = np.hstack(parts)
    shape = len(rows.names), len(columns.names)
    places = at_row.astype(np.int64), at_column.astype(np.int64)
    values = sparse.csr_array((weights, places), shape=shape)
    values.sum_duplicates()
    return WeightMatrix(rows=rows.names, columns=columns.names, values=values)


@checked
def to_csv(network: Network) -> str:
    """Write the weights of all connections as comma-separated text for inspection.

    The text is a table with row and column names. If the table would exceed `LARGEST_TABLE`
    entries, the text has one line per weight: ``target,source,weight``. Numbers are written so that
    reading returns the identical float64.

    Examples
    --------
    >>> from ann_dc.network import Cell, Connection, Neuron
    >>> decay = Connection(source="x", target="x", weight=-2.0)
    >>> cell = Cell(neurons=(Neuron(name="x"),), connections=(decay,))
    >>> print(to_csv(Network(stages=1, cell=cell)))
    target,x[0],one
    x[0],-2.0,0.0
    <BLANKLINE>
    """
    matrix = to_matrix(network)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if len(matrix.rows) * len(matrix.columns) <= LARGEST_TABLE:
        writer.writerow(["target", *matrix.columns])
        for name, row in zip(matrix.rows, matrix.values.toarray().tolist()):
            writer.writerow([name, *row])
        return text.getvalue()
    writer.writerow(["target", "source", "weight"])
    entries = matrix.values.tocoo()
    for row, column, weight in zip(*entries.coords, entries.data.tolist()):
        writer.writerow([matrix.rows[row], matrix.columns[column], weight])
    return text.getvalue()


@dataclass(frozen=True)
class _Numbered:
    """Ordered names, and the index of each node at each stage and beyond both ends (nodes, N + 2).

    The index is -1 if the node does not exist.
    """

    names: tuple[str, ...]
    place: np.ndarray


def _rows(network: Network) -> _Numbered:
    sums = {block.name for block in network.cell.blocks if isinstance(block, Sum)}
    return _numbered(network, [name in sums for name in network.node_index])


def _columns(network: Network) -> _Numbered:
    given = _numbered(network, [name != ONE for name in network.node_index])
    index, place = network.node_index, given.place
    for pin in network.fixed:
        place[index[pin.neuron], pin.stage + 1] = place[index[pin.input], pin.stage + 1]
    for node, name in network.left_boundary.items():
        place[index[node], 0] = place[index[name], 1]
    place[index[ONE]] = len(given.names)
    return _Numbered((*given.names, ONE), place)


def _numbered(network: Network, counted: list[bool]) -> _Numbered:
    """Assign indices to live neurons and the other counted nodes, stage by stage."""
    there = np.repeat(np.array(counted)[:, None], network.stages, axis=1)
    there[: len(network.live)] = network.live
    stage, node = np.nonzero(there.T)
    place = np.full((len(there), network.stages + 2), -1)
    place[node, stage + 1] = np.arange(len(node))
    place[network.shared, 1:-1] = place[network.shared, -2:-1]
    heads = [_name_parts(network, name) for name in network.node_index]
    names = tuple(f"{heads[n][0]}[{k}]{heads[n][1]}" for n, k in zip(node.tolist(), stage.tolist()))
    return _Numbered(names, place)


def _name_parts(network: Network, name: str) -> tuple[str, str]:
    """Return the parts of a node's `Network.label` before and after the stage number."""
    if name not in network.neuron_index:
        return name, ""
    population, dot, component = name.partition(".")
    return population, dot + component
