"""What gain design reads off a network at a state: A, H and the stage matrices F.

Everything comes from the network's exact Jacobian, evaluated with rho = 0: the rows of the duals
are A = dc/dz, and with the duals at zero the rows of the primal neurons are -H of the cost alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from ann_dc.evaluation.generated.choice import fast_evaluator
from ann_dc.evaluation.reference import tape_with_penalty
from ann_dc.evaluation.tape import DUAL, POSITION, PRIMAL
from ann_dc.network.network import Network


class Linearisation:
    """A, H and the stage matrices of a network at a state, which `at` gives.

    Parameters
    ----------
    network : Network
        With PI duals; its own penalties do not count.

    Attributes
    ----------
    evaluator : FastEvaluator
        Of the network with rho = 0.
    primal, dual : (P,) arrays of bool
        Which neurons of the cell are what.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> from ann_dc.problem import Scales
    >>> problem = plants.double_integrator(N=5)
    >>> network = synthesize(problem, scales=Scales.none(problem))
    >>> F, _, _ = Linearisation(network).at(network.start_state).stage_matrices()
    >>> F[1].tolist()  # of stage 0 there is none: q_0 is held
    [[1.0, 0.1], [0.0, 1.0]]
    """

    def __init__(self, network: Network) -> None:
        self.network = network
        self.evaluator = fast_evaluator(network, tape_with_penalty(network, 0.0))
        tape = self.evaluator.tape
        rows, columns = tape.entries[:, 0], tape.entries[:, 1]
        self._row, self._column = tape.places[rows, 0], tape.places[columns, 0]
        self._row_stage, self._column_stage = tape.places[rows, 1], tape.places[columns, 1]
        role = tape.roles
        primal = (role == PRIMAL) | (role == POSITION)
        self._in_A = np.flatnonzero((role[self._row] == DUAL) & primal[self._column])
        self._in_diagonal = np.flatnonzero(primal[self._row] & (rows == columns))
        self.primal, self.dual = primal, role == DUAL
        self._chain = network.chain_rows
        self._data = np.zeros(len(rows))

    def at(self, x: np.ndarray) -> Linearisation:
        """The linearisation at a state ``x`` (n,); it shares all but the numbers with this one."""
        still = np.where(self.dual[self.network.places[:, 0]], 0.0, x)
        linear = copy(self)
        linear._data = self.evaluator.jacobian_entries(still)
        return linear

    @property
    def members(self) -> tuple[Linearisation, ...]:
        """Itself: one state."""
        return (self,)

    def row_sums(self, weight: np.ndarray) -> np.ndarray:
        """sum_i w_i A_ij^2 as (P, N); ``weight`` is (P,)."""
        e = self._in_A
        return self._added_up(self._column[e], self._column_stage[e], weight[self._row[e]])

    def column_sums(self, weight: np.ndarray) -> np.ndarray:
        """sum_j A_ij^2 T_j as (P, N); ``weight`` is T, (P,)."""
        e = self._in_A
        return self._added_up(self._row[e], self._row_stage[e], weight[self._column[e]])

    def _added_up(self, neuron: np.ndarray, stage: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Weighted squares of the entries of A, (P, N): by the neuron and stage of each."""
        shape = self.network.live.shape
        place = neuron * shape[1] + stage
        squares = weight * self._data[self._in_A] ** 2
        return np.bincount(place, squares, minlength=shape[0] * shape[1]).reshape(shape)

    def cost_curvature(self) -> np.ndarray:
        """H_jj as (P, N), zero for duals."""
        e = self._in_diagonal
        total = np.zeros(self.network.live.shape)
        total[self._column[e], self._column_stage[e]] = -self._data[e]
        return total

    def stage_matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(F, H_qq, H_tt), each (N, C, C): df/dq and the cost's Hessians in q and t, by stage."""
        states, targets = self._chain.T
        maps = [self.network.neuron_index[d.neuron] for d in self.network.cell.duals]
        return (
            self._stage_block(maps[: len(states)], states),
            -self._stage_block(states, states),
            -self._stage_block(targets, targets),
        )

    def control_matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """(B, R): df/du (N, C, m) by stage, and the cost's largest curvature (m,) in each control.

        Controls are the primal neurons that belong to no chain.
        """
        inside = np.zeros_like(self.primal)
        inside[self._chain] = True
        controls = np.flatnonzero(self.primal & ~inside)
        maps = [self.network.neuron_index[d.neuron] for d in self.network.cell.duals]
        curvature = np.maximum(self.cost_curvature()[controls].max(axis=1, initial=0.0), 0.0)
        return self._stage_block(maps[: len(self._chain)], controls), curvature

    def _stage_block(self, rows, columns) -> np.ndarray:
        """The Jacobian's blocks (N, C, C) of some neurons by others of the same stage."""
        row_place, column_place = (-np.ones(len(self.network.live), int) for _ in range(2))
        row_place[rows], column_place[columns] = np.arange(len(rows)), np.arange(len(columns))
        r, c = row_place[self._row], column_place[self._column]
        e = (r >= 0) & (c >= 0) & (self._row_stage == self._column_stage)
        block = np.zeros((self.network.stages, len(rows), len(columns)))
        block[self._row_stage[e], r[e], c[e]] = self._data[e]
        return block


class MeanLinearisation:
    """Linearisations of networks that differ in their inputs, as one: squares are averaged.

    Parameters
    ----------
    members : sequence of Linearisation
        At a state of each; of networks with the same wiring.

    Attributes
    ----------
    network : Network
        That of the first member.
    primal, dual : (P,) arrays of bool
    """

    def __init__(self, members: Sequence[Linearisation]) -> None:
        self.members = tuple(members)
        first = self.members[0]
        self.network, self.primal, self.dual = first.network, first.primal, first.dual

    def row_sums(self, weight: np.ndarray) -> np.ndarray:
        """Mean of sum_i w_i A_ij^2, (P, N); ``weight`` is (P,)."""
        return np.mean([member.row_sums(weight) for member in self.members], axis=0)

    def column_sums(self, weight: np.ndarray) -> np.ndarray:
        """Mean of sum_j A_ij^2 T_j, (P, N); ``weight`` is T, (P,)."""
        return np.mean([member.column_sums(weight) for member in self.members], axis=0)

    def cost_curvature(self) -> np.ndarray:
        """Mean of H_jj, (P, N), zero for duals."""
        return np.mean([member.cost_curvature() for member in self.members], axis=0)

    def stage_matrices(self) -> tuple[np.ndarray, ...]:
        """Means of (F, H_qq, H_tt), each (N, C, C)."""
        every = [member.stage_matrices() for member in self.members]
        return tuple(np.mean(matrices, axis=0) for matrices in zip(*every))

    def control_matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Means of (B, R), (N, C, m) and (m,)."""
        B, R = zip(*(member.control_matrices() for member in self.members))
        return np.mean(B, axis=0), np.mean(R, axis=0)
