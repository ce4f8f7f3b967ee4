"""What a declaration refuses, and that the message names the field and the remedy."""

import re
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, strategies as st

from ann_dc.errors import AnnDcError, ProblemError, UnknownNameError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.scale import Scale

x, v, a, w = sp.symbols("x v a w")

GOOD = {
    "states": (x, v),
    "controls": (a,),
    "dynamics": (v, a),
    "dt": 0.1,
    "cost": a**2 / 2,
    "horizon": 20,
    "q_0": (0, 0),
    "q_d": (1, 0),
}


def declared(**changes) -> OptimalControlProblem:
    return OptimalControlProblem(**(GOOD | changes))


def named(name: str) -> dict:
    """The changes that rename the control."""
    symbol = sp.Symbol(name)
    return {"controls": (symbol,), "dynamics": (v, symbol), "cost": symbol**2}


REFUSED = [
    ({"dynamics": (v, a + w)}, "dynamics[v]: unknown symbol w", "declare it as"),
    ({"dynamics": (v,)}, "dynamics: 2 expressions expected", "one for each state (x, v)"),
    ({"dynamics": v}, "dynamics: 2 expressions expected", "one for each state"),
    ({"dynamics": 5}, "dynamics: 2 expressions expected", "one for each state"),
    ({"dynamics": {x: v, v: a}}, "dynamics: 2 expressions expected", "one for each state"),
    ({"dynamics": (v, "a")}, "dynamics[v]: 'a' is not a SymPy expression", "build it from symbols"),
    ({"dynamics": (v, sp.Abs(a))}, "dynamics[v]: Abs(a) is not smooth", "sqrt(x**2 + 0.01)"),
    ({"dynamics": (v, sp.zoo)}, "dynamics[v]: zoo", "finite real expression"),
    ({"dynamics": None}, "dynamics, map: neither given", "one of the two"),
    ({"map": (v, a)}, "dynamics, map: both given", "one of the two"),
    ({"cost": a**2 + w}, "cost: unknown symbol w", "replace it by a number"),
    ({"cost": sp.Max(a, 0)}, "cost:", "smooth approximation"),
    ({"cost": True}, "cost: True", "build it from symbols"),
    ({"cost": sp.Matrix([a])}, "cost:", "scalar SymPy expression"),
    ({"terminal_cost": a**2}, "terminal_cost: unknown symbol a", "known are v, x"),
    ({"horizon": 0}, "horizon:", "whole number of stages from 1"),
    ({"horizon": 2.5}, "horizon:", "got 2.5"),
    ({"horizon": True}, "horizon:", "got True"),
    ({"horizon": 10**12}, "horizon:", "to 1000000"),
    ({"dt": 0}, "dt: expected a positive finite number", "got 0"),
    ({"dt": float("nan")}, "dt:", "got nan"),
    ({"dt": 10**400}, "dt:", "positive finite number"),
    ({"q_0": (0, 0, 0)}, "q_0: 2 values expected", "one for each of x, v"),
    ({"q_0": 0}, "q_0: 2 values expected", "one for each of x, v"),
    ({"q_0": {x: 0, v: 0}}, "q_0: 2 values expected", "one for each of x, v"),
    ({"q_0": (0, float("nan"))}, "q_0: component v is nan", "give a finite number"),
    ({"q_0": (0, "free")}, "q_0: component v is 'free'", "None"),
    ({"q_0": (0, True)}, "q_0: component v is True", "give a finite number"),
    ({"q_d": (float("inf"), 0)}, "q_d: component x is inf", "or None"),
    ({"q_d": (10**400, 0)}, "q_d: component x", "or None"),
    ({"q_d": (w, 0)}, "q_d: component x is w", "or None"),
    ({"states": ()}, "states: expected a non-empty sequence", "sp.symbols"),
    ({"states": "x v"}, "states:", "sp.symbols"),
    ({"controls": ("a",)}, "controls: 'a' is not a sympy.Symbol", "use sp.symbols"),
    ({"controls": (x,)}, "name 'x' is used twice", "use different names"),
    (named("X"), "name 'X' is used twice", "upper and lower case"),
    (named("pi"), "name 'pi' is reserved: formulas in text form use it", "rename it"),
    (named("inf"), "name 'inf' is reserved: tables and files", "rename it"),
    ({"inputs": {sp.Symbol("one"): 1}}, "name 'one' is reserved: the node", "rename it"),
    ({"inputs": {sp.Symbol("q_d"): 1}}, "name 'q_d' is reserved: with_inputs", "rename it"),
    (named("asin"), "name 'asin' is reserved", "rename it"),
    (named("a__b"), "name 'a__b' is reserved", "double '_'"),
    (named("a.b"), "name 'a.b' is not a plain identifier", "letters, digits"),
    (named("lambda"), "name 'lambda' is not a plain identifier", "no Python keyword"),
    (named("α"), "name 'α' is not a plain identifier", "letters, digits"),
    ({"inputs": {w: (1, 2)}}, "inputs[w]: expected one number or 20", "one per stage"),
    ({"inputs": {w: float("nan")}}, "inputs[w]:", "not finite"),
    ({"inputs": {w: 10**400}}, "inputs[w]: expected one number", "one per stage"),
    ({"inputs": {"w": 1}}, "inputs: 'w' is not a sympy.Symbol", "use sp.symbols"),
    ({"inputs": 3}, "inputs: expected a mapping", "symbol to value"),
    ({"units": "m"}, "units: expected a mapping", "such as"),
    ({"units": {"y": "m"}}, "units: 'y' not declared", "given to x, v, a, cost, time"),
    ({"units": {w: "m"}}, "units: 'w' not declared", "given to x, v, a, cost, time"),
    ({"units": {3: "m"}}, "units: 3 not declared", "given to x, v, a, cost, time"),
    ({"units": {"x": "m", x: "km"}}, "units: 'x' is given twice", "one unit"),
    ({"units": {"x": 1}}, "units[x]: expected text", '"1" where there is none'),
    ({"units": {"x": None}}, "units[x]: expected text", "got None"),
    ({"units": {"x": " "}}, "units[x]: expected 1 to 24 letters, got ' '", '"m/s"'),
    ({"units": {"cost": "m" * 25}}, "units[cost]: expected 1 to 24 letters", '"m/s"'),
    ({"units": {"x": "m\ns"}}, "units[x]: 'm\\ns' holds a control character", "plain text"),
    ({"units": {"x": "m\x1b[0m"}}, "units[x]: 'm\\x1b[0m' holds", "plain text"),
    ({"units": {"x": "\u202em"}}, "units[x]:", "plain text"),
    ({"units": {"time": "$\\mu$s"}}, "units[time]:", "plain text"),
    ({"units": {"x": "[m]"}}, "units[x]: '[m]' holds", "plain text"),
    ({"units": {"time": "s"}} | named("time"), "units: 'time' is a symbol", "rename the symbol"),
]


@pytest.mark.parametrize(("changes", "field", "remedy"), REFUSED)
def test_bad_field_is_refused_by_name(changes, field, remedy):
    with pytest.raises(ProblemError, match=re.escape(field)) as refusal:
        declared(**changes)
    assert remedy in str(refusal.value)


def test_errors_are_what_a_user_expects():
    assert issubclass(ProblemError, ValueError)
    assert issubclass(ProblemError, AnnDcError)


def test_euler_makes_the_map():
    assert declared().f == (x + 0.1 * v, v + 0.1 * a)


def test_a_map_is_kept():
    problem = declared(dynamics=None, map=(x + v, v + a))
    assert problem.f == (x + v, v + a)
    assert problem.dynamics is None


def test_symbolic_numbers_and_free_components():
    problem = declared(q_0=(sp.pi, sp.Rational(1, 2)), q_d=(None, 0))
    assert problem.q_0 == (np.pi, 0.5)
    assert problem.fixed == (False, True)
    assert "free at the end: x" in str(problem)
    assert declared(q_d=None).fixed == (False, False)


def test_inputs_are_one_number_a_stage_and_read_only():
    problem = declared(dynamics=(v, a + w), inputs={w: 0.5})
    assert problem.inputs[w].tolist() == [0.5] * 20
    with pytest.raises(ValueError, match="read-only"):
        problem.inputs[w][0] = 1


def test_with_inputs_changes_data_only():
    problem = declared(dynamics=(v, a + w), inputs={w: 0.5})
    other = problem.with_inputs(q_d=(2, None), w=np.arange(20))
    assert other.q_d == (2, None)
    assert other.inputs[w][3] == 3
    assert other.f == problem.f
    with pytest.raises(ProblemError, match=r"inputs: z not declared; this problem has q_0, q_d, w"):
        problem.with_inputs(z=1)


def test_with_horizon_keeps_constant_inputs():
    problem = declared(dynamics=(v, a + w), inputs={w: 0.5}).with_horizon(30)
    assert problem.horizon == 30
    assert problem.inputs[w].tolist() == [0.5] * 30


def test_with_horizon_refuses_inputs_that_no_longer_fit():
    problem = declared(dynamics=(v, a + w), inputs={w: range(20)})
    with pytest.raises(ProblemError, match=r"inputs\[w\]: expected one number or 30"):
        problem.with_horizon(30)


WORDS = st.text(st.characters(exclude_categories=["C", "Z"], exclude_characters="$\\[]"),
                min_size=1, max_size=24)  # fmt: skip
UNITS = st.dictionaries(st.sampled_from([x, "v", "a", w, "cost", "time"]), WORDS)


@given(UNITS)
def test_units_are_words_that_stay_and_change_nothing(units):
    plain = declared(dynamics=(v, a + w), inputs={w: 0.5})
    problem = replace(plain, units=units)
    assert (problem.f, problem.cost, problem.q_0, problem.dt) == (
        plain.f, plain.cost, plain.q_0, plain.dt,
    )  # fmt: skip
    kept = {str(name): unit for name, unit in units.items()}
    for other in (problem, problem.with_inputs(w=1, q_d=(0, 0)), problem.with_horizon(30)):
        assert other.units == kept
    for name in ("x", "v", "a", "w"):
        assert problem.unit(name) == kept.get(name, "")
    assert problem.unit("q.x") == problem.unit("t.x") == kept.get("x", "")
    assert problem.unit("u.a") == kept.get("a", "")
    assert problem.time_unit == kept.get("time", "s")
    assert problem.cost_unit == kept.get("cost", "")


def test_a_multiplier_is_cost_over_state():
    problem = declared(units={x: "m", v: "m/s"})
    assert problem.unit("mu.x") == problem.unit("beta.x") == "cost/m"
    assert replace(problem, units={**problem.units, "cost": "J"}).unit("mu.v") == "J/(m/s)"
    assert declared().unit("mu.x") == ""
    assert declared(units={"x": "1", "cost": "J/s"}).unit("mu.x") == "J/s"


def test_units_are_known_by_name_only():
    with pytest.raises(UnknownNameError, match=r"name 'mu\.a' does not exist.*mu\.x"):
        declared().unit("mu.a")


def test_the_interval_is_told_with_its_unit():
    assert "20 stages of 0.1 s" in str(declared())
    assert "20 stages of 0.1 day" in str(declared(units={"time": "day"}))
    assert str(declared(units={"time": "1"})).endswith("20 stages of 0.1")


def test_a_symbol_called_time_leaves_the_axis_in_seconds():
    problem = declared(**named("time"))
    assert (problem.time_unit, problem.unit("time")) == ("s", "")


def test_a_free_component_stands_at_its_other_end():
    """And one that is free at both at zero, or where its scale by hand has its zero."""
    given = declared(q_0=(0, None), q_d=(None, 2))
    assert (given.fixed_start, given.fixed) == ((True, False), (False, True))
    assert [end.tolist() for end in given.ends] == [[0, 2], [0, 2]]
    assert str(given).endswith("free at the start: v, free at the end: x")
    assert declared(q_0=(None, 0), q_d=None).ends[0].tolist() == [0, 0]
    assert declared(q_0=(None, 0), q_d=None, scales={"x": Scale(20, 300)}).ends[1].tolist() == [
        300,
        0,
    ]
