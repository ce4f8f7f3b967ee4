"""A choice of neurons, blocks or connections, by population, stage and name.

A `Selection` says which; `neurons_of`, `blocks_of` and `connections_of` list what can be chosen,
and `chosen` gives the names and the stages. What does not exist is refused, not left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.network.cell import Sum
from ann_dc.network.network import Network


@dataclass(frozen=True, kw_only=True)
class Selection:
    """A choice of neurons, blocks or connections, which are where their target is.

    Attributes
    ----------
    populations : tuple of str, optional
        What stands before the dot in the name of a neuron or a sum (``mu``, ``c``), ``product``,
        ``function``.
    stages : tuple of int, optional
    names : tuple of str, optional
        Of neurons, blocks and connections; a target's name stands for all its connections.
    """

    populations: tuple[str, ...] | None = None
    stages: tuple[int, ...] | None = None
    names: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        for field, given in vars(self).items():
            if not isinstance(given, tuple | None):
                raise NetworkError(f"where, {field}: expected a tuple, got {given!r}")


EVERYWHERE = Selection()

Known = dict[str, tuple[str, ...]]
"""What can be chosen: the population of each, and the names that it answers to."""


def neurons_of(network: Network) -> Known:
    """All neurons."""
    return {neuron.name: (neuron.population, neuron.name) for neuron in network.cell.neurons}


def blocks_of(network: Network, *kinds: type) -> Known:
    """All blocks, or those of some kinds."""
    return {
        b.name: (
            b.name.partition(".")[0] if isinstance(b, Sum) else type(b).__name__.lower(),
            b.name,
        )
        for b in network.cell.blocks
        if not kinds or isinstance(b, kinds)
    }


def connections_of(network: Network) -> Known:
    """All connections."""
    nodes = neurons_of(network) | blocks_of(network)
    return {c.name: (nodes[c.target][0], c.name, c.target) for c in network.cell.connections}


def chosen(network: Network, where: Selection, known: Known) -> tuple[list[str], np.ndarray]:
    """Names of what is chosen, and (N,) booleans: at which stages it is.

    Raises
    ------
    UnknownNameError
        If there is no such population, name or stage; the message lists those that there are.
    """
    _check_exists(network, where, known)
    names = [
        name
        for name, (population, *answers) in known.items()
        if (where.populations is None or population in where.populations)
        and (where.names is None or not set(where.names).isdisjoint(answers))
    ]
    stages = np.arange(network.stages)
    present = np.isin(stages, stages if where.stages is None else where.stages)
    return names if present.any() else [], present


def _check_exists(network: Network, where: Selection, known: Known) -> None:
    for kind, given, available in (
        ("population", where.populations, {population for population, *_ in known.values()}),
        ("name", where.names, {name for _, *names in known.values() for name in names}),
        ("stage", where.stages, range(network.stages)),
    ):
        for name in given or ():
            if name not in available:
                raise UnknownNameError.of(f"where: {kind}", name, map(str, sorted(available)))
