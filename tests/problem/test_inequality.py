"""Inequalities as a user writes them: what is taken, what they say, and what is refused."""

import copy
import pickle
import re
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, strategies as st

from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.inequality import Inequality
from ann_dc.problem.step_length import StepLength

x, v, a, w, h = sp.symbols("x v a w h")
FIELDS = {
    "states": (x, v),
    "controls": (a,),
    "dynamics": (v, a),
    "cost": a**2 / 2,
    "horizon": 3,
    "q_0": (2, 0),
    "q_d": (1, None),
    "inputs": {w: 2.0},
}


def problem(**changes) -> OptimalControlProblem:
    return OptimalControlProblem(**{**FIELDS, **changes})


def test_rows_are_what_is_not_to_be_positive():
    rows = problem(constraints=(x**2 + v**2 >= 1, v <= 0.4, x < w, a > -v)).inequalities
    assert rows == (
        Inequality(name="g1", expression=1 - x**2 - v**2),
        Inequality(name="g2", expression=v - 0.4),
        Inequality(name="g3", expression=x - w),
        Inequality(name="g4", expression=-v - a),
    )


def test_rows_of_the_end_and_names_by_hand():
    given = problem(terminal_constraints=[x <= w], constraints={"disc": x**2 >= 1})
    assert [row.name for row in given.inequalities] == ["disc"]
    assert given.end_inequalities == (Inequality(name="end1", expression=x - w),)


def test_no_inequalities_by_default():
    given = problem()
    assert (given.inequalities, given.end_inequalities) == ((), ())
    assert str(given) == str(problem(constraints=[], terminal_constraints={}, bounds={}))


@given(st.permutations(["x", "v", "a"]), st.sampled_from(["<=", "<", ">=", ">"]))
def test_sides_may_be_swapped(order, sign):
    """x <= v is v >= x, whatever Python or SymPy make of it."""
    left, right = sp.Symbol(order[0]) ** 2 + 1, sp.Symbol(order[1]) * sp.Symbol(order[2])
    swapped = {"<": ">", ">": "<"}[sign[0]] + sign[1:]
    one = sp.Rel(left, right, sign)
    other = sp.Rel(right, left, swapped)
    assert problem(constraints=[one]).inequalities == problem(constraints=[other]).inequalities


def test_a_step_length_that_is_chosen_stands_as_its_state_has_it():
    step = StepLength(low=0.1, high=0.5)
    given = problem(dt=step, constraints={"pace": h * v <= 1}, terminal_constraints=[h <= 0.4])
    (row,), (last,) = given.inequalities, given.end_inequalities
    assert row.expression == step.expression * v - 1
    assert last.expression == step.expression - 0.4
    assert given.with_horizon(5).inequalities == given.inequalities
    functions = given.functions
    q = np.vstack([np.full((2, 3), 0.7), np.zeros((1, 3))])
    np.testing.assert_allclose(functions.rows(q, np.zeros((1, 3))).value, step.guess * 0.7 - 1)
    np.testing.assert_allclose(functions.end_rows(q[:, 0]).value, step.guess - 0.4)


def test_other_data_and_horizons_keep_the_rows():
    given = problem(constraints=[x <= w], bounds={v: (-1, 1), a: (0, 3)})
    reported = given.with_inputs(w=5.0)
    assert reported.inequalities == given.inequalities
    q, u = np.ones((2, 3)), np.zeros((1, 3))
    np.testing.assert_array_equal(reported.functions.rows(q, u).value[0], -4.0)
    np.testing.assert_array_equal(given.functions.rows(q, u).value[0], -1.0)
    longer = given.with_horizon(7)
    assert (longer.constraints, longer.bounds) == (given.constraints, given.bounds)
    assert longer.functions.rows(np.ones((2, 7)), np.zeros((1, 7))).value.shape == (3, 7)


def test_declarations_are_copied_and_sent():
    given = problem(constraints={"disc": x**2 >= w}, bounds={"x": (0, None)})
    given.functions.rows(np.ones((2, 3)), np.zeros((1, 3)))  # compiled, and kept
    for other in (pickle.loads(pickle.dumps(given)), copy.deepcopy(given), replace(given)):
        assert other.inequalities == given.inequalities
        np.testing.assert_array_equal(other.control_limits, given.control_limits)
    with pytest.raises(FrozenInstanceError):
        given.inequalities[0].name = "other"


def test_a_problem_says_what_it_declares():
    given = problem(constraints=[x <= 2], terminal_constraints={"near": v <= 1}, bounds={a: (0, 1)})
    assert str(given).endswith("free at the end: v, constraints: g1, at the end: near, bounds: a")


positive = sp.Symbol("p", positive=True)
REFUSED = [
    ({"constraints": [sp.Eq(x, 1)]}, "constraints[g1]: Eq(x, 1) is an equality", "map"),
    ({"constraints": [sp.Ne(x, 1)]}, "constraints[g1]: Ne(x, 1) is not an inequality", "<= or >="),
    ({"constraints": [(x < 1) & (v < 1)]}, "constraints[g1]: (v < 1) & (x < 1) is a", "separately"),
    ({"constraints": [(x < 1) | (v < 1)]}, "constraints[g1]: (v < 1) | (x < 1) is a", "separately"),
    ({"constraints": [sp.Integer(1) <= 2]}, "constraints[g1]: the relation is True", "omit it"),
    ({"constraints": [3 <= 2]}, "constraints[g1]: the relation is False", "omit it"),
    ({"constraints": [np.bool_(True)]}, "constraints[g1]: the relation is True", "omit it"),
    ({"constraints": [positive > 0]}, "constraints[g1]: the relation is True", "omit it"),
    ({"constraints": [x - 1]}, "constraints[g1]: expected a SymPy relation", "x <= 1"),
    ({"constraints": ["x <= 1"]}, "constraints[g1]: expected a SymPy relation", "x <= 1"),
    ({"constraints": [x <= 1, np.ones(2)]}, "constraints[g2]: expected a SymPy relation", "x <= 1"),
    ({"constraints": [w <= 1]}, "constraints[g1]: w <= 1 has none of a, v, x", "omit it"),
    ({"constraints": [sp.Le(x, x + 1, evaluate=False)]}, "constraints[g1]: x <= x + 1", "none"),
    ({"constraints": [sp.Symbol("y") <= 1]}, "constraints[g1]: unknown symbol y", "declare it"),
    ({"constraints": {"box": abs(x) <= 1}}, "constraints[box]: Abs(x) - 1 is not smooth", "sqrt"),
    ({"constraints": [sp.Max(x, v) <= 1]}, "constraints[g1]: Max(v, x) - 1 is not smooth", "sqrt"),
    ({"constraints": [sp.Le(x, sp.oo, evaluate=False)]}, "constraints[g1]:", "not a finite real"),
    ({"constraints": x <= 1}, "constraints: expected a sequence of relations", "[x <= 1]"),
    ({"constraints": "x <= 1"}, "constraints: expected a sequence of relations", "[x <= 1]"),
    ({"constraints": None}, "constraints: expected a sequence of relations", "got None"),
    ({"constraints": {x <= 1}}, "constraints: expected a sequence of relations", "mapping"),
    ({"constraints": {3: x <= 1}}, "constraints: expected names", "got 3"),
    ({"constraints": {"my disc": x <= 1}}, "constraints: name 'my disc' is not a plain", "letters"),
    ({"constraints": {"A": x <= 1, "a": v <= 1}}, "constraints: name 'a' is used",
     "use different names"),
    ({"constraints": {"x_low": x <= 1}, "bounds": {x: (0, 2)}}, "constraints: name 'x_low'",
     "use different names"),
    ({"terminal_constraints": {"x_high": x <= 1}, "bounds": {x: (0, 2)}},
     "terminal_constraints: name 'x_high' is used twice", "use different names"),
    ({"terminal_constraints": [a <= 1]}, "terminal_constraints[end1]: unknown symbol a", "x"),
    ({"terminal_constraints": [w <= 1]}, "terminal_constraints[end1]: w <= 1 has none", "v, x"),
    ({"terminal_constraints": [sp.Eq(x, 1)]}, "terminal_constraints[end1]: Eq(x, 1)", "q_d"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "fault", "remedy"), REFUSED, ids=lambda given: str(given)[:50])
def test_what_is_no_inequality_is_refused_by_name(changes, fault, remedy):
    with pytest.raises(ProblemError, match=f"^{re.escape(fault)}") as refusal:
        problem(**changes)
    assert remedy in str(refusal.value)


def test_the_end_may_have_a_row_of_the_same_name():
    given = problem(constraints={"disc": x >= -1}, terminal_constraints={"disc": x >= 0})
    assert given.inequalities[0].name == given.end_inequalities[0].name == "disc"
