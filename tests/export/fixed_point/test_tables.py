"""Functions as tables: as near as their last bit, inside the domain, and flat beyond their ends."""

import numpy as np
import pytest
from ranges import SMOOTH

from ann_dc.export.fixed_point.tables import made_table
from ann_dc.network.functions import FUNCTIONS, function_block

SEEN = {"tan": (-1.2, 1.2), "log": (0.2, 3.0), "sqrt": (0.2, 3.0), "reciprocal": (0.5, 2.0),
        "asin": (-0.8, 0.8), "acos": (-0.8, 0.8)}  # fmt: skip
NAMES = SMOOTH


def code_of(name: str) -> int:
    return [block.name for block in FUNCTIONS].index(name)


@pytest.mark.parametrize("name", NAMES)
def test_lines_are_near_the_function(name):
    """Over all arguments that were seen, with 12 fraction bits of argument and value."""
    low, high = SEEN.get(name, (-1.5, 1.5))
    table = made_table(code_of(name), (low, high), (12, 12), 18)
    x = np.arange(int(low * 2**12), int(high * 2**12))
    first, spacing = table.domain[0], table.shift
    cell, share = np.divmod(x - first, 2**spacing)
    left, right = table.entries[cell], table.entries[cell + 1]
    found = left + (right - left) * share / 2**spacing
    exact = function_block(name).value(x / 2**12) * 2**12
    assert np.abs(found - exact).max() <= 2.0  # the line's, and half a bit of each entry
    assert len(table.entries) <= 4100


@pytest.mark.parametrize("name", sorted(SEEN))
def test_arguments_stay_within_the_domain(name):
    block = function_block(name)
    table = made_table(code_of(name), SEEN[name], (12, 8), 18)
    low, high = np.array(table.domain) / 2**12
    assert max(block.domain[0], 0.0 if block.has_pole else -np.inf) < low
    assert high < block.domain[1]


def test_a_pole_between_the_arguments_is_seen():
    assert not made_table(code_of("reciprocal"), (-1.0, 1.0), (12, 8), 16).jump <= 1 / 64


@pytest.mark.parametrize("name", ["sqrt", "cos"])
def test_the_last_argument_has_an_entry_on_either_side(name):
    """Also where the domain is a whole number of spacings, so that it lies on an entry."""
    on_an_entry = 0
    for bits in range(64):
        seen = (0.25, 1.0 + bits / 2**10)
        table = made_table(code_of(name), seen, (10, 6), 16)
        width = table.domain[1] - table.domain[0]
        place, share = divmod(width, 2**table.shift)
        on_an_entry += share == 0 and table.shift > 0
        assert len(table.entries) == place + 2
        left, right = table.entries[place : place + 2]
        exact = function_block(name).value(np.array([table.domain[1] / 2**10]))[0]
        assert abs(left + (right - left) * share / 2**table.shift - exact * 2**6) <= 2.0
    assert on_an_entry
