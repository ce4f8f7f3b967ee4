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
    values = network.unpack(x)
    rows: dict[str, list[np.ndarray]] = {}
    for row, neuron in enumerate(network.cell.neurons):
        rows.setdefault(neuron.population, []).append(neuron.scale.user(values[row]))
    return {population: np.stack(columns, axis=1) for population, columns in rows.items()}


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
    nodes = evaluator(network).values(x)[:, 1:-1]
    for population in ("mu", "beta"):
        values[population] = np.stack(
            [
                network.neuron(dual.neuron).scale.user(nodes[network.node_index[dual.multiplier]])
                for dual in network.cell.duals
                if network.neuron(dual.neuron).population == population
            ]
        )
    point = tuple(values[name] for name in ("q", "u", "t", "mu", "beta"))
    shares = [nodes[network.node_index[o.multiplier], -1] for o in network.cell.objectives]
    if not (network.cell.diodes or shares):
        return point
    pressed: dict[str, list[np.ndarray]] = {"z": [], "z_end": []}
    for diode in network.cell.diodes:
        neuron, multiplier = (
            network.neuron(diode.neuron),
            nodes[network.node_index[diode.multiplier]],
        )
        live = network.live[network.neuron_index[diode.neuron]]
        pressed[neuron.population].append(neuron.scale.user(np.where(live, multiplier, 0.0)))
    at_end = np.array([row[-1] for row in pressed["z_end"]])
    point = (*point, np.array(pressed["z"]).reshape(-1, network.stages), at_end)
    return (*point, np.array(shares)) if shares else point
