"""Linearisation of a network for gain design: A, H and the stage matrices F.

All quantities come from the network's exact Jacobian, evaluated with rho = 0. The rows of the duals
are A = dc/dz; with the duals at zero, the rows of the primal neurons are -H of the cost alone. The
gradients of inequalities are -G' in the columns of the diode neurons, with every diode open; the
caller decides which diodes conduct. Each of several objectives has at least an equal weight in H,
since an objective that is not the largest may become so.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.reference import evaluator, tape_with_penalty
from ann_dc.evaluation.rules import DUAL, POSITION, PRIMAL
from ann_dc.network.network import Network

OPEN = 1e-100
"""State of a diode neuron with an open diode and a negligible multiplier."""


class Linearisation:
    """A, H and the stage matrices of a network at a state set by `at`.

    Parameters
    ----------
    network : Network
        Network with PI duals; its penalties are ignored.

    Attributes
    ----------
    evaluator : FastEvaluator
        Of the network with rho = 0.
    primal, dual, diode : (P,) arrays of bool
        Roles of the neurons of the cell; ``dual`` are those of equalities.
    shares : (p,) array of int
        Components of the state vector that are weights of objectives.
    z, g : (P, N) arrays
        State of a diode neuron and value of its inequality, in the neuron's row.
    price, compliance : (P, N) arrays
        Penalty weight and compliance of soft constraints by diode neuron; otherwise infinite and
        zero.
    temperature : float
        Temperature of objectives, in the network's unit of cost.

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
        diodes = [
            (index[d.neuron], network.node_index[d.residual]) for d in network.cell.inequality_duals
        ]
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
        """Return the linearisation at a state ``x`` (n,); only the numbers are not shared."""
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

    def is_active(self, weights: np.ndarray) -> np.ndarray:
        """Return the constraints active at the state, (P, N) of bool, for weights (P,).

        Equalities are always active. A diode conducts if z + w g is above zero and below the
        penalty weight of a soft constraint, at which the multiplier does not move.
        """
        drawn = self.z + weights[:, None] * self.g
        return ~self.diode[:, None] | ((drawn > 0) & (drawn < self.price))

    @property
    def members(self) -> tuple[Linearisation, ...]:
        """Tuple that contains only this linearisation (one state)."""
        return (self,)

    def row_sums(self, weight: np.ndarray) -> np.ndarray:
        """Return sum_i w_i A_ij^2 (P, N) of all constraints; ``weight`` is (P,) or (P, N)."""
        of_row = _entries_of(weight, self._A_row, self._A_row_stage)
        return self._added_up(self._A_column, self._A_column_stage, of_row)

    def column_sums(self, weight: np.ndarray) -> np.ndarray:
        """Return sum_j A_ij^2 T_j (P, N), inequalities included; ``weight`` is T, (P,)."""
        of_column = _entries_of(weight, self._A_column, self._A_column_stage)
        return self._added_up(self._A_row, self._A_row_stage, of_column)

    def _added_up(self, neuron: np.ndarray, stage: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return the weighted squares of A's entries, summed by neuron and stage (P, N)."""
        shape = self.network.live.shape
        place = neuron * shape[1] + stage
        squares = weight * self._data[self._of_A] ** 2
        return np.bincount(place, squares, minlength=shape[0] * shape[1]).reshape(shape)

    def cost_curvature(self) -> np.ndarray:
        """Return H_jj (P, N), zero for duals."""
        e = self._in_diagonal
        total = np.zeros(self.network.live.shape)
        total[self._column[e], self._column_stage[e]] = -self._data[e]
        return total

    def stage_matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return F = df/dq, and the cost's Hessians H_qq and H_tt, (N, C, C) by stage."""
        states, targets = self._chain.T
        maps = [self.network.neuron_index[d.neuron] for d in self.network.cell.duals]
        return (
            self._stage_block(maps[: len(states)], states),
            -self._stage_block(states, states),
            -self._stage_block(targets, targets),
        )

    def objective_slopes(self) -> np.ndarray:
        """Return the gradients (p, P, N) of the objectives over the primal neurons."""
        objectives, live = self.network.cell.objectives, self.network.live
        slopes = np.zeros((len(objectives), *live.shape))
        for own, objective in enumerate(objectives):
            measure = self.network.neuron_index[objective.measure]
            e = np.flatnonzero((self._row == measure) & self.primal[self._column])
            slopes[own, self._column[e], self._column_stage[e]] = self._data[e]
        return slopes

    def inequality_matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the diode neurons (d,) and dg/dq, dg/dt (N, d, C) by stage."""
        states, targets = self._chain.T
        of_q, of_t = (-self._stage_block(of, self._diodes) for of in (states, targets))
        return self._diodes, of_q.transpose(0, 2, 1), of_t.transpose(0, 2, 1)

    def control_matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Return df/du (N, C, m) by stage and the largest cost curvature (m,) per control.

        Controls are the primal neurons that belong to no chain.
        """
        inside = np.zeros_like(self.primal)
        inside[self._chain] = True
        controls = np.flatnonzero(self.primal & ~inside)
        maps = [self.network.neuron_index[d.neuron] for d in self.network.cell.duals]
        curvature = np.maximum(self.cost_curvature()[controls].max(axis=1, initial=0.0), 0.0)
        return self._stage_block(maps[: len(self._chain)], controls), curvature

    def _stage_block(self, rows, columns) -> np.ndarray:
        """Return the Jacobian's blocks (N, C, C) between neurons of the same stage."""
        row_place, column_place = (-np.ones(len(self.network.live), int) for _ in range(2))
        row_place[rows], column_place[columns] = np.arange(len(rows)), np.arange(len(columns))
        r, c = row_place[self._row], column_place[self._column]
        e = (r >= 0) & (c >= 0) & (self._row_stage == self._column_stage)
        block = np.zeros((self.network.stages, len(rows), len(columns)))
        block[self._row_stage[e], r[e], c[e]] = self._data[e]
        return block


def softness(network: Network, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return penalty weight and compliance (P, N) of the diode neurons.

    The values are infinite and zero for hard constraints. `weights` (E, N) are those of the
    network's connections.
    """
    price, compliance = np.full(network.live.shape, np.inf), np.zeros(network.live.shape)
    edges = evaluator(network).edges
    for diode in network.cell.inequality_duals:
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
    """Return the entries of a weight (P,) per neuron or (P, N) per neuron and stage."""
    return weight[neuron] if weight.ndim == 1 else weight[neuron, stage]


class MeanLinearisation:
    """Mean of linearisations at a state each, of equal wiring and different inputs.

    Squares are averaged. `network` is that of the first member.
    """

    def __init__(self, members: Sequence[Linearisation]) -> None:
        self.members = tuple(members)
        first = self.members[0]
        self.network, self.primal = first.network, first.primal
        self.dual, self.diode = first.dual, first.diode

    def row_sums(self, weight: np.ndarray) -> np.ndarray:
        """Return the mean of sum_i w_i A_ij^2 (P, N); ``weight`` is (P,) or (P, N)."""
        return np.mean([member.row_sums(weight) for member in self.members], axis=0)

    def column_sums(self, weight: np.ndarray) -> np.ndarray:
        """Return the mean of sum_j A_ij^2 T_j (P, N); ``weight`` is T, (P,)."""
        return np.mean([member.column_sums(weight) for member in self.members], axis=0)

    def cost_curvature(self) -> np.ndarray:
        """Return the mean of H_jj (P, N), zero for duals."""
        return np.mean([member.cost_curvature() for member in self.members], axis=0)

    def stage_matrices(self) -> tuple[np.ndarray, ...]:
        """Return the means of (F, H_qq, H_tt), each (N, C, C)."""
        every = [member.stage_matrices() for member in self.members]
        return tuple(np.mean(matrices, axis=0) for matrices in zip(*every))

    def control_matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the means of (B, R), (N, C, m) and (m,)."""
        B, R = zip(*(member.control_matrices() for member in self.members))
        return np.mean(B, axis=0), np.mean(R, axis=0)
