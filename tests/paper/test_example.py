"""The paper's example as a whole network: (16), (17) to the letter have neither rho nor gains."""

import numpy as np
import pytest

from ann_dc.backends.status import Outcome
from ann_dc.evaluation.reference import evaluator
from ann_dc.paper.example import demonstrations
from ann_dc.problem import plants
from ann_dc.solver import solve


@pytest.fixture(scope="module")
def shown():
    return {run.label: run for run in demonstrations(solve(plants.car()))}


@pytest.mark.slow
def test_to_the_letter_there_is_no_penalty(shown):
    """m = mu and b = beta whatever the residuals; with designed gains they read these too."""
    for label, equal in (("printed D=1", True), ("printed, designed gains", False)):
        network = shown[label].solution.network
        x = np.random.default_rng(0).standard_normal(network.size)
        values, nodes = evaluator(network).values(x), network.node_index
        for dual in network.cell.duals:
            carried = values[nodes[dual.multiplier], 1:-1]
            own = network.unpack(x)[network.neuron_index[dual.neuron]]
            assert np.array_equal(carried, own) == equal, (label, dual.neuron)


def test_neither_way_does_the_printed_form_settle(shown):
    for label in ("printed D=1", "printed, designed gains"):
        solution = shown[label].solution
        assert solution.status.outcome in (Outcome.DIVERGED, Outcome.LEFT_DOMAIN), label
        assert not solution.certified


def test_without_the_control_jacobian_the_plan_is_straight(shown):
    solution = shown["without dB/dq"].solution
    x, y = solution["x"][:-1], solution["y"][:-1]
    np.testing.assert_allclose(y, x * y[-1] / x[-1], atol=0.02)
    assert solution.rollout_error > 0.5


def test_the_plain_network_leaves_the_optimum(shown):
    assert shown["plain D=1"].remark.startswith("started 1% from the optimum")
    assert not shown["plain D=1"].solution.status.settled
