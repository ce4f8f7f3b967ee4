"""What gain design reads off a network at a state: A, H and the stage matrices F.

Everything comes from the network's exact Jacobian, evaluated with rho = 0: the rows of the duals
are A = dc/dz, and with the duals at zero the rows of the primal neurons are -H of the cost alone.
The rows of inequalities are read off the primal neurons' own, -G' in the columns of the diode
neurons, with every diode open; which of them conduct is for whoever weighs them to say.
Of several objectives each has an equal share of H at least: one that is not the largest may become
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.reference import evaluator, tape_with_penalty
from ann_dc.evaluation.tape import DUAL, POSITION, PRIMAL
from ann_dc.network.network import Network

OPEN = 1e-100
"""State of a diode neuron that opens its diode and presses nothing."""


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
    primal, dual, diode : (P,) arrays of bool
        Which neurons of the cell are what; ``dual`` are those of equalities.
    shares : (p,) array of int
        Components of the state vector that are shares of objectives.
    z, g : (P, N) arrays
        Of a diode neuron, in its row: its state, and the value of its inequality.
    price, compliance : (P, N) arrays
        Of a diode neuron whose row is soft; infinite and zero elsewhere.
    temperature : float
        Of objectives, in the network's unit of cost.

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
        role, index = tape.roles, network.neuron_index
        diodes = [(index[d.neuron], network.node_index[d.residual]) for d in network.cell.diodes]
        self._diodes, self._residuals = np.array(diodes, np.int64).reshape(-1, 2).T
        objectives = network.cell.objectives
        shares = [index[objective.neuron] for objective in objectives]
        self.shares = network.state_index[shares, -1]
        self._equal_share = np.array([o.at_rest(1.0 / len(objectives)) for o in objectives])
        self.primal = (role == PRIMAL) | (role == POSITION)
        self.diode = np.isin(np.arange(len(role)), self._diodes)
        self.dual = (role == DUAL) & ~self.diode
        down = np.flatnonzero(self.dual[self._row] & self.primal[self._column])
        back = np.flatnonzero(self.primal[self._row] & self.diode[self._column])
        self._of_A = np.r_[down, back]
        self._A_row, self._A_row_stage, self._A_column, self._A_column_stage = (
            np.r_[mine[down], its[back]]
            for mine, its in (
                (self._row, self._column),
                (self._row_stage, self._column_stage),
                (self._column, self._row),
                (self._column_stage, self._row_stage),
            )
        )
        self._in_diagonal = np.flatnonzero(self.primal[self._row] & (rows == columns))
        self._chain = network.chain_rows
        self._data = np.zeros(len(rows))
        self.z, self.g = np.zeros(network.live.shape), np.zeros(network.live.shape)
        self.price, self.compliance = softness(network, tape.weights)
        self.temperature = _temperature(network, tape.weights)

    def at(self, x: np.ndarray) -> Linearisation:
        """The linearisation at a state ``x`` (n,); it shares all but the numbers with this one."""
        neuron = self.network.places[:, 0]
        still = np.where(self.dual[neuron], 0.0, np.where(self.diode[neuron], OPEN, x))
        if len(self.shares):
            still[self.shares] = np.maximum(x[self.shares], self._equal_share)
        linear = copy(self)
        linear._data = self.evaluator.jacobian_entries(still)
        if len(self._diodes):
            linear.z, linear.g = np.zeros_like(self.z), np.zeros_like(self.g)
            linear.z[self._diodes] = self.network.unpack(x)[self._diodes]
            linear.g[self._diodes] = self.evaluator.values(x)[self._residuals, 1:-1]
        return linear

    def presses(self, weights: np.ndarray) -> np.ndarray:
        """(P, N) of bool: which rows press at the state, by their weights (P,).

        Those of equalities always do, a diode where it conducts: z + w g is above zero, and below
        the price of a soft row, where the multiplier does not move.
        """
        drawn = self.z + weights[:, None] * self.g
        return ~self.diode[:, None] | ((drawn > 0) & (drawn < self.price))

    @property
    def members(self) -> tuple[Linearisation, ...]:
        """Itself: one state."""
        return (self,)

    def row_sums(self, weight: np.ndarray) -> np.ndarray:
        """sum_i w_i A_ij^2 as (P, N), inequalities among the rows; ``weight`` is (P,) or (P, N)."""
        of_row = _entries_of(weight, self._A_row, self._A_row_stage)
        return self._added_up(self._A_column, self._A_column_stage, of_row)

    def column_sums(self, weight: np.ndarray) -> np.ndarray:
        """sum_j A_ij^2 T_j as (P, N), inequalities among the rows; ``weight`` is T, (P,)."""
        of_column = _entries_of(weight, self._A_column, self._A_column_stage)
        return self._added_up(self._A_row, self._A_row_stage, of_column)

    def _added_up(self, neuron: np.ndarray, stage: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Weighted squares of the entries of A, (P, N): by the neuron and stage of each."""
        shape = self.network.live.shape
        place = neuron * shape[1] + stage
        squares = weight * self._data[self._of_A] ** 2
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

    def objective_slopes(self) -> np.ndarray:
        """(p, P, N): slopes of the objectives over the primal neurons."""
        objectives, live = self.network.cell.objectives, self.network.live
        slopes = np.zeros((len(objectives), *live.shape))
        for own, objective in enumerate(objectives):
            measure = self.network.neuron_index[objective.measure]
            e = np.flatnonzero((self._row == measure) & self.primal[self._column])
            slopes[own, self._column[e], self._column_stage[e]] = self._data[e]
        return slopes

    def inequality_matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(rows, dg/dq, dg/dt): the diode neurons (d,), and (N, d, C) each, by stage."""
        states, targets = self._chain.T
        of_q, of_t = (-self._stage_block(of, self._diodes) for of in (states, targets))
        return self._diodes, of_q.transpose(0, 2, 1), of_t.transpose(0, 2, 1)

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


def softness(network: Network, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Price and compliance (P, N) of every diode neuron, infinite and zero where it has none.

    Parameters
    ----------
    network : Network
    weights : (E, N) array
        Of its connections.
    """
    price, compliance = np.full(network.live.shape, np.inf), np.zeros(network.live.shape)
    edges = evaluator(network).edges
    for diode in network.cell.diodes:
        row = network.neuron_index[diode.neuron]
        if diode.rail in edges:
            price[row] = -weights[edges[diode.rail]]
        if diode.leak in edges:
            compliance[row] = -weights[edges[diode.leak]]
    return price, compliance


def _temperature(network: Network, weights: np.ndarray) -> float:
    edges, objectives = evaluator(network).edges, network.cell.objectives
    return max((-float(weights[edges[o.leak], -1]) for o in objectives if o.is_softened), default=0)


def _entries_of(weight: np.ndarray, neuron: np.ndarray, stage: np.ndarray) -> np.ndarray:
    """Of a weight a neuron, (P,), or a neuron and stage, (P, N)."""
    return weight[neuron] if weight.ndim == 1 else weight[neuron, stage]


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
    primal, dual, diode : (P,) arrays of bool
    """

    def __init__(self, members: Sequence[Linearisation]) -> None:
        self.members = tuple(members)
        first = self.members[0]
        self.network, self.primal = first.network, first.primal
        self.dual, self.diode = first.dual, first.diode

    def row_sums(self, weight: np.ndarray) -> np.ndarray:
        """Mean of sum_i w_i A_ij^2, (P, N); ``weight`` is (P,) or (P, N)."""
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
