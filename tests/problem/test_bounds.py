"""Bounds of states and controls: which rows and limits they are, and what is refused."""

import math
import re

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, strategies as st

from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.inequality import Inequality
from ann_dc.problem.step_length import StepLength

x, v, a, b, w = sp.symbols("x v a b w")
FIELDS = {
    "states": (x, v),
    "controls": (a, b),
    "dynamics": (v, a + b),
    "cost": a**2 + b**2,
    "horizon": 3,
    "q_0": (0, 0),
    "q_d": (1, None),
    "inputs": {w: 2.0},
}


def problem(**changes) -> OptimalControlProblem:
    return OptimalControlProblem(**{**FIELDS, **changes})


def test_a_state_has_rows_and_a_control_has_limits():
    given = problem(bounds={v: (None, 0.4), "x": (-1, 2), b: (-3, math.inf)})
    assert given.inequalities == (
        Inequality(name="x_low", expression=-1.0 - x),
        Inequality(name="x_high", expression=x - 2.0),
        Inequality(name="v_high", expression=v - 0.4),
    )
    np.testing.assert_array_equal(given.control_limits, [[-np.inf, np.inf], [-3, np.inf]])
    assert not given.control_limits.flags.writeable


def test_the_rows_of_the_user_come_first():
    given = problem(
        constraints=[x <= 3], terminal_constraints=[v**2 <= 1], bounds={v: (-1, 1), a: (0, 1)}
    )
    assert [row.name for row in given.inequalities] == ["g1", "v_low", "v_high"]
    assert [row.name for row in given.end_inequalities] == ["end1", "v_low", "v_high"]


def test_at_the_end_only_what_is_free_has_rows():
    """And functions follow, where other data free another component."""
    given = problem(bounds={x: (None, 2), v: (-1, None)})
    assert [row.name for row in given.end_inequalities] == ["v_low"]
    freed, held = given.with_inputs(q_d=(None, None)), given.with_inputs(q_d=(1, 0))
    assert [row.name for row in freed.end_inequalities] == ["x_high", "v_low"]
    assert held.end_inequalities == ()
    q_N = np.array([0.5, 0.25])
    np.testing.assert_array_equal(given.functions.end_rows(q_N).value, [-1.25])
    np.testing.assert_array_equal(freed.functions.end_rows(q_N).value, [-1.5, -1.25])
    assert held.functions.end_rows(q_N).value.shape == (0,)


@pytest.mark.parametrize("none", [(None, None), (-math.inf, math.inf), (-sp.oo, sp.oo)], ids=str)
def test_bounds_on_neither_side_are_none(none):
    given = problem(bounds={x: none, a: none})
    assert (given.bounds, given.inequalities) == ({}, ())
    assert not np.isfinite(given.control_limits).any()


def test_numbers_may_be_sympys_and_numpys():
    given = problem(bounds={a: (-sp.pi, sp.Rational(1, 2)), b: np.array([-1, 2])})
    np.testing.assert_array_equal(given.control_limits, [[-math.pi, 0.5], [-1, 2]])


def test_a_row_has_no_name_that_netlists_would_take_apart():
    x_ = sp.Symbol("x_")
    given = problem(states=(x_, v), bounds={x_: (-1, None)})
    assert [row.name for row in given.inequalities] == ["x_low"]


def test_an_end_may_lie_on_a_bound():
    given = problem(bounds={x: (0, 1)})
    assert [row.name for row in given.inequalities] == ["x_low", "x_high"]


eighths = st.integers(-8000, 8000).map(lambda number: number / 8)


@given(
    st.lists(eighths, min_size=2, max_size=2, unique=True),
    st.lists(eighths, min_size=2, max_size=2),
)
def test_bounds_hold_where_their_rows_do(pair, point):
    low, high = sorted(pair)
    given = problem(q_0=(None, None), q_d=None, bounds={x: (low, high)})
    q = np.array(point)[:, None]
    rows = given.functions.rows(q, np.zeros((2, 1))).value[:, 0]
    assert (rows <= 0).all() == (low <= point[0] <= high)
    np.testing.assert_array_equal(given.functions.end_rows(q[:, 0]).value, rows)


REFUSED = [
    (None, "bounds: expected a mapping", "got None"),
    ([(0, 1)], "bounds: expected a mapping", '{"x": (0, None)}'),
    ({w: (0, 1)}, "bounds: 'w' is specified twice or is none of x, v, a, b", "states"),
    ({"z": (0, 1)}, "bounds: 'z' is specified twice or is none of", "only states and controls"),
    ({3: (0, 1)}, "bounds: 3 is specified twice or is none of", "only states and controls"),
    ({x: (-1, 1), "x": (0, 1)}, "bounds: 'x' is specified twice", "x, v, a, b"),
    ({x: 1}, "bounds[x]: expected (low, high)", "got 1"),
    ({x: (0,)}, "bounds[x]: expected (low, high)", "None for no bound"),
    ({x: (0, 1, 2)}, "bounds[x]: expected (low, high)", "None for no bound"),
    ({x: "01"}, "bounds[x]: expected (low, high)", "got '01'"),
    ({x: {0, 1}}, "bounds[x]: expected (low, high)", "None for no bound"),
    ({x: (0, math.nan)}, "bounds[x]: expected a finite number or None, got nan", "or None"),
    ({x: ("0", 1)}, "bounds[x]: expected a finite number or None, got '0'", "or None"),
    ({x: (True, 3)}, "bounds[x]: expected a finite number or None, got True", "or None"),
    ({x: (v, 3)}, "bounds[x]: expected a finite number or None, got v", "or None"),
    ({x: (math.inf, None)}, "bounds[x]: expected a finite number or None, got inf", "or None"),
    ({x: (None, -math.inf)}, "bounds[x]: expected a finite number or None, got -inf", "or None"),
    ({a: (1, -1)}, "bounds[a]: the lower bound 1 is not below the upper bound -1", "low < high"),
    ({a: (1, 1)}, "bounds[a]: the lower bound 1 is not below the upper bound 1", "numbers"),
    ({x: (0.5, 2)}, "bounds[x]: q_0 sets it to 0, outside 0.5 to 2", "change q_0"),
    ({x: (None, 0.5)}, "bounds[x]: q_d sets it to 1, outside -inf to 0.5", "leave it free"),
]


@pytest.mark.parametrize(("bounds", "fault", "remedy"), REFUSED, ids=lambda given: str(given)[:40])
def test_what_is_no_bound_is_refused_by_name(bounds, fault, remedy):
    with pytest.raises(ProblemError, match=f"^{re.escape(fault)}") as refusal:
        problem(bounds=bounds)
    assert remedy in str(refusal.value)


def test_other_ends_are_checked_too():
    with pytest.raises(ProblemError, match=r"^bounds\[v\]: q_0 sets it to 7"):
        problem(bounds={v: (-1, 1)}).with_inputs(q_0=(0, 7))


def test_a_step_length_that_is_chosen_has_bounds_of_its_own():
    given = problem(dt=StepLength(low=0.1, high=0.5), bounds={x: (0, 1)})
    assert [row.name for row in given.inequalities] == ["x_low", "x_high"]
    for name in ("h", "h_free"):
        with pytest.raises(
            ProblemError, match=f"^bounds: '{name}' is specified twice or is none of"
        ):
            problem(dt=StepLength(low=0.1, high=0.5), bounds={name: (0, 1)})
