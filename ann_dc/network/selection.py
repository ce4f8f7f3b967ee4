"""Selection of neurons, blocks or connections by population, stage and name.

A `Selection` states the criteria; `neurons_of`, `blocks_of` and `connections_of` list the
selectable items, and `chosen` gives the names and the stages. Unknown names are rejected, not
omitted. `clamped_rows` lists neurons by their saturation limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.network.cell import Sum
from ann_dc.network.network import Network


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Selection of neurons, blocks or connections; connections belong to their target.

    Raises `NetworkError` if a field is not a tuple.

    Attributes
    ----------
    populations : tuple of str, optional
        Part before the dot in the name of a neuron or a sum (``mu``, ``c``), ``product``,
        ``function``.
    stages : tuple of int, optional
        Stages from 0 to N - 1.
    names : tuple of str, optional
        Names of neurons, blocks and connections; a target's name selects all its connections.

    Examples
    --------
    Only the duals of the first stage leak:

    >>> from ann_dc import nonidealities, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> first = Selection(populations=("mu", "beta"), stages=(0,))
    >>> spoilt = nonidealities.leak(network, 1e3, first)
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
"""Selectable items: the population of each, and the names that select the item."""


def neurons_of(network: Network) -> Known:
    """Return all selectable neurons of a network."""
    return {neuron.name: (neuron.population, neuron.name) for neuron in network.cell.neurons}


def blocks_of(network: Network, *kinds: type) -> Known:
    """Return all blocks of a network, or those of given types.

    The types are `Sum`, `Product` and `Function`.
    """
    return {
        b.name: (
            b.name.partition(".")[0] if isinstance(b, Sum) else type(b).__name__.lower(),
            b.name,
        )
        for b in network.cell.blocks
        if not kinds or isinstance(b, kinds)
    }


def connections_of(network: Network) -> Known:
    """Return all connections of a network."""
    nodes = neurons_of(network) | blocks_of(network)
    return {c.name: (nodes[c.target][0], c.name, c.target) for c in network.cell.connections}


def clamped_rows(network: Network) -> np.ndarray:
    """Return the rows (K,) of limited neurons that the preconditioner couples.

    If there are none, all state derivatives at saturation limits follow from the neurons' net
    inputs alone.
    """
    limits = [(n.limiter.low, n.limiter.high) for n in network.cell.neurons]
    with_limits = np.isfinite(np.reshape(limits, (-1, 2))).any(axis=1) & network.live.any(axis=1)
    with np.errstate(over="ignore"):  # a saved network may have time constants of any length
        return np.flatnonzero(with_limits & network.preconditioner.reach(network.layout))


def chosen(network: Network, where: Selection, known: Known) -> tuple[list[str], np.ndarray]:
    """Return the selected names, and (N,) booleans that mark the selected stages.

    The selectable items are from `neurons_of`, `blocks_of` and `connections_of`. Raises
    `UnknownNameError` with the existing names if a population, name or stage is unknown.
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
