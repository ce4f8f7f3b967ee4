"""What a state says about the problem: populations in the user's units, and its KKT point.

The multipliers of a KKT point are those that the network works with, the outputs m = mu + rho c of
its duals; where it has settled, c = 0 and they are mu.
"""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network


def neuron_values(network: Network, x: np.ndarray) -> dict[str, np.ndarray]:
    """Populations (N, components) of a state vector (n,), in the user's units."""
    values = network.unpack(x)
    rows: dict[str, list[np.ndarray]] = {}
    for row, neuron in enumerate(network.cell.neurons):
        rows.setdefault(neuron.population, []).append(values[row] * neuron.unit)
    return {population: np.stack(columns, axis=1) for population, columns in rows.items()}


def kkt_point(network: Network, x: np.ndarray) -> tuple[np.ndarray, ...]:
    """q, u, t, mu and beta (components, N) of a state vector (n,), in the user's units."""
    values = {name: rows.T for name, rows in neuron_values(network, x).items()}
    nodes = evaluator(network).values(x)[:, 1:-1]
    for population in ("mu", "beta"):
        values[population] = np.stack(
            [
                nodes[network.node_index[dual.multiplier]] * network.neuron(dual.neuron).unit
                for dual in network.cell.duals
                if network.neuron(dual.neuron).population == population
            ]
        )
    return tuple(values[name] for name in ("q", "u", "t", "mu", "beta"))
