"""Networks of the suite with each kind of metric, which circuits are built of."""

from functools import cache

import numpy as np
from problems import SUITE
from scipy import sparse

from ann_dc.analysis import Linearisation
from ann_dc.gain_design import (
    Gains,
    Recipe,
    SettledPoint,
    apply_gains,
    design,
    stiffness_of,
)
from ann_dc.network import Network
from ann_dc.network.metrics import Kind
from ann_dc.solver import synthesize

PYRAMIDS = (Kind.PYRAMID, Kind.COUPLED_PYRAMID)
BEYOND = (*PYRAMIDS, Kind.TREE, Kind.GRID)
"""Kinds with wires beyond neighbours, or with nodes of their own."""


@cache
def with_metric(name: str, kind: Kind, horizon: int | None = None) -> Network:
    """A problem of the suite, designed with a kind of metric."""
    problem = SUITE[name].problem
    network = synthesize(problem.with_horizon(horizon) if horizon else problem)
    if kind in PYRAMIDS:
        return design(network, recipe=Recipe(kind=kind)).network
    state = design(network).first.state
    settled = SettledPoint(linear=Linearisation(network).at(state), state=state)
    return apply_gains(network, _with_stiffness(settled, kind))


def _with_stiffness(settled: SettledPoint, kind: Kind) -> Gains:
    """Penalties above rho*, and the inverse of the penalised Hessian for a metric."""
    network, saddle = settled.network, settled.saddle
    low, high = saddle.shadow_range(np.ones(int(saddle.dual.sum())))
    penalty = max(-1.3 * low, high / 4)
    damping = 0.3 * penalty * settled.changes.sum(axis=0)
    G = saddle.H + penalty * (saddle.A.T @ saddle.A) + sparse.diags_array(damping)
    diagonal, metric = stiffness_of(network, sparse.csr_array(G), kind)
    is_dual = settled.linear.dual
    rate = np.where(is_dual[:, None] & network.live, penalty, 1.0)
    place = network.places[saddle.primal]
    rate[place[:, 0], place[:, 1]] = 1 / diagonal
    return Gains(rho=np.where(is_dual, penalty, 0.0), rate=rate, metric=metric)
