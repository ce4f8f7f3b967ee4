r"""Gains of a preconditioner that is the inverse of a stiffness between neighbours.

With H the Hessian of the Lagrangian and A the constraints' Jacobian at the settled point, A_0 the
Jacobian at the initial guess, and the constraint weights w_i,

.. math::
    M = (H + A^T W A + \theta D)^{-1}, \quad D_{jj} = \sum_i W_i (A_{ij} - A_{0,ij})^2, \quad
    W = c\, w, \quad c = \max\big(1.3\, \lambda_{max}(-Q_w), \tfrac14 \lambda_{max}(Q_w)\big),

where Q_w is the inverse Schur complement (A H^-1 A')^-1 in units of the weights. c makes the
stiffness positive definite (penalty above rho*) and the multipliers as fast as the rest. D damps
changes of A along the trajectory, so that the initial guess is not stiffer than the end. The duals'
rates are eta W.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.saddle import Saddle, saddle_of, threshold_of
from ann_dc.errors import DesignError
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.evaluation.tape import STATE, Tape
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE, GainRule, closed_form, weights_of_rows
from ann_dc.gain_design.gains import Gains, tape_with
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid
from ann_dc.network.preconditioners.stiffness import Stiffness

_ABOVE_THRESHOLD = 1.3
"""Smallest ratio of a grid's penalty to rho*."""
_OF_SHADOW = 0.25
"""Smallest ratio of a grid's penalty to the largest inverse Schur complement."""


@dataclass(frozen=True, eq=False)
class SettledPoint:
    """Settled point `state` (n,), with the linearisation that determines the gains.

    Weights and inverse Schur complements are cached, since all candidates use the same few.
    """

    linear: Linearisation
    state: np.ndarray
    _weights: dict[object, np.ndarray] = field(default_factory=dict, init=False, repr=False)
    _shadows: dict[bytes, tuple[float, float]] = field(default_factory=dict, init=False, repr=False)
    _stiff: dict[bytes, Any] = field(default_factory=dict, init=False, repr=False)
    _tapes: WeakKeyDictionary[Gains, Tape] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )

    @property
    def network(self) -> Network:
        """Network of the state."""
        return self.linear.network

    @cached_property
    def saddle(self) -> Saddle:
        """H and A at the settled point."""
        return saddle_of(self.network, self.state)

    @cached_property
    def changes(self) -> Any:
        """Elementwise (A - A_0)^2 (d, z), with A_0 at the network's initial guess."""
        start = saddle_of(self.network, self.network.start_state, among=self.saddle)
        change = self.saddle.A - start.A
        return sparse.csr_array(change.multiply(change))

    @cached_property
    def saturated(self) -> np.ndarray:
        """Saturated neurons, (n,) of bool."""
        evaluator = fast_evaluator(self.network)
        return evaluator.saturated(self.state, evaluator.drives(self.state))

    @cached_property
    def primal(self) -> np.ndarray:
        """Components (z,) of all primal neurons, saturated ones included."""
        return np.flatnonzero(self.linear.primal[self.network.places[:, 0]])

    @cached_property
    def _evaluator(self) -> FastEvaluator:
        return fast_evaluator(self.network)

    def trial(self, gains: Gains) -> FastEvaluator:
        """Return an evaluator with other gains, of which only a tape is made.

        The evaluator is shared and valid until the next call.
        """
        if gains not in self._tapes:
            self._tapes[gains] = tape_with(self.network, gains)
        self._evaluator.renumber(self._tapes[gains])
        return self._evaluator

    def augmented(self, penalty: np.ndarray) -> Any:
        """Return H + A'WA (z, z), sparse, for penalties (d,) of the constraints."""
        key = penalty.tobytes()
        if key not in self._stiff:
            A = self.saddle.A
            self._stiff[key] = self.saddle.H + A.T @ (sparse.diags_array(penalty) @ A)
        return self._stiff[key]

    def row_weights(self, gain_rule: GainRule) -> np.ndarray:
        """Return read-only constraint weights (P,) of the duals; see `weights_of_rows`."""
        key = (
            gain_rule.equilibration_sweeps,
            gain_rule.by_reachability,
            gain_rule.inequality,
            frozenset(gain_rule.row_factors.items()),
        )
        if key not in self._weights:
            self._weights[key] = _with_diodes(self.linear, gain_rule)
            self._weights[key].setflags(write=False)
        return self._weights[key]

    def sensitivity_range(self, weights: np.ndarray) -> tuple[float, float]:
        """Return the range of the inverse Schur complement; see `Saddle.sensitivity_range`."""
        key = weights.tobytes()
        if key not in self._shadows:
            self._shadows[key] = self.saddle.sensitivity_range(weights)
        return self._shadows[key]


def boost_of(settled: SettledPoint) -> float:
    """Return the factor that raises closed-form penalties above rho*, at least one.

    `settled` is an optimum at which no run has settled, so that no watchdog has raised its
    penalties.
    """
    duals = [settled.network.neuron_index[dual.neuron] for dual in settled.network.cell.duals]
    penalties = closed_form(settled.linear, MULTILEVEL_RULE).rho[duals]
    least = _ABOVE_THRESHOLD * threshold_of(settled.saddle) / penalties.mean()
    return max(1.0, least) if np.isfinite(least) else 1.0


def _with_diodes(linear: Linearisation, gain_rule: GainRule) -> np.ndarray:
    """Return all weights (P,), inequalities relative to equalities as in closed form."""
    weights = weights_of_rows(linear, gain_rule)
    if linear.diode.any():
        own = {
            "equilibration_sweeps": gain_rule.equilibration_sweeps,
            "inequality": gain_rule.inequality,
        }
        rho = closed_form(linear, replace(MULTILEVEL_RULE, **own)).rho
        duals = [linear.network.neuron_index[d.neuron] for d in linear.network.cell.duals]
        weights[linear.diode] = rho[linear.diode] * weights[duals].mean() / rho[duals].mean()
    return weights


def grid_gains_of(
    points: Sequence[SettledPoint],
    weights: np.ndarray,
    gain_rule: GainRule,
    penalty_factor: float = 1.0,
) -> Gains:
    """Return gains with a resistive grid, or with cyclic reduction of the same matrix.

    The stiffnesses of several points, one per input, are averaged. ``weights`` (P,) are those of
    the dual neurons' constraints; kind, path term, penalty and eta are the rule's. Raises
    `DesignError` if the penalty lies below rho*, so that the stiffness is not positive definite.
    """
    network = points[0].network
    _check(network, gain_rule.kind)
    low, high = _shadow_range(points, weights)
    common = max(-_ABOVE_THRESHOLD * low, _OF_SHADOW * high)
    if not 0 < common < np.inf:  # no multiplier answers a push: any penalty will do
        common = 1.0
    common *= gain_rule.penalty * penalty_factor
    if not common > -low:
        raise DesignError(
            f"{network.title}: a {gain_rule.kind.value} needs penalties above rho* = {-low:.3g} "
            f"times the row weights, got {common:.3g}; use a gain rule with penalty > "
            f"{-low / common * gain_rule.penalty:.3g} instead of {gain_rule.penalty:g}"
        )
    rho = common * weights
    G = sum(_felt(settled, rho, gain_rule.path_weight) for settled in points) / len(points)
    diagonal, stiffness = stiffness_of(network, G, gain_rule.kind)
    eta = [
        gain_rule.dual_coupling if neuron.population == "beta" else gain_rule.dual
        for neuron in network.cell.neurons
    ]
    rate = np.broadcast_to((eta * rho)[:, None], network.live.shape).copy()
    place = network.places[points[0].primal]
    rate[place[:, 0], place[:, 1]] = 1 / diagonal
    return Gains(rho=rho, rate=np.where(rate > 0, rate, 1.0), preconditioner=stiffness)


def _felt(settled: SettledPoint, rho: np.ndarray, path: float) -> Any:
    """Return the stiffness (z, z) over all primal neurons, sparse.

    The stiffness is H + A'WA plus the path term; a saturated neuron has only a diagonal entry, by
    Jacobi's rule.
    """
    saddle, place = settled.saddle, settled.network.places
    penalty = rho[place[saddle.dual, 0]]
    G = sparse.coo_array(
        settled.augmented(penalty) + sparse.diags_array(path * (settled.changes.T @ penalty))
    )
    free = np.searchsorted(settled.primal, saddle.primal)
    saturated = np.setdiff1d(np.arange(len(settled.primal)), free)
    linear, neuron = settled.linear, place[settled.primal[saturated], 0]
    curvature = np.maximum(linear.cost_curvature(), 0.0).max(axis=1)
    own = (curvature + linear.row_sums(rho).max(axis=1))[neuron]
    own = np.where(own > 0, own, 1.0)
    rows, columns = G.coords
    at = np.concatenate([free[rows], saturated]), np.concatenate([free[columns], saturated])
    size = len(settled.primal)
    return sparse.csr_array(
        sparse.coo_array((np.concatenate([G.data, own]), at), shape=(size, size))
    )


def _shadow_range(points: Sequence[SettledPoint], weights: np.ndarray) -> tuple[float, float]:
    """Return the range of the inverse Schur complement at all points, weights (P,).

    The range is zero if no neuron is free, or if constraints are dependent.
    """
    ends = []
    for settled in points:
        row = weights[settled.network.places[settled.saddle.dual, 0]]
        try:
            ends.append(settled.sensitivity_range(row))
        except (np.linalg.LinAlgError, RuntimeError) as error:
            if not settled.saturated.any():
                raise DesignError(
                    f"{points[0].network.title}: the settled point is not isolated (its KKT "
                    "matrix is singular), so a resistive grid is not defined; use a multilevel "
                    "preconditioner"
                ) from error
            ends.append((0.0, 0.0))
    found = [pair for pair in ends if np.isfinite(pair).all()] or [(0.0, 0.0)]
    return min(low for low, _ in found), max(high for _, high in found)


def _check(network: Network, kind: PreconditionerKind) -> None:
    """Raise `DesignError` if a network has neurons that H and A do not contain."""
    tape = fast_evaluator(network).tape
    if (tape.roles == STATE).any() or network.cell.objectives:
        raise DesignError(
            f"{network.title}: has neurons that are neither primal nor dual, for which a "
            f"{kind.value} is not defined; use a multilevel preconditioner"
        )


def stiffness_of(
    network: Network, G: Any, kind: PreconditionerKind = PreconditionerKind.RESISTIVE_GRID
) -> tuple[np.ndarray, Stiffness]:
    """Return a stiffness between neighbours as a preconditioner, with its time constants.

    G (z, z) is sparse and symmetric positive definite over the primal neurons, in the order of the
    state vector. Its diagonal (z,) becomes their time constants; the `ResistiveGrid` or
    `CyclicReduction` has a unit diagonal. Raises `DesignError` if a diagonal entry is not positive,
    or G couples cells that are not neighbours.
    """
    diagonal = G.diagonal()
    if not (np.isfinite(diagonal).all() and (diagonal > 0).all()):
        raise DesignError(f"{network.title}: a stiffness needs a positive diagonal")
    root = np.sqrt(diagonal)
    entries = sparse.coo_array(G)
    i, j = entries.coords
    values = entries.data / (root[i] * root[j])
    row, place = network.layout, network.places
    live = np.isin(place[:, 0], row.primal)
    neuron = np.searchsorted(row.primal, place[live, 0])
    stage = place[live, 1]
    if (np.abs(stage[i] - stage[j]) > 1).any():
        raise DesignError(f"{network.title}: the cost couples stages that are not neighbours")
    m = len(row.primal)
    own = np.zeros((row.stages, m, m))
    following = np.zeros((row.stages - 1, m, m))
    within, ahead = stage[i] == stage[j], stage[j] == stage[i] + 1
    own[stage[i[within]], neuron[i[within]], neuron[j[within]]] = values[within]
    following[stage[i[ahead]], neuron[i[ahead]], neuron[j[ahead]]] = values[ahead]
    own = 0.5 * (own + own.transpose(0, 2, 1))
    record = CyclicReduction if kind is PreconditionerKind.CYCLIC_REDUCTION else ResistiveGrid
    return diagonal, record(own=own, following=following)
