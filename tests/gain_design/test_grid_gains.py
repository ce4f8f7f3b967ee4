"""Settled points: what they keep is what they would compute again."""

from dataclasses import replace

import numpy as np
import pytest
from designs import designed

import ann_dc
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.gain_design.gain_rule import GainRule, weights_of_rows
from ann_dc.gain_design.grid_gains import SettledPoint


@pytest.fixture(scope="module")
def point() -> SettledPoint:
    found = designed("car")
    return SettledPoint(Linearisation(found.network).at(found.state), found.state)


@pytest.mark.parametrize(
    "gain_rule",
    [GainRule(), GainRule(equilibration_sweeps=16), GainRule(row_factors={"mu.x": 3.0})],
)
def test_row_weights_are_those_of_the_recipe(point, gain_rule):
    weights = weights_of_rows(point.linear, gain_rule)
    for _ in range(2):
        assert point.row_weights(gain_rule).tolist() == weights.tolist()
    # the penalty is no part of them
    assert point.row_weights(replace(gain_rule, penalty=2.0)) is point.row_weights(gain_rule)
    with pytest.raises(ValueError, match="read-only"):
        point.row_weights(gain_rule)[0] = 1.0


def test_shadows_are_those_of_the_weights(point):
    ones = np.ones(len(point.saddle.dual))
    for weights in (ones, 4 * ones, ones):
        assert point.sensitivity_range(weights) == point.saddle.sensitivity_range(weights)


def test_a_start_at_a_rail_leaves_the_preconditioner_of_the_settled_point():
    """Controls that begin at their bound, pushed against it, and settle inside: as if free."""
    problem = replace(ann_dc.plants.double_integrator(N=5), bounds={"a": (-10.0, 10.0)})
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    x = ann_dc.OdeBackend().run(network).trajectory.final
    (control,) = (neuron for neuron in network.cell.neurons if neuron.population == "u")
    duals = [n.name for n in network.cell.neurons if n.population in ("mu", "beta")]
    pushed = {
        control.name: control.limiter.high,
        **dict.fromkeys(duals, -100.0 * control.limiter.high),
    }
    started = replace(network, start={**network.start, **pushed})
    assert not fast_evaluator(started).free(started.start_state).all()
    found, expected = (
        SettledPoint(Linearisation(each).at(x), x).changes.toarray() for each in (started, network)
    )
    np.testing.assert_array_equal(found, expected)  # linear: A is the same everywhere
