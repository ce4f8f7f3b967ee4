"""Networks with the exact preconditioner M = (H + A'WA)^{-1}, as the project's own grid."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.saddle import Saddle, saddle_of
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.gain_design.grid_gains import stiffness_of
from ann_dc.network.network import Network


@dataclass(frozen=True)
class ExactPreconditioner:
    """A settled network whose preconditioner can be made exact, for any weights of its rows."""

    network: Network
    state: np.ndarray
    saddle: Saddle

    def weights(self, by_neuron: np.ndarray) -> np.ndarray:
        """(d,) from (P,)."""
        return by_neuron[self.network.places[self.saddle.dual, 0]]

    def with_gains(self, rho: np.ndarray, eta: float) -> Network:
        """Penalties rho (P,), zero for primal neurons; rates of the duals eta rho."""
        network, saddle = self.network, self.saddle
        W = sparse.diags_array(self.weights(rho))
        G = saddle.H + saddle.A.T @ W @ saddle.A
        diagonal, preconditioner = stiffness_of(network, sparse.csr_array(G))
        rate = np.where(rho > 0, eta * rho, 1.0)[:, None] * np.ones(network.stages)
        place = network.places[saddle.primal]
        rate[place[:, 0], place[:, 1]] = 1 / diagonal
        return apply_gains(network, Gains(rho=rho, rate=rate, preconditioner=preconditioner))


def exact_preconditioner(network: Network, x: np.ndarray) -> ExactPreconditioner:
    """At the equilibrium near x."""
    state = equilibrium(network, x)
    return ExactPreconditioner(network, state, saddle_of(network, state))


def is_dual(network: Network) -> np.ndarray:
    """(P,) booleans."""
    return np.isin([n.name for n in network.cell.neurons], [d.neuron for d in network.cell.duals])
