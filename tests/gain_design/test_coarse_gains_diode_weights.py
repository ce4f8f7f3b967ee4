"""Weights of inequality rows: one mode for all that press, and the rows that press among A."""

import numpy as np
import pytest
from constrained import CONSTRAINED

from ann_dc import PreconditionerKind, apply_gains, design, manual_gains, synthesize
from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation
from ann_dc.analysis.saddle import saddle_of
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.coarse_gains import active_weights, diode_weights
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE, closed_form
from ann_dc.gain_design.gains import tape_with

NAMES = ("dint_v", pytest.param("car_disc1", marks=pytest.mark.slow), "lander", "end_disc")


@pytest.fixture(scope="module", params=NAMES)
def settled(request):
    return design(
        synthesize(CONSTRAINED[request.param].problem),
        preconditioner=PreconditionerKind.MULTILEVEL,
    )


@pytest.mark.sampled(2)
def test_a_row_that_presses_alone_has_the_mode_of_an_equality(settled):
    """w sum_j G_ij^2 T_j is one at the stiffest stage that presses, and no more at any other."""
    network = settled.network
    linear = Linearisation(network).at(settled.state)
    rate = np.where(linear.primal, 0.5, 0.0)
    weights, felt = diode_weights(linear, rate), linear.column_sums(rate)
    active = linear.diode[:, None] & (active_weights(linear, weights) > 0) & (felt > 0)
    for row in np.flatnonzero(linear.diode):
        if active[row].any():
            stiffest = (weights[row] * felt[row])[active[row]].max()
            assert stiffest == pytest.approx(1.0)
        assert weights[row] > 0
    assert not weights[~linear.diode].any()


@pytest.mark.sampled(2)
def test_rows_press_where_their_multiplier_does(settled):
    network, linear = settled.network, Linearisation(settled.network).at(settled.state)
    active = active_weights(linear, settled.gains.rho) > 0
    values = evaluator(network).values(settled.state)[:, 1:-1]
    for diode in network.cell.inequality_duals:
        row = network.neuron_index[diode.neuron]
        live = network.live[row]
        conducts = values[network.node_index[diode.multiplier]] > 0
        assert (active[row] == conducts)[live].all()


def test_primal_time_constants_feel_the_rows_that_press(settled):
    """1 / tau = f / (H + A'WA) on the diagonal, by the saddle's own rows."""
    network = settled.network
    linear = Linearisation(network).at(settled.state)
    gains = closed_form(linear, MULTILEVEL_RULE)
    saddle = saddle_of(network, settled.state)
    neuron = network.places[:, 0]
    squares = saddle.A.multiply(saddle.A).T @ gains.rho[neuron[saddle.dual]]
    stiffness = np.zeros(len(network.cell.neurons))
    np.maximum.at(stiffness, neuron[saddle.primal], squares)
    stiffness += np.maximum(linear.cost_curvature().max(axis=1), 0.0)
    for row in np.flatnonzero(linear.primal):
        if not np.isfinite(network.cell.neurons[row].limiter.low):
            factor = gains.rate[row, 0] * stiffness[row]
            assert factor == pytest.approx(1.0 if row in network.chain_rows[:, 0] else 1.2)


def test_several_points_press_together(settled):
    """The stiffest of all: weights of the mean are no larger, time constants no longer."""
    network = settled.network
    one = Linearisation(network).at(settled.state)
    other = Linearisation(network).at(network.start_state)
    both = closed_form(MeanLinearisation([one, other]), MULTILEVEL_RULE)
    assert np.isfinite(both.rate).all()
    assert (both.rate > 0).all()
    same = closed_form(MeanLinearisation([one, one]), MULTILEVEL_RULE)
    alone = closed_form(one, MULTILEVEL_RULE)
    np.testing.assert_allclose(same.rate, alone.rate, rtol=1e-12)
    np.testing.assert_allclose(same.rho, alone.rho, rtol=1e-12)


def test_penalties_of_a_tape_are_those_of_the_frozen_network(settled):
    plain = apply_gains(settled.network, manual_gains(settled.network, rho=1.0))
    frozen, trial = evaluator(settled.network).tape, tape_with(plain, settled.gains)
    np.testing.assert_array_equal(frozen.weights, trial.weights)
