r"""Maximum and minimum of two nodes, made of a rectifier and two sums.

.. math:: \max(a, b) = b + r(a - b), \qquad \min(a, b) = b - r(b - a),

where r(x) = max(x, 0) is the function block ``rectify``.

Every evaluator and every circuit with rectifiers therefore has both.
"""

from __future__ import annotations

from typing import TypeAlias

from ann_dc.network.cell import Connection, Function, Sum
from ann_dc.validation import checked

Parts: TypeAlias = "tuple[tuple[Sum | Function, ...], tuple[Connection, ...]]"
"""Blocks in topological order, and the connections that end at their sums."""


@checked
def maximum(name: str, a: str, b: str) -> Parts:
    """Return the blocks and connections of a sum ``name`` with the value max(a, b).

    Parameters
    ----------
    name : str
        Name of the last block; the others are ``difference.<name>`` and ``excess.<name>``.
    a, b : str
        Names of two different nodes of the same cell: neurons, inputs, earlier blocks or `ONE`.

    Returns
    -------
    blocks : tuple of Block
        Three blocks, to be listed behind those of ``a`` and ``b``.
    connections : tuple of Connection
        Four connections. All slopes with respect to ``a`` are 0 at a = b.

    Examples
    --------
    A leaky neuron that follows the larger of two inputs:

    >>> from ann_dc.network import Cell, Network, Neuron
    >>> blocks, connections = maximum("larger", "a", "b")
    >>> leak = Connection(source="x", target="x", weight=-1.0)
    >>> drive = Connection(source="larger", target="x")
    >>> cell = Cell(neurons=(Neuron(name="x"),), inputs=("a", "b"), blocks=blocks,
    ...             connections=(*connections, leak, drive))
    >>> network = Network(cell=cell, stages=2, inputs={"a": [3.0, -1.0], "b": 2.0})
    >>> from ann_dc.backends import OdeBackend
    >>> [round(float(x), 6) for x in OdeBackend().run(network).trajectory.final]
    [3.0, 2.0]
    """
    return _parts(name, a, b, 1.0)


@checked
def minimum(name: str, a: str, b: str) -> Parts:
    """Return the blocks and connections of a sum ``name`` with the value min(a, b).

    The parameters and the result are those of `maximum`.
    """
    return _parts(name, a, b, -1.0)


def _parts(name: str, a: str, b: str, sign: float) -> Parts:
    """Return the parts of b + sign * rectify(sign * (a - b))."""
    difference, excess = f"difference.{name}", f"excess.{name}"
    blocks = Sum(name=difference), Function(name=excess, function="rectify", x=difference)
    return (*blocks, Sum(name=name)), (
        Connection(source=a, target=difference, weight=sign),
        Connection(source=b, target=difference, weight=-sign),
        Connection(source=b, target=name),
        Connection(source=excess, target=name, weight=sign),
    )
