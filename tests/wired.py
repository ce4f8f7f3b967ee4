"""Neighbour-wired networks of the suite, which circuits are built of, and cards in a netlist."""

import re
from functools import cache

from problems import SUITE

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.solver import synthesize


@cache
def neighbour_wired(name: str, horizon: int | None = None) -> Network:
    problem = SUITE[name].problem
    problem = problem.with_horizon(horizon) if horizon else problem
    return design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network


@cache
def prepared(differential: bool, horizon: int | None = None):
    """The car, scaled for op amps of 10 MHz."""
    level = macro(differential=differential)
    return SpiceBackend(level=level).prepare(neighbour_wired("car", horizon))


def instances(text: str, kind: str) -> list[str]:
    """Cards of a subcircuit, in cells and at top level."""
    joined = text[text.index("* ---- cells") :].replace("\n+ ", " ")
    return re.findall(rf"^X\S* [^\n]*? {kind}(?: \w+=\S+)*$", joined, re.MULTILINE)
