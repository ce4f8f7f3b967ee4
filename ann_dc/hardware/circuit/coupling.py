r"""Coarse coordinators in hardware: a resistor matrix instead of integrators of their own.

What the network calls z, the t and q of all chains, obeys :math:`z' = M d` with the drives d and
the metric M of time constants and hats. With an own integrator D of every t and q, D' = d, it is
the weighted sum z = M D: an adder each, whose input resistors are the rows of M.
"""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.network.metrics.pyramid import Pyramid
from ann_dc.network.network import Network

OWN = "own."
"""Before the name of a t or q: its own integrator, where coordinators are."""


def coupling_of(network: Network) -> np.ndarray | None:
    """M over the positions q_0, t_0, q_1, ... of all chains, chain by chain; None without any.

    The metric of the time constants and the hats; zero where a position is not live.

    Parameters
    ----------
    network : Network

    Returns
    -------
    (C * 2N, C * 2N) array or None
    """
    if not isinstance(network.metric, Pyramid):
        return None
    components = network.row.chain_components.ravel()
    live = components >= 0
    matrix = evaluator(network).metric.toarray()[np.ix_(components, components)]
    return np.where(live[:, None] & live[None, :], matrix, 0.0)


def own_integrals(network: Network, states: np.ndarray) -> dict[str, np.ndarray]:
    """What the own integrator of every t and q under coordinators holds.

    With z' = M d and D' = d, z = M D: D is M^{-1} z. Empty without coordinators.

    Parameters
    ----------
    network : Network
    states : (T, n) array
        State vectors.

    Returns
    -------
    dict of str to (T, N) array
        By the name of the neuron, after ``own.``.
    """
    coupling = coupling_of(network)
    if coupling is None:
        return {}
    values, stages = network.unpack(states), network.stages
    chain = values[:, evaluator(network).tape.chains]  # (T, C, 2, N)
    z = chain.transpose(0, 1, 3, 2).reshape(len(states), -1)
    live = coupling.diagonal() > 0
    integrals = np.zeros_like(z)
    integrals[:, live] = np.linalg.solve(coupling[np.ix_(live, live)], z[:, live].T).T
    by_place = integrals.reshape(len(states), -1, stages, 2)
    return {
        OWN + name: by_place[:, i, :, kind]
        for i, chain_names in enumerate(network.cell.chains)
        for kind, name in enumerate(chain_names)
    }
