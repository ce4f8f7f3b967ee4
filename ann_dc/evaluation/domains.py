"""Where neurons may be: inside the domains of the function blocks that they feed.

A domain is an open interval; a reciprocal is defined on either side of its pole, but a run may not
go from one side to the other, so that where it starts decides.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ann_dc.evaluation.tape import FUNCTION, Tape
from ann_dc.network.cell import ONE, Function, Template
from ann_dc.network.functions import FUNCTIONS, Library, function_block
from ann_dc.network.network import Network

MARGIN = 0.02
"""Share of a two-sided domain's width that is kept free at each of its ends."""

HEADROOM = 0.05
"""Share of the start's magnitude that is kept free at the end of a one-sided domain."""


def safe_bounds(network: Network, x: np.ndarray) -> np.ndarray:
    """Bounds (n, 2) of neurons: their rails, and where they keep a block that they feed defined.

    A reciprocal keeps the sign that its argument has at the state ``x`` (n,). Blocks that mix
    several neurons set no bound; a run that leaves their domain learns it from its `DomainGuard`.

    Parameters
    ----------
    network : Network
    x : (n,) array
        The state whose side of every pole is kept.

    Returns
    -------
    (n, 2) array
        Lowest and highest state, infinite where no block sets a bound.
    """
    values = network.unpack(x)
    bounds = np.array([(n.limiter.low, n.limiter.high) for n in network.cell.neurons], float)
    for block in network.cell.blocks:
        source = _single_source(network, block.x) if isinstance(block, Function) else None
        if source is None:
            continue
        neuron, weight, bias = source
        low, high = _interval(block.function, values[neuron] * weight + bias)  # type: ignore
        ends = sorted(((low - bias) / weight, (high - bias) / weight))
        bounds[neuron] = max(bounds[neuron, 0], ends[0]), min(bounds[neuron, 1], ends[1])
    return np.ascontiguousarray(bounds[network.places[:, 0]])


def _single_source(network: Network, node: str) -> tuple[int, float, float] | None:
    """(neuron, weight, bias) where a node is one neuron, scaled and shifted."""
    if node in network.neuron_index:
        return network.neuron_index[node], 1.0, 0.0
    arriving = [c for c in network.cell.connections if c.target == node]
    neurons = [c for c in arriving if c.source != ONE]
    if len(neurons) != 1 or neurons[0].source not in network.neuron_index:
        return None
    if neurons[0].template != Template.SELF or any(np.ndim(c.weight) for c in arriving):
        return None
    bias = sum(float(c.weight) for c in arriving if c.source == ONE)
    return network.neuron_index[neurons[0].source], float(neurons[0].weight), bias


def _interval(function: str, argument: np.ndarray) -> tuple[float, float]:
    block = function_block(function)
    low, high = block.domain
    if block.has_pole:
        low, high = (0.0, np.inf) if np.sign(argument).sum() > 0 else (-np.inf, 0.0)
    scale = np.abs(argument).max()
    margin = MARGIN * (high - low) if np.isfinite(high - low) else HEADROOM * scale
    return low + margin, high - margin


class DomainGuard(NamedTuple):
    """Open intervals of all function blocks, and the side of its pole each reciprocal is on."""

    domains: np.ndarray
    """(codes, 2): of every function block."""
    signs: np.ndarray
    """(blocks, N): sign that an argument has to keep; zero where a block has no pole."""

    @classmethod
    def at(cls, tape: Tape, values: np.ndarray) -> DomainGuard:
        """The guard for a run that starts with these node values.

        Parameters
        ----------
        tape : Tape
        values : (nodes, N + 2) array
            Node values at the start.
        """
        signs = np.zeros((len(tape.blocks), values.shape[1] - 2))
        for step, (kind, _, code, x) in enumerate(tape.blocks):
            if kind == FUNCTION and FUNCTIONS[code].has_pole:
                signs[step] = side_of_pole(values[x, 1:-1], np)
        return cls(domains=np.array([block.domain for block in FUNCTIONS]), signs=signs)


def side_of_pole(argument: Any, library: Library) -> Any:
    """-1 or 1, element by element; at the pole itself 1, where nothing is defined.

    Parameters
    ----------
    argument : array
        Of any shape.
    library : module
        The array library.
    """
    return library.where(argument < 0, -library.ones_like(argument), 1.0)


class Bounds(NamedTuple):
    """What a recurrence keeps to; n live neurons."""

    slew: np.ndarray
    """(n,): how far a neuron may move in one step."""
    box: np.ndarray
    """(n, 2): lowest and highest state."""
    guard: DomainGuard
    """The domains that it must not leave."""
