"""The parts of a metric: one in every cell that has a node, with wires as long as they need be.

A node of a metric stands in a cell as any other part does, so that its wires have names, values and
errors like those between neighbours; only that they come from further away. Nodes of one name stand
in some cells, and are missing in others.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.linalg

from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.schematic.elements import Adder, GridNode, Wire
from ann_dc.hardware.schematic.metric_wiring import OWN, MetricWiring, wiring_of
from ann_dc.network.cell import ONE
from ann_dc.network.network import Network


def metric_parts(wiring: MetricWiring, stages: int) -> Iterator[Adder | GridNode]:
    """A part for every name of a node that is no integrator, in the order of the layers.

    Parameters
    ----------
    wiring : MetricWiring
    stages : int
        N.

    Yields
    ------
    Adder or GridNode
        The latter where the wiring is passive.
    """
    wires: dict[str, dict[tuple[str, int], np.ndarray]] = {}
    present: dict[str, np.ndarray] = {}
    for row, (name, stage) in enumerate(wiring.nodes):
        if name.startswith(OWN):
            continue
        present.setdefault(name, np.zeros(stages, bool))[stage] = True
        arriving = wires.setdefault(name, {})
        first, last = wiring.weights.indptr[row : row + 2]
        for column in range(first, last):
            source, where = wiring.nodes[wiring.weights.indices[column]]
            weight = arriving.setdefault((source, where - stage), np.zeros(stages))
            weight[stage] = wiring.weights.data[column]
        if wiring.constants[row]:
            arriving.setdefault((ONE, 0), np.zeros(stages))[stage] = wiring.constants[row]
    kind = GridNode if wiring.passive else Adder
    for name, arriving in wires.items():
        yield kind(
            name=name,
            wires=tuple(
                Wire(source=source, offset=offset, weight=weight)
                for (source, offset), weight in sorted(arriving.items())
            ),
            present=present[name],
        )


def metric_values(network: Network, states: np.ndarray) -> dict[str, np.ndarray]:
    """What every node of a metric holds where the network is, its own integrators included.

    With z' = M d and D' = d, z = z_0 + M D: D is M^{-1} (z - z_0). Empty for time constants alone.

    Parameters
    ----------
    network : Network
    states : (T, n) array
        State vectors.

    Returns
    -------
    dict of str to (T, N) array
        By the name of the node; zero in cells that have none. Neurons are left out.
    """
    wiring = wiring_of(network)
    if wiring is None:
        return {}
    places = [(network.neuron_index[name], stage) for name, stage in _neurons(wiring)]
    component = network.state_index[tuple(np.transpose(places))]
    metric = evaluator(network).metric[component][:, component].toarray()
    moved = np.asarray(states, float)[:, component].T - wiring.start[:, None]
    integrals = scipy.linalg.solve(metric, moved, assume_a="pos")
    found: dict[str, np.ndarray] = {}
    for (name, stage), value in zip(wiring.nodes, wiring.values(integrals)):
        if name not in network.neuron_index:
            shape = len(states), network.stages
            found.setdefault(name, np.zeros(shape))[:, stage] = value
    return found


def _neurons(wiring: MetricWiring) -> list[tuple[str, int]]:
    """Neurons (name, stage) in the order of their own integrators."""
    return [wiring.nodes[i] for i in wiring.moved]
