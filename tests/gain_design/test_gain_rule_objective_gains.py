"""Gains of shared neurons: what the closed form promises, and runs that need its care."""

from dataclasses import replace

import numpy as np
import pytest
from minimax import CASES, car, small

import ann_dc
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gain_rule import GainRule, closed_form
from ann_dc.gain_design.gains import apply_gains
from ann_dc.network.preconditioners.base import PreconditionerKind


@pytest.fixture(scope="module")
def network():
    return ann_dc.synthesize(car(CASES["three by range"][0]))


@pytest.mark.parametrize("kind", [PreconditionerKind.DIAGONAL, PreconditionerKind.MULTILEVEL])
def test_no_combination_of_rows_is_stiffer_than_one(network, kind):
    x = network.start_state
    gains = closed_form(Linearisation(network).at(x), GainRule(kind=kind))
    own = evaluator(apply_gains(network, gains))
    index = network.neuron_index
    of = lambda name: network.state_index[index[name], -1]  # noqa: E731
    measures = [of(objective.measure) for objective in network.cell.objectives]
    primal = network.of_population("q", "u", "t")
    slopes = own.drive_jacobian(x)[measures].toarray() * primal
    r = gains.rho[index[network.cell.objectives[0].neuron]]
    stiffness = r * (slopes @ (own.preconditioner @ slopes.T))
    assert np.linalg.eigvalsh(stiffness)[-1] == pytest.approx(1.0)
    assert gains.rate[index["E.max"], -1] == pytest.approx(1 / (3 * r))


def test_a_look_further_away_makes_rows_lighter(network):
    linear, row = Linearisation(network).at(network.start_state), network.neuron_index["z_J.late"]
    weights = [
        closed_form(linear, GainRule(linearisation_radius=away)).rho[row]
        for away in (0.0, 0.5, 1.0)
    ]
    assert weights[0] > weights[1] > weights[2] > 0


def test_a_row_is_no_heavier_than_its_temperature_allows():
    rows = []
    for temperature in (0.0, 0.01, 1e3):
        own = ann_dc.synthesize(small(temperature=temperature))
        gains = closed_form(Linearisation(own).at(own.start_state), GainRule())
        share, level = (own.neuron_index[name] for name in ("z_J.error", "E.max"))
        rows.append((gains.rho[share], gains.rate[level, -1], own.neuron("J.error").scale.factor))
    (hard, slow, _), (cold, fast, _), (hot, _, cost) = rows
    assert (cold, slow) == (pytest.approx(hard), pytest.approx(1 / (2 * hard)))
    assert fast == pytest.approx(1 / cold)
    assert hot == pytest.approx(cost / 1e3)


def test_a_network_without_objectives_has_the_gains_it_had():
    plain = ann_dc.synthesize(ann_dc.plants.car())
    linear = Linearisation(plain).at(plain.start_state)
    assert not len(linear.shares)
    one, other = (closed_form(linear, GainRule(linearisation_radius=away)) for away in (0.0, 1.0))
    np.testing.assert_array_equal(one.rho, other.rho)
    np.testing.assert_array_equal(one.rate, other.rate)


@pytest.mark.parametrize("effort", [0.02, 0.5, 0.9, 0.99])
def test_a_share_that_runs_away_is_taken_back(effort):
    """At the start the slope of the effort vanishes, soon after it is the largest."""
    problem = small(weights=(effort, 1 - effort))
    designed = ann_dc.design(problem, preconditioner=PreconditionerKind.MULTILEVEL, limit=3000)
    assert designed.first.settled
    assert designed.first.penalty_factor == 1.0
    assert designed.best.settling < 400


def test_every_objective_counts_in_the_curvature(network):
    x = network.start_state.copy()
    shares = Linearisation(network).shares
    curvatures = []
    for share in ([0.0, 0.0, 1.0], [1 / 3, 1 / 3, 1.0]):
        x[shares] = share
        curvatures.append(Linearisation(network).at(x).cost_curvature())
    np.testing.assert_array_equal(*curvatures)
    again = replace(network, preconditioner=network.preconditioner)
    assert Linearisation(again).objective_slopes().shape == (3, *network.live.shape)
