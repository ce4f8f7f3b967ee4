"""What remembering the last steps brings, and what it must not do."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from designs import designed
from problems import SUITE
from recurrent_runs import QUICK, RECURRENT, assert_same_end, ode, suited, wire

from ann_dc.backends.integration.integrator import SETTLED
from ann_dc.backends.layers.flow import Reading
from ann_dc.backends.layers.memory import Memory, Proposal
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.step_rules import SIMULTANEOUS, STAGE_BY_STAGE, TWO_PHASE, Anderson, FixedStep
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Cell, Neuron, Product, Template
from ann_dc.network.network import Network
from ann_dc.solution.solution import certificate_of


@pytest.mark.sampled(2)
@pytest.mark.parametrize("order", [SIMULTANEOUS, TWO_PHASE], ids=repr)
@pytest.mark.parametrize(
    "name",
    [
        n if n in ("car", "double_integrator") else pytest.param(n, marks=pytest.mark.slow)
        for n in QUICK
    ],
)
def test_accelerated(name, order):
    """From nearby: what remembers may jump to another optimum."""
    network, end = suited(name).network, ode(name).trajectory.final
    near = network.with_start(end + 0.1 * (network.start_state - end))
    run = replace(RECURRENT, order=order, acceleration=Anderson()).run(near)
    assert_same_end(run, end)
    assert run.steps < replace(RECURRENT, order=order).run(near).steps


def double_well(start: float) -> Network:
    """x' = x - x^3: rests at -1 and 1, and stands on the hill between them at 0."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Product(name="xx", a="x", b="x"), Product(name="xxx", a="xx", b="x")),
        connections=(wire("x", "x"), wire("xxx", "x", -1.0)),
    )
    return Network(cell=cell, stages=1, start={"x": start})


@pytest.mark.sampled(2)
@pytest.mark.parametrize("start", [-0.2, 0.01, 0.3])
def test_acceleration_does_not_rest_on_a_hill(start):
    run = RecurrentBackend(acceleration=Anderson()).run(double_well(start))
    assert run.status.settled
    assert run.trajectory.final == pytest.approx(np.sign(start))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["pendulum", "pendulum_state_cost"])
def test_acceleration_does_not_settle_at_a_saddle_of_the_kkt_conditions(name):
    """Alone it would: Anderson finds any root of the drives."""
    network = designed(name).network
    end = RecurrentLayer(network, acceleration=Anderson()).settle()
    assert end.settled.tolist() == [True]
    assert certificate_of(SUITE[name].problem, network, end.states[0].numpy()).certified


def leaky_line(stages: int) -> Network:
    """A line of leaky nodes with time constants of their own, driven by a current."""
    taus = 1.0 + 0.3 * np.cos(np.arange(stages))
    cell = Cell(
        neurons=(Neuron(name="v", tau=taus),),
        inputs=("current",),
        connections=(
            wire("v", "v", -2.2),
            wire("v", "v", template=Template.PREVIOUS),
            wire("v", "v", template=Template.NEXT),
            wire("current", "v"),
        ),
    )
    return Network(cell=cell, stages=stages, inputs={"current": np.sin(np.arange(stages) + 1.0)})


@pytest.mark.parametrize("order", [SIMULTANEOUS, STAGE_BY_STAGE], ids=repr)
@pytest.mark.parametrize("stages", [1, 2, 3, 4, 5])
def test_on_a_linear_flow_as_many_steps_as_neurons(order, stages):
    """It is GMRES: n differences span the space, and the next state is the solution."""
    network = leaky_line(stages)
    layer = RecurrentLayer(
        network, order=order, step=FixedStep(step=0.3), acceleration=Anderson(memory=8)
    )
    end = layer.settle(settling=Settling(tolerance=1e-6, confirm=0.1), limit=60)
    assert end.codes.tolist() == [SETTLED]
    assert end.steps[0] <= stages + 2
    matrix = evaluator(network).jacobian(np.zeros(stages))
    expected = np.linalg.solve(-matrix, evaluator(network).rhs(np.zeros(stages)))
    np.testing.assert_allclose(end.states[0], expected, atol=1e-6)


class Secant:
    """One neuron, m(x) = 2 - x, accelerated by hand with steps of a tenth."""

    def __init__(self, acceleration: Anderson) -> None:
        self.memory = Memory.of(acceleration, self.shaped(0.0), rates=self.shaped(1.0))
        self.x = 0.0

    @staticmethod
    def shaped(value: float) -> torch.Tensor:
        return torch.full((1, 1, 1), value, dtype=torch.float64)

    def step(self, *, energy=1.0, rejected=False, cut=False) -> float:
        one, derivative = torch.ones(1, dtype=torch.float64), self.shaped(2.0 - self.x)
        proposal = Proposal(
            state=self.shaped(self.x),
            step=0.1 * one,
            reading=Reading(arguments=[], drives=derivative),
            derivative=derivative,
            energy=energy * one,
            rejected=one.bool() & rejected,
        )
        self.memory, state = self.memory.next(proposal, one.bool() & cut)
        self.x = float(state)
        return self.x

    def rejects(self, energy: float) -> bool:
        return bool(self.memory.rejects(torch.tensor([energy])))


def test_in_one_dimension_it_is_the_secant():
    run = Secant(Anderson(memory=3))
    assert run.step() == pytest.approx(0.2)  # nothing remembered: a plain step
    assert run.step() == pytest.approx(2.0, rel=1e-8)


def test_only_accelerated_steps_are_taken_back():
    run = Secant(Anderson(rise=1.2))
    run.step(energy=1.0)
    assert not run.rejects(float("inf"))
    run.step(energy=1.0)
    assert not run.rejects(1.19)
    assert run.rejects(1.21)
    assert run.rejects(float("inf"))


def test_a_step_taken_back_goes_on_from_the_last_state():
    run = Secant(Anderson())
    run.step()
    before = run.x
    run.step()  # the secant's, to 2
    run.x = 50.0  # as if it had led astray
    assert run.step(energy=100.0, rejected=True) == pytest.approx(before + 0.1 * (2 - before))
    for forgotten in (run.memory.states, run.memory.derivatives, run.memory.gram):
        assert not forgotten.any()
    assert not run.rejects(float("inf"))  # the next one is plain
    x = run.x
    assert run.step() == pytest.approx(x + 0.1 * (2 - x))
    assert run.step() == pytest.approx(2.0, rel=1e-8)


def test_after_a_cut_it_waits_until_the_energy_is_halved():
    run = Secant(Anderson(resume=0.5))
    run.step(energy=1.0)
    for energy, cut in ((1.0, True), (0.9, False), (0.51, False)):
        x = run.x
        assert run.step(energy=energy, cut=cut) == pytest.approx(x + 0.1 * (2 - x))
        assert not run.rejects(float("inf"))
    assert run.step(energy=0.49) == pytest.approx(2.0, rel=1e-6)
