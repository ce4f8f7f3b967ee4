"""Rows of the two levels."""

import re
from dataclasses import replace

import pytest

from ann_dc.errors import NetworkError, ProblemError
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.solver import synthesize
from ann_dc.two_level.coordination import coordinate
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.upper_level import Gradient, NewtonCoordinator


def test_a_network_without_a_problem_has_no_levels():
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="t")),
        connections=(Connection(source="x", target="x", weight=-1.0),),
    )
    network = Network(cell=cell, stages=2, title="by hand")
    for upper in (Gradient(lambda_t=0.1, lambda_beta=0.1), NewtonCoordinator()):
        with pytest.raises(NetworkError, match="by hand has no q, u, mu, beta;"):
            TwoLevels(network, upper=upper)


def with_neurons(network: Network, *neurons: Neuron) -> Network:
    cell = replace(network.cell, neurons=neurons)
    return replace(network, cell=cell, start={})


def test_a_network_with_neurons_of_neither_level_is_refused():
    network = synthesize(plants.double_integrator(N=3))
    other = with_neurons(network, *network.cell.neurons, Neuron(name="z.disc"))
    with pytest.raises(NetworkError, match=r"has z\.disc for inequalities or limits"):
        TwoLevels(other, upper=NewtonCoordinator())


def test_a_network_with_rails_is_refused():
    network = synthesize(plants.double_integrator(N=3))
    neurons = (
        replace(neuron, limiter=Limiter(high=1.0)) if neuron.name == "u.a" else neuron
        for neuron in network.cell.neurons
    )
    with pytest.raises(NetworkError, match=r"has u\.a for inequalities or limits"):
        TwoLevels(with_neurons(network, *neurons), upper=NewtonCoordinator())


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("g1", lambda x, a: {"constraints": [x <= 2]}),
        ("near", lambda x, a: {"terminal_constraints": {"near": x**2 <= 2}}),
        ("a", lambda x, a: {"bounds": {a: (-9, 9)}}),
    ],
)
def test_a_problem_with_inequalities_or_bounds_is_refused_by_name(name, change):
    problem = plants.double_integrator(N=3)
    limited = replace(problem, **change(problem.states[0], problem.controls[0]))
    words = re.escape(f"two levels: double_integrator has inequalities or bounds ({name})")
    with pytest.raises(ProblemError, match=f"^{words}.*solve"):
        coordinate(limited)
