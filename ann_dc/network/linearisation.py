"""What gain design reads off a network at a state: A, H and the stage matrices F.

Everything comes from the network's exact Jacobian, evaluated with rho = 0: the rows of the duals
are A = dc/dz, and with the duals at zero the rows of the primal neurons are -H of the cost alone.
"""

from __future__ import annotations

import numpy as np

from ann_dc.network.cell import Connection
from ann_dc.network.coordinators import chain_rows
from ann_dc.network.kernel import Kernel
from ann_dc.network.network import Network
from ann_dc.network.tape import DUAL, POSITION, PRIMAL, Tape


class Linearisation:
    """A, H and the stage matrices of a network; `at` moves it to another state."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.kernel = Kernel(network, tape_with_penalty(network, 0.0))
        tape = self.kernel.tape
        rows, columns = tape.entries[:, 0], tape.entries[:, 1]
        self._row, self._column = tape.places[rows, 0], tape.places[columns, 0]
        self._row_stage, self._column_stage = tape.places[rows, 1], tape.places[columns, 1]
        role = tape.roles
        primal = (role == PRIMAL) | (role == POSITION)
        self._is_A = (role[self._row] == DUAL) & primal[self._column]
        self._is_H = primal[self._row] & primal[self._column]
        self._is_diagonal = self._is_H & (rows == columns)
        self.primal, self.dual = primal, role == DUAL
        self._chain = chain_rows(network)

    def at(self, x: np.ndarray) -> Linearisation:
        """Evaluate at a state (n,)."""
        still = np.where(self.dual[self.network.places[:, 0]], 0.0, x)
        self._data = self.kernel.jacobian_entries(still)
        return self

    def row_sums(self, weight: np.ndarray) -> np.ndarray:
        """sum_i w_i A_ij^2 as (P, N); ``weight`` is (P,)."""
        e = self._is_A
        total = np.zeros(self.network.live.shape)
        np.add.at(
            total,
            (self._column[e], self._column_stage[e]),
            weight[self._row[e]] * self._data[e] ** 2,
        )
        return total

    def cost_curvature(self) -> np.ndarray:
        """H_jj as (P, N), zero for duals."""
        e = self._is_diagonal
        total = np.zeros(self.network.live.shape)
        total[self._column[e], self._column_stage[e]] = -self._data[e]
        return total

    def stage_matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """(F, H_qq) of shape (N, C, C): df/dq and the cost's Hessian in q, by stage."""
        count = len(self._chain)
        duals = self.network.cell.duals[:count]
        index = self.network.neuron_index
        place = -np.ones(len(self.network.live), int)
        place[self._chain[:, 0]] = np.arange(count)
        map_row = -np.ones(len(self.network.live), int)
        map_row[[index[d.neuron] for d in duals]] = np.arange(count)
        F = np.zeros((self.network.stages, count, count))
        H = np.zeros_like(F)
        e = self._is_A & (map_row[self._row] >= 0) & (place[self._column] >= 0)
        F[self._column_stage[e], map_row[self._row[e]], place[self._column[e]]] = self._data[e]
        e = self._is_H & (place[self._row] >= 0) & (place[self._column] >= 0)
        e &= self._row_stage == self._column_stage
        H[self._column_stage[e], place[self._row[e]], place[self._column[e]]] = -self._data[e]
        return F, H


def tape_with_penalty(network: Network, rho: np.ndarray | float) -> Tape:
    """The network's tape with other rho: (P,), or one number for all PI duals."""
    tape, weights = network.program.tape, network.program.tape.weights.copy()
    rho = np.broadcast_to(rho, len(network.cell.neurons))
    for dual in network.cell.duals:
        path = Connection(source=dual.residual, target=dual.multiplier).name
        if path in network.program.edges:
            weights[network.program.edges[path]] = rho[network.neuron_index[dual.neuron]]
    return tape._replace(weights=weights)
