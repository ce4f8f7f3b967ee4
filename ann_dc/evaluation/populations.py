"""Populations and KKT point of a network state, in the user's units.

The multipliers of a KKT point are the outputs m = mu + rho c of the duals, with which the network
computes. At a settled state c = 0 and m = mu.
"""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network


def neuron_values(network: Network, x: np.ndarray) -> dict[str, np.ndarray]:
    """Return the populations of a state in the user's units.

    Parameters
    ----------
    network : Network
        Network of the state.
    x : (n,) array
        State vector in network units.

    Returns
    -------
    dict of population name to (N, components) array
        Values of every population.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=4))
    >>> neuron_values(network, network.start_state)["q"][:, 0].tolist()
    [0.0, 0.25, 0.5, 0.75]
    """
    values = _in_user_units(network, slice(None), network.unpack(x))
    return {population: values[rows].T for population, rows in network.cell.populations.items()}


def _in_user_units(network: Network, neurons: slice | np.ndarray, values: np.ndarray) -> np.ndarray:
    """Convert values (rows, N) of neurons or their multipliers to the user's units."""
    factor, offset = network.cell.scales[neurons].T[..., None]
    return offset + factor * values


def kkt_point(network: Network, x: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the KKT point of a state, the argument of `certify`.

    The point contains q, u, t, mu, beta and the multipliers of inequalities, in the user's units.

    Parameters
    ----------
    network : Network
        Network of an optimisation problem, from `synthesize`.
    x : (n,) array
        State vector in network units.

    Returns
    -------
    tuple of five (components, N) arrays
        q, u, t, mu and beta. With inequalities or objectives: also zeta (rows, N) and the
        multipliers of the terminal inequalities (rows,). With objectives: also the objective
        weights (p,).

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=4))
    >>> [rows.shape for rows in kkt_point(network, network.start_state)]
    [(2, 4), (1, 4), (2, 4), (2, 4), (2, 4)]
    """
    values = {name: rows.T for name, rows in neuron_values(network, x).items()}
    own = evaluator(network)
    nodes = own.values(x)[:, 1:-1]
    for population, (neurons, multipliers) in own.multipliers.items():
        said = nodes[multipliers]
        if population not in ("mu", "beta"):
            said = np.where(network.live[neurons], said, 0.0)
        values[population] = _in_user_units(network, neurons, said)
    point = tuple(values[name] for name in ("q", "u", "t", "mu", "beta"))
    cell, none = network.cell, np.empty((0, network.stages))
    if cell.inequality_duals or cell.objectives:
        point = (*point, values.get("z", none), values.get("z_end", none)[:, -1])
    shares = [nodes[network.node_index[o.multiplier], -1] for o in cell.objectives]
    return (*point, np.array(shares)) if shares else point
