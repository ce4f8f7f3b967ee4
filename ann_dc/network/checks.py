"""What a cell has to be before a network is made of it; every refusal names the node.

A name belongs to one node, a time constant is positive, a weight is finite and fits the row, and
blocks stand in topological order: what a block reads is there before it.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.network.cell import ONE, Cell, Connection, Function, Neuron, Product, Sum
from ann_dc.network.functions import function_block


def check_cell(cell: Cell, stages: int) -> None:
    """Refuse a cell that contradicts itself or does not fit a row of so many stages.

    Parameters
    ----------
    cell : Cell
    stages : int
        N.

    Raises
    ------
    NetworkError
        Names that are used twice, numbers that are no weights, time constants or rails,
        connections that end nowhere, blocks out of order.
    UnknownNameError
        A function block that does not exist.
    """
    _check_names(cell)
    for neuron in cell.neurons:
        _check_neuron(neuron, stages)
    _check_connections(cell, stages)
    _check_order(cell)


def per_stage(name: str, value, stages: int) -> np.ndarray:
    """One finite number a stage, (N,) and read-only, from one number or N of them.

    Parameters
    ----------
    name : str
        The field, for the message.
    value : float or (N,) array
    stages : int
        N.

    Returns
    -------
    (N,) array

    Raises
    ------
    NetworkError
        If the value is neither one number nor N of them, or not finite.

    Examples
    --------
    >>> per_stage("tau", 2, 3).tolist()
    [2.0, 2.0, 2.0]
    """
    try:
        array = np.array(np.broadcast_to(np.asarray(value, float), (stages,)))
    except (TypeError, ValueError) as error:
        raise NetworkError(
            f"{name}: expected one number or {stages} of them, one a stage, got {value!r}"
        ) from error
    if not np.isfinite(array).all():
        raise NetworkError(f"{name}: {value!r} is not finite")
    array.setflags(write=False)
    return array


def _nodes(cell: Cell) -> list[str]:
    return [ONE, *(n.name for n in cell.neurons), *cell.inputs, *(b.name for b in cell.blocks)]


def _check_names(cell: Cell) -> None:
    uses = Counter(name.lower() for name in _nodes(cell))
    repeated = [name for name, count in uses.items() if count > 1]
    if repeated:
        raise NetworkError(f"names used twice (case does not count): {', '.join(repeated)}")


def _check_neuron(neuron: Neuron, stages: int) -> None:
    if not (np.asarray(neuron.tau) > 0).all() or not np.isfinite(neuron.tau).all():
        raise NetworkError(f"{neuron.name}: time constant {neuron.tau!r} must be positive")
    per_stage(f"{neuron.name}.tau", neuron.tau, stages)
    if not (np.isfinite(neuron.unit) and neuron.unit != 0):
        raise NetworkError(f"{neuron.name}: unit {neuron.unit!r} must be finite and not zero")
    if not neuron.limiter.low < neuron.limiter.high:
        raise NetworkError(
            f"{neuron.name}: rails {neuron.limiter.low!r} .. {neuron.limiter.high!r} leave no room"
        )


def _check_connections(cell: Cell, stages: int) -> None:
    nodes = set(_nodes(cell))
    targets = {n.name for n in cell.neurons} | {b.name for b in cell.blocks if isinstance(b, Sum)}
    for connection in cell.connections:
        if connection.source not in nodes or connection.target not in targets:
            raise NetworkError(
                f"{connection.name}: source must be a node and target a neuron or a sum"
            )
        per_stage(connection.name, connection.weight, stages)
        if not isinstance(connection.template, (int, np.integer)):
            raise NetworkError(
                f"{connection.target}<-{connection.source}: template: expected a whole number of "
                f"stages, got {connection.template!r}"
            )
    uses = Counter(connection.name for connection in cell.connections)
    repeated = [name for name, count in uses.items() if count > 1]
    if repeated:
        raise NetworkError(f"connections given twice: {', '.join(repeated)}; add up their weights")


def _check_order(cell: Cell) -> None:
    feeds: dict[str, list[Connection]] = {}
    for connection in cell.connections:
        feeds.setdefault(connection.target, []).append(connection)
    ready = {ONE, *(n.name for n in cell.neurons), *cell.inputs}
    for block in cell.blocks:
        if isinstance(block, Product):
            needs = [block.a, block.b]
        elif isinstance(block, Function):
            function_block(block.function)
            needs = [block.x]
        else:
            needs = [c.source for c in feeds.get(block.name, ())]
        late = [name for name in needs if name not in ready]
        if late:
            raise NetworkError(
                f"{block.name} reads {', '.join(late)} before it is computed; "
                "list blocks in topological order, without loops"
            )
        ready.add(block.name)
