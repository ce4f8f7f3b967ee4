"""Admissible neuron states: domains of the function blocks that the neurons feed.

A domain is an open interval. A reciprocal is defined on either side of its pole, but a run must not
cross the pole. The side at the start of the run is therefore binding.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ann_dc.evaluation.tape import FUNCTION, Tape
from ann_dc.network.cell import ONE, Function, Template
from ann_dc.network.functions import FUNCTIONS, Library, function_block
from ann_dc.network.network import Network

MARGIN = 0.02
"""Margin at each end of a two-sided domain, as a fraction of the domain's width."""

HEADROOM = 0.05
"""Margin at the end of a one-sided domain, as a fraction of the start's magnitude."""


def safe_bounds(network: Network, x: np.ndarray) -> np.ndarray:
    """Return bounds (n, 2) of neurons: saturation limits and safe ranges of blocks.

    The lowest and highest states keep all blocks that a neuron feeds defined, and are infinite if
    no block sets a bound. A reciprocal preserves the sign of its argument at the state x (n,).
    Blocks that combine several neurons set no bound. The `DomainGuard` detects a run that leaves
    their domain.
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
    """Return (neuron, weight, bias) of a node that is one scaled and shifted neuron."""
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
    """Open domains of all function blocks, and the pole side of each reciprocal."""

    domains: np.ndarray
    """Domain of every function block (codes, 2)."""
    signs: np.ndarray
    """Required sign of each argument (blocks, N); zero for blocks without a pole."""

    @classmethod
    def at(cls, tape: Tape, values: np.ndarray) -> DomainGuard:
        """Return the guard for a run from initial node values (nodes, N + 2)."""
        signs = np.zeros((len(tape.blocks), values.shape[1] - 2))
        for step, (kind, _, code, x) in enumerate(tape.blocks):
            if kind == FUNCTION and FUNCTIONS[code].has_pole:
                signs[step] = side_of_pole(values[x, 1:-1], np)
        return cls(domains=np.array([block.domain for block in FUNCTIONS]), signs=signs)


def side_of_pole(argument: Any, library: Library) -> Any:
    """Return -1 or 1 elementwise; 1 at the pole, where nothing is defined.

    The argument has any shape; ``library`` is its array library.
    """
    return library.where(argument < 0, -library.ones_like(argument), 1.0)


class Bounds(NamedTuple):
    """Bounds of a recurrence; n live neurons."""

    slew: np.ndarray
    """Largest change of a neuron in one step (n,)."""
    box: np.ndarray
    """Lowest and highest state (n, 2)."""
    guard: DomainGuard
    """Domains that the run must not leave."""
