"""Starts from which a network settles at a known optimum."""

import numpy as np
import pytest

from ann_dc import design, plants
from ann_dc.gain_design import KNOTS, NEARBY, presets_of
from ann_dc.network import Role


@pytest.fixture(scope="module")
def designed():
    return design(plants.double_integrator(N=30))


def test_presets_hold_the_path_and_no_multiplier(designed):
    network, state = designed.network, designed.state
    found = dict(presets_of(network, state))["the found path"]
    duals = [neuron.role is Role.DUAL for neuron in network.cell.neurons]
    values, settled = network.unpack(found), network.unpack(state)
    assert not values[duals].any()
    assert settled[duals].any()
    rest = np.logical_not(duals)
    assert (values[rest] == settled[rest]).all()


@pytest.mark.parametrize("knots", KNOTS)
def test_coarse_presets_are_straight_between_a_few_stages(knots):
    designed = design(plants.double_integrator(N=60))
    network = designed.network
    presets = dict(presets_of(network, designed.state))
    values = network.unpack(presets[f"{knots} stages of the found path"])
    position = values[network.neuron_index["q.x"], 1:]
    assert len(set(np.round(np.diff(position), 9))) <= knots


def test_nearest_preset_lies_on_the_way_from_the_optimum_to_the_start(designed):
    network, state = designed.network, designed.state
    near = dict(presets_of(network, state))["a state near the optimum"]
    assert near == pytest.approx(state + NEARBY * (network.start_state - state))


def test_short_rows_have_no_coarse_preset():
    small = design(plants.double_integrator(N=5))
    assert next(words for words, _ in presets_of(small.network, small.state)) == "the found path"
