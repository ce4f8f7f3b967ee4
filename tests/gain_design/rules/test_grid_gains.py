"""Settled points: what they keep is what they would compute again."""

from dataclasses import replace

import numpy as np
import pytest
from designs import designed

from ann_dc.analysis import Linearisation
from ann_dc.gain_design import Recipe, SettledPoint
from ann_dc.gain_design.rules import weights_of_rows


@pytest.fixture(scope="module")
def point() -> SettledPoint:
    found = designed("car")
    return SettledPoint(Linearisation(found.network).at(found.state), found.state)


@pytest.mark.parametrize("recipe", [Recipe(), Recipe(sweeps=16), Recipe(row={"mu.x": 3.0})])
def test_row_weights_are_those_of_the_recipe(point, recipe):
    weights = weights_of_rows(point.linear, recipe)
    for _ in range(2):
        assert point.row_weights(recipe).tolist() == weights.tolist()
    # the penalty is no part of them
    assert point.row_weights(replace(recipe, penalty=2.0)) is point.row_weights(recipe)
    with pytest.raises(ValueError, match="read-only"):
        point.row_weights(recipe)[0] = 1.0


def test_shadows_are_those_of_the_weights(point):
    ones = np.ones(len(point.saddle.dual))
    for weights in (ones, 4 * ones, ones):
        assert point.shadow_range(weights) == point.saddle.shadow_range(weights)
