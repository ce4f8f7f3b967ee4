"""Recurrent runs that several test files look at, and the networks they step."""

from functools import cache

import numpy as np
from designs import designed
from problems import SUITE

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.gain_design.procedure import Design, design
from ann_dc.network.cell import Cell, Connection, Function, Neuron, Template
from ann_dc.network.network import Network
from ann_dc.solver import synthesize

TIGHT = Settling(tolerance=1e-8, confirm=0.1)
RECURRENT = RecurrentBackend(settling=TIGHT)
KINDS = RecurrentBackend().kinds
QUICK = ("car", "double_integrator")


def wire(source: str, target: str, weight=1.0, template=Template.SELF) -> Connection:
    return Connection(source=source, target=target, weight=weight, template=template)


@cache
def suited(name: str) -> Design:
    """A problem of the suite, with a preconditioner that suits the simultaneous order."""
    return design(synthesize(SUITE[name].problem), preconditioner=KINDS)


@cache
def ode(name: str):
    return OdeBackend(verify=False, settling=TIGHT).run(designed(name).network)


@cache
def short(name: str, stages: int = 6) -> Network:
    """A problem of the suite, designed over a few stages."""
    return design(
        synthesize(SUITE[name].problem.with_horizon(stages)), preconditioner=KINDS
    ).network


def assert_same_end(run, expected: np.ndarray, relative=1e-7) -> None:
    assert run.status.outcome is Outcome.SETTLED
    scale = np.abs(expected).max()
    np.testing.assert_allclose(run.trajectory.final, expected, atol=relative * scale)


def pole() -> Network:
    """x' = 1 / x - pull from 3."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("pull",),
        blocks=(Function(name="r", function="reciprocal", x="x"),),
        connections=(wire("r", "x"), wire("pull", "x", -1.0)),
    )
    return Network(cell=cell, stages=1, inputs={"pull": 2.0}, start={"x": 3.0})


def targets(name: str, count: int) -> dict[str, np.ndarray]:
    """Targets and starts around those of a problem of the suite."""
    rng, problem = np.random.default_rng(1), SUITE[name].problem
    first = problem.states[0]
    return {
        f"q_d.{first}": problem.q_d[0] * rng.uniform(0.8, 1.2, count),
        f"q_0.{first}": problem.q_0[0] + rng.uniform(-0.2, 0.2, count),
    }


def growing() -> Network:
    """x' = x + push in the last of three cells, x' = -x + push in the others."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("push",),
        connections=(wire("x", "x", [-1.0, -1.0, 1.0]), wire("push", "x")),
    )
    return Network(cell=cell, stages=3, inputs={"push": 0.0})
