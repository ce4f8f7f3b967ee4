"""Networks of the suite with each kind of preconditioner, which circuits are built of."""

from functools import cache

from problems import SUITE

from ann_dc.gain_design.procedure import design
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.solver import synthesize

PYRAMIDS = (PreconditionerKind.MULTILEVEL, PreconditionerKind.COUPLED_MULTILEVEL)
BEYOND = (*PYRAMIDS, PreconditionerKind.CYCLIC_REDUCTION, PreconditionerKind.RESISTIVE_GRID)
"""Kinds with wires beyond neighbours, or with nodes of their own."""


@cache
def with_preconditioner(name: str, kind: PreconditionerKind, horizon: int | None = None) -> Network:
    """A problem of the suite, designed with a kind of preconditioner."""
    problem = SUITE[name].problem
    network = synthesize(problem.with_horizon(horizon) if horizon else problem)
    return design(network, preconditioner=(kind,)).network
