"""Starts from which a network settles at a known optimum."""

import numpy as np
import pytest

from ann_dc import design, plants, synthesize
from ann_dc.gain_design.rule_presets import COARSE, KNOTS, NEARBY, presets_of
from ann_dc.network.cell import Role


@pytest.fixture(scope="module")
def designed():
    return design(plants.double_integrator(N=30))


def test_presets_hold_the_path_and_no_multiplier(designed):
    network, state = designed.network, designed.state
    found = dict(presets_of(network, state))["the known trajectory"]
    duals = [neuron.role is Role.DUAL for neuron in network.cell.neurons]
    values, settled = network.unpack(found), network.unpack(state)
    assert not values[duals].any()
    assert settled[duals].any()
    rest = np.logical_not(duals)
    assert (values[rest] == settled[rest]).all()


@pytest.mark.parametrize("stages", [20, 60, 1000])
def test_coarse_presets_are_straight_between_a_few_stages(stages):
    network = synthesize(plants.double_integrator(N=stages))
    curved = network.unpack(network.start_state)
    position, k = network.neuron_index["q.x"], np.arange(stages)
    curved[position] = np.sin(6 * k / stages)
    found = dict(presets_of(network, network.pack(curved)))
    coarse = [words for words in found if words in COARSE]
    assert len(coarse) == {20: 1, 60: 3, 1000: 5}[stages]
    for knots, words in zip(KNOTS, coarse):
        bends = np.diff(network.unpack(found[words])[position, 1:], n=2)
        assert knots // 2 < 1 + (np.abs(bends) > 1e-9).sum() <= 2 * knots


def test_nearest_preset_lies_on_the_way_from_the_optimum_to_the_start(designed):
    network, state = designed.network, designed.state
    near = dict(presets_of(network, state))["a state near the optimum"]
    assert near == pytest.approx(state + NEARBY * (network.start_state - state))


def test_short_rows_have_no_coarse_preset():
    small = design(plants.double_integrator(N=5))
    assert (
        next(words for words, _ in presets_of(small.network, small.state)) == "the known trajectory"
    )
