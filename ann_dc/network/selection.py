"""A choice of neurons, blocks or connections, by population, stage and name.

A `Selection` says which; `neurons_of`, `blocks_of` and `connections_of` list what can be chosen,
and `chosen` gives the names and the stages. What does not exist is refused, not left out.
`clamped_rows` lists neurons by their rails.
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
        From 0 to N - 1.
    names : tuple of str, optional
        Of neurons, blocks and connections; a target's name stands for all its connections.

    Raises
    ------
    NetworkError
        If a field is no tuple.

    Examples
    --------
    Only the duals of the first stage leak:

    >>> from ann_dc import defects, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> spoilt = defects.leak(network, 1e3, Selection(populations=("mu", "beta"), stages=(0,)))
    >>> spoilt.size == network.size
    True
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
    """All neurons of a network that can be chosen."""
    return {neuron.name: (neuron.population, neuron.name) for neuron in network.cell.neurons}


def blocks_of(network: Network, *kinds: type) -> Known:
    """All blocks of a network, or those of some kinds (`Sum`, `Product`, `Function`)."""
    return {
        b.name: (
            b.name.partition(".")[0] if isinstance(b, Sum) else type(b).__name__.lower(),
            b.name,
        )
        for b in network.cell.blocks
        if not kinds or isinstance(b, kinds)
    }


def connections_of(network: Network) -> Known:
    """All connections of a network."""
    nodes = neurons_of(network) | blocks_of(network)
    return {c.name: (nodes[c.target][0], c.name, c.target) for c in network.cell.connections}


def clamped_rows(network: Network) -> np.ndarray:
    """Return the rows (K,) of the neurons with rails that the metric couples to others.

    If there are none, all moves at rails follow from the drives of the neurons alone.

    Parameters
    ----------
    network : Network
    """
    limits = [(n.limiter.low, n.limiter.high) for n in network.cell.neurons]
    railed = np.isfinite(np.reshape(limits, (-1, 2))).any(axis=1) & network.live.any(axis=1)
    with np.errstate(over="ignore"):  # a saved network may have time constants of any length
        return np.flatnonzero(railed & network.metric.reach(network.row))


def chosen(network: Network, where: Selection, known: Known) -> tuple[list[str], np.ndarray]:
    """Names of what is chosen, and (N,) booleans: at which stages it is.

    Parameters
    ----------
    network : Network
    where : Selection
    known : Known
        What can be chosen, from `neurons_of`, `blocks_of` and `connections_of`.

    Returns
    -------
    names : list of str
    stages : (N,) array of bool

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
