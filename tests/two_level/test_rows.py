"""Rows of the two levels."""

import pytest

from ann_dc.errors import NetworkError
from ann_dc.network import Cell, Connection, Network, Neuron
from ann_dc.two_level import Gradient, NewtonCoordinator, TwoLevelLayer


def test_a_network_without_a_problem_has_no_levels():
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="t")),
        connections=(Connection(source="x", target="x", weight=-1.0),),
    )
    network = Network(cell=cell, stages=2, title="by hand")
    for upper in (Gradient(lambda_t=0.1, lambda_beta=0.1), NewtonCoordinator()):
        with pytest.raises(NetworkError, match="by hand has no q, u, mu, beta;"):
            TwoLevelLayer(network, upper=upper)
