"""What a state says about the problem: populations in the user's units, and its KKT point.

The multipliers of a KKT point are those that the network works with, the outputs m = mu + rho c of
its duals; where it has settled, c = 0 and they are mu.
"""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network


def neuron_values(network: Network, x: np.ndarray) -> dict[str, np.ndarray]:
    """Populations of a state, in the user's units.

    Parameters
    ----------
    network : Network
    x : (n,) array
        State vector.

    Returns
    -------
    dict of population name to (N, components) array

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
    """Values (rows, N) of some neurons, or what stands for them."""
    factor, offset = network.cell.scales[neurons].T[..., None]
    return offset + factor * values


def kkt_point(network: Network, x: np.ndarray) -> tuple[np.ndarray, ...]:
    """q, u, t, mu, beta, and multipliers of inequalities: what `certify` takes, in user's units.

    Parameters
    ----------
    network : Network
        An optimiser's, from `synthesize`.
    x : (n,) array
        State vector.

    Returns
    -------
    tuple of five (components, N) arrays
        And, where there are inequalities or objectives, zeta (rows, N) and that of the end's rows
        (rows,); then, where there are objectives, their shares (p,).

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
    if cell.diodes or cell.objectives:
        point = (*point, values.get("z", none), values.get("z_end", none)[:, -1])
    shares = [nodes[network.node_index[o.multiplier], -1] for o in cell.objectives]
    return (*point, np.array(shares)) if shares else point
