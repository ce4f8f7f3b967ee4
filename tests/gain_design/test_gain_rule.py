"""Recipes: what they refuse, and what equilibrated rows do."""

import numpy as np
import pytest
from designs import small

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.errors import DesignError, UnknownNameError
from ann_dc.gain_design.gain_rule import GainRule, closed_form, equilibrated


def start_of(name: str) -> Linearisation:
    network = small(name)
    return Linearisation(network).at(network.start_state)


@pytest.mark.parametrize(
    "wrong",
    [{"penalty": 0.0}, {"dual": -1.0}, {"coarse": np.nan}, {"row_factors": {"mu.x": 0.0}},
     {"row_factors": {"mu.x": -2.0}}, {"equilibration_sweeps": -1},
     {"equilibration_sweeps": 1.5}, {"path_weight": -0.1}, {"path_weight": np.inf}],
    ids=str,
)  # fmt: skip
def test_factors_that_are_none(wrong):
    with pytest.raises(DesignError, match=next(iter(wrong))):
        GainRule(**wrong)


@pytest.mark.parametrize("name", ["mu.foo", "q.x"])
def test_rows_are_those_of_dual_neurons(name):
    with pytest.raises(UnknownNameError, match="row: dual neuron"):
        closed_form(start_of("car"), GainRule(row_factors={name: 2.0}))


@pytest.mark.parametrize("name", ["car", "pendulum", "cstr", "two_link_arm"])
def test_equilibrated_rows_are_equally_stiff(name):
    """The definition: w_i sum_j A_ij^2 T_j is the same for all rows, in their worst stage."""
    linear = start_of(name)
    weights = equilibrated(linear, 1.0, 2000)
    curvature = np.maximum(linear.cost_curvature().max(axis=1), 0.0)
    stiffness = curvature + linear.row_sums(weights).max(axis=1)
    rate = np.where(linear.primal, 1 / np.where(stiffness > 0, stiffness, 1.0), 0.0)
    rows = (weights * linear.column_sums(rate).max(axis=1))[linear.dual]
    np.testing.assert_allclose(rows, rows[0], rtol=1e-4)
    np.testing.assert_allclose(np.exp(np.log(weights[linear.dual]).mean()), 1.0)
    assert not weights[~linear.dual].any()


def test_no_sweeps_are_equal_rows():
    linear = start_of("car")
    assert equilibrated(linear, 1.0, 0).tolist() == linear.dual.astype(float).tolist()
