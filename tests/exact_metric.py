"""Networks with the exact metric M = (H + A'WA)^{-1}, as the project's own grid."""

from dataclasses import dataclass

import numpy as np

from ann_dc.analysis import Saddle, equilibrium, saddle_of
from ann_dc.gain_design import Gains, apply_gains
from ann_dc.network import Network
from ann_dc.network.metrics import Grid


@dataclass(frozen=True)
class ExactMetric:
    """A settled network whose metric can be made exact, for any weights of its rows."""

    network: Network
    state: np.ndarray
    saddle: Saddle

    def weights(self, by_neuron: np.ndarray) -> np.ndarray:
        """(d,) from (P,)."""
        return by_neuron[self.network.places[self.saddle.dual, 0]]

    def with_gains(self, rho: np.ndarray, eta: float) -> Network:
        """Penalties rho (P,), zero for primal neurons; rates of the duals eta rho."""
        network, saddle = self.network, self.saddle
        W, A = self.weights(rho), saddle.A.toarray()
        G = saddle.H.toarray() + (A.T * W) @ A
        diagonal = np.diag(G)
        S = G / np.sqrt(np.outer(diagonal, diagonal))
        rate = np.where(rho > 0, eta * rho, 1.0)[:, None] * np.ones(network.stages)
        place = network.places[saddle.primal]
        rate[place[:, 0], place[:, 1]] = 1 / diagonal
        return apply_gains(network, Gains(rho=rho, rate=rate, metric=self._grid(S)))

    def _grid(self, S: np.ndarray) -> Grid:
        """S (z, z) by cells."""
        row, saddle = self.network.row, self.saddle
        where = -np.ones(self.network.size, int)
        where[saddle.primal] = np.arange(len(saddle.primal))
        component = row.component[row.primal].T  # (N, m)
        place = np.where(component >= 0, where[component], len(S))
        padded = np.pad(S, (0, 1))  # what is not there couples to nothing
        own = padded[place[:, :, None], place[:, None, :]]
        following = padded[place[:-1, :, None], place[1:, None, :]]
        return Grid(own=0.5 * (own + own.transpose(0, 2, 1)), following=following)


def exact_metric(network: Network, x: np.ndarray) -> ExactMetric:
    """At the equilibrium near x."""
    state = equilibrium(network, x)
    return ExactMetric(network, state, saddle_of(network, state))


def is_dual(network: Network) -> np.ndarray:
    """(P,) booleans."""
    return np.isin([n.name for n in network.cell.neurons], [d.neuron for d in network.cell.duals])
