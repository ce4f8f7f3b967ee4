"""Networks of the suite with each kind of metric, which circuits are built of."""

from functools import cache

from problems import SUITE

from ann_dc.gain_design.procedure import design
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kind
from ann_dc.solver import synthesize

PYRAMIDS = (Kind.PYRAMID, Kind.COUPLED_PYRAMID)
BEYOND = (*PYRAMIDS, Kind.TREE, Kind.GRID)
"""Kinds with wires beyond neighbours, or with nodes of their own."""


@cache
def with_metric(name: str, kind: Kind, horizon: int | None = None) -> Network:
    """A problem of the suite, designed with a kind of metric."""
    problem = SUITE[name].problem
    network = synthesize(problem.with_horizon(horizon) if horizon else problem)
    return design(network, kinds=(kind,)).network
