"""Problem files: the shipped example, the schema, and files nobody should send."""

import math
import re
import time
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from ann_dc.errors import ExpressionError, FileFormatError, ProblemError
from ann_dc.problem import plants
from ann_dc.problem.toml_file import load_problem

DEMO = Path(__file__).parents[2] / "demos" / "pendulum.toml"

GOOD = """
states = ["x", "v"]
controls = ["a"]
dt = 0.1
horizon = 3
q_0 = [0, 0.5]
q_d = [1, "free"]
cost = "weight * a**2"
terminal_cost = "v**2"

[parameters]
weight = 0.5

[dynamics]
v = "a - drag * v"
x = "v"

[inputs]
drag = [0, 0.1, 0.2]
"""


@pytest.fixture
def write(tmp_path):
    def written(text: str | bytes) -> Path:
        path = tmp_path / "rail.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return written


def test_the_example_is_the_plant():
    loaded, plant = load_problem(DEMO), plants.pendulum()
    assert loaded.f == plant.f
    assert loaded.cost == plant.cost
    assert (loaded.q_0, loaded.q_d) == (plant.q_0, plant.q_d)
    assert (loaded.horizon, loaded.dt, loaded.name) == (plant.horizon, plant.dt, plant.name)
    assert loaded.units == plant.units


def test_a_byte_order_mark_is_no_part_of_a_file(write):
    marked = load_problem(write(b"\xef\xbb\xbf" + GOOD.encode()))
    assert marked.cost == load_problem(write(GOOD)).cost


def test_every_entry_arrives(write):
    problem = load_problem(write(GOOD))
    x, v, a, drag = sp.symbols("x v a drag")
    assert problem.name == "rail"
    assert problem.dynamics == (v, a - drag * v)
    assert problem.cost == 0.5 * a**2
    assert problem.terminal_cost == v**2
    assert problem.q_d == (1, None)
    np.testing.assert_array_equal(problem.inputs[drag], [0, 0.1, 0.2])
    assert problem.states == (x, v)


def test_vectors_may_be_tables_and_numbers_formulas(write):
    text = GOOD.replace('q_d = [1, "free"]\n', "").replace("q_0 = [0, 0.5]\n", "")
    text = text.replace('x = "v"', "x = 1e-05")
    text += '[q_0]\nv = 0.5\nx = 0\n[q_d]\nv = "free"\nx = 1\n'
    problem = load_problem(write(text))
    assert (problem.q_0, problem.q_d) == ((0, 0.5), (1, None))
    assert problem.dynamics[0] == sp.Float(1e-5)


def test_units_are_kept_as_text(write):
    text = GOOD + '[units]\nx = "µm"\ndrag = "1/s"\ntime = "__import__(\'os\')"\n'
    problem = load_problem(write(text))
    assert problem.units == {"x": "µm", "drag": "1/s", "time": "__import__('os')"}


def test_a_step_length_that_is_chosen_and_a_free_start(write):
    text = GOOD.replace("dt = 0.1", 'dt = {low = 0.02, high = 0.5, guess = 0.1, symbol = "tick"}')
    text = text.replace('"weight * a**2"', '"tick*(1 + a**2)"').replace("[0, 0.5]", '[0, "free"]')
    problem = load_problem(write(text))
    step = problem.dt
    assert (step.low, step.high, step.guess, str(step.symbol)) == (0.02, 0.5, 0.1, "tick")
    assert problem.q_0 == (0, None, None)
    assert str(problem.cost) == "tick*(a**2 + 1)"
    assert [str(s) for s in problem.handed_on] == ["tick_free"]


def test_inequalities_and_bounds(write):
    text = (
        GOOD
        + """
[constraints]
wall = "x + weight * v**2 <= 2"
speed = "-1 < v <= drag + 1"

[terminal_constraints]
near = "0.25 >= v**2"

[bounds]
a = [-2, "none"]
v = [-inf, 1.5]
"""
    )
    problem = load_problem(write(text))
    x, v, drag = sp.symbols("x v drag")
    assert [(row.name, row.expression) for row in problem.inequalities] == [
        ("wall", x + 0.5 * v**2 - 2),
        ("speed_low", -1 - v),
        ("speed_high", v - drag - 1),
        ("v_high", v - 1.5),
    ]
    assert [row.name for row in problem.end_inequalities] == ["near", "v_high"]
    np.testing.assert_array_equal(problem.control_limits, [[-2, np.inf]])


def test_inequalities_may_be_a_list(write):
    text = GOOD.replace("states =", 'constraints = ["x <= 1", "-1 <= v <= 1"]\nstates =')
    text = text.replace("states =", 'terminal_constraints = ["v <= 0.25"]\nstates =')
    problem = load_problem(write(text))
    assert [row.name for row in problem.inequalities] == ["g1", "g2_low", "g2_high"]
    assert [row.name for row in problem.end_inequalities] == ["end1"]


def test_a_map_and_no_target(write):
    text = GOOD.replace("[dynamics]", "[map]").replace('q_d = [1, "free"]\n', "")
    problem = load_problem(write(text))
    assert problem.dynamics is None
    assert problem.fixed == (False, False)


def test_numbers_may_be_formulas_of_numbers_and_parameters(write):
    text = GOOD.replace("weight = 0.5", 'weight = 0.5\nthird = "pi/3"\nwide = "2*third"')
    text = text.replace("q_0 = [0, 0.5]", 'q_0 = ["-third", 0.5]').replace("[1, ", '["sin(pi/6)", ')
    text = text.replace("[inputs]", '[bounds]\na = ["-wide", "none"]\n[inputs]')
    problem = load_problem(write(text))
    assert problem.q_0 == pytest.approx((-math.pi / 3, 0.5), rel=1e-15)
    assert problem.q_d == (pytest.approx(0.5, rel=1e-15), None)
    ((low, high),) = problem.bounds.values()
    assert low == pytest.approx(-2 * math.pi / 3, rel=1e-15)
    assert high is None or high == math.inf


REFUSED = [
    (('cost = "weight', 'cots = "weight'), "unknown key 'cots'", "keys states, controls"),
    (("dt = 0.1\n", ""), "dt: missing", "precede the first [table]"),
    (('["a"]', '"a"'), "controls: expected a list of names", "got 'a'"),
    (('["a"]', "[1]"), "controls: expected a list of names", "got [1]"),
    (('["a"]', '["lambda"]'), "cost: 'a' is not a name", "Allowed:"),
    (('["x", "v"]', '["x", "x", "v"]'), "name 'x' is used twice", "use different names"),
    (("[0, 0.5]", "[0]"), "q_0: 2 values expected", "x, v"),
    (("[0, 0.5]", "0"), "q_0: expected one value for each state", "got 0"),
    (("[0, 0.5]", "[0, nan]"), "q_0: component v is nan", "finite number"),
    (("[0, 0.5]", "[0, " + "9" * 400 + "]"), "q_0: component v", "finite number"),
    (("[0, 0.5]", "{x = 0}"), "q_0: every state exactly once", "missing: v"),
    (("[0, 0.5]", '[0, "any"]'), "q_0: 'any' is neither a number nor", '"free"'),
    (("dt = 0.1", "dt = {high = 1}"), "dt.low: missing", "lower bound"),
    (
        ("dt = 0.1", "dt = {low = 1, high = 0.1}"),
        "dt.low, dt.high: the lower bound 1",
        "low < high",
    ),
    (("dt = 0.1", "dt = {low = 0.1, most = 1}"), "dt: unknown key 'most'", "low, high, guess, sym"),
    (("dt = 0.1", 'dt = {low = "a"}'), "dt.low: expected a positive finite number", "'a'"),
    (("dt = 0.1", "dt = {low = 0.1, symbol = 3}"), "dt.symbol: expected a name", "3"),
    (
        ("dt = 0.1", 'dt = {low = 0.1, symbol = "v"}'),
        "dt.symbol: v is a symbol",
        "rename the step length",
    ),
    (
        ("dt = 0.1", 'dt = {low = 1, symbol = "weight"}'),
        "parameters.weight: the name is",
        "another",
    ),
    (("dt = 0.1", "dt = [0.1, 1]"), "dt: expected a positive finite number", "[0.1, 1]"),
    (('"free"', '"any"'), "q_d: 'any' is neither a number nor", '"free"'),
    (('"free"', "true"), "q_d: component v is True", '"free"'),
    (('"free"', "1979-05-27"), "q_d: component v is datetime.date", '"free"'),
    (("horizon = 3", "horizon = 0"), "horizon:", "from 1"),
    (("horizon = 3", "horizon = 999999999999"), "horizon:", "1000000"),
    (('"weight * a**2"', "[1]"), "cost: expected text", "got [1]"),
    (('"weight * a**2"', "\"__import__('os')\""), "cost:", "letters, digits"),
    (('"weight * a**2"', '"abs(a)"'), "cost: 'abs(a)' calls abs", "smooth"),
    (('x = "v"', 'x = "v.__class__"'), "dynamics.x: 'v.__class__' is an attribute", "Allowed"),
    (('x = "v"', 'y = "v"'), "dynamics: every state exactly once", "missing: x; unknown: y"),
    (('x = "v"', "x = inf"), "dynamics.x: 'inf'", "Allowed"),
    (('x = "v"', "x = true"), "dynamics.x: expected text", "True"),
    (("[dynamics]", "[rates]"), "unknown key 'rates'", "dynamics, map"),
    (("[dynamics]", "[[dynamics]]"), "dynamics: expected a table", "[dynamics]"),
    (("[inputs]", '[map]\nx = "v"\nv = "a"\n[inputs]'), "dynamics, map: both given", "one of"),
    (("weight = 0.5", 'weight = "a"'), "parameters.weight: 'a' is not a name", "numbers"),
    (
        ("weight = 0.5", 'weight = "log(0)"'),
        "parameters.weight: 'log(0)' is not a finite",
        "number",
    ),
    (("weight = 0.5", 'weight = "x"'), "parameters.weight: 'x' is not a name", "numbers"),
    (("[0, 0.5]", '[0, "sqrt(-1)"]'), "q_0: 'sqrt(-1)' is neither a number nor", "not a finite"),
    (("[0, 0.5]", '[0, "x"]'), "q_0: 'x' is neither a number nor", "names weight"),
    (("weight = 0.5", "weight = 0.5\nx = 1"), "parameters.x: the name is already used", "another"),
    (("weight = 0.5", "weight = 0.5\nsin = 1"), "parameters.sin: the name is", "another"),
    (("[0, 0.1, 0.2]", "[0, 0.1]"), "inputs[drag]: expected one number or 3", "one per stage"),
    (("[0, 0.1, 0.2]", "[[0]]"), "inputs.drag: expected a number or a list", "each stage"),
    (("[inputs]\ndrag", "inputs"), "dynamics: every state exactly once", "unknown: inputs"),
    (("states =", "name = 3\nstates ="), "name: expected text", "3"),
    (("[inputs]", '[units]\ny = "m"\n[inputs]'), "units: 'y' not declared", "x, v, a, drag, cost"),
    (("[inputs]", "[units]\nx = 2\n[inputs]"), "units[x]: expected text", "got 2"),
    (("[inputs]", '[units]\nx = "$m$"\n[inputs]'), "units[x]: '$m$' holds", "plain text"),
    (("states =", 'units = "m"\nstates ='), "units: expected a table", "[units]"),
    (("[inputs]", '[constraints]\nc = "x = 1"\n[inputs]'), "constraints.c: 'x = 1' is no", "map"),
    (("[inputs]", "[constraints]\nc = 1\n[inputs]"), "constraints.c: expected text", "got 1"),
    (("[inputs]", '[constraints]\nc = "1 <= 2"\n[inputs]'), "constraints[c]: 1 <= 2 has none", "x"),
    (("[inputs]", '[constraints]\nc = "y <= 2"\n[inputs]'), "constraints.c: 'y' is not a", "drag"),
    (("[inputs]", '[constraints]\n"c d" = "x <= 2"\n[inputs]'), "constraints: name 'c d'", "plain"),
    (
        ("[inputs]", '[constraints]\nc = "0<=x<=1"\nc_low = "x>=0"\n[inputs]'),
        "constraints.c_low: the name 'c_low' is already used",
        "another",
    ),
    (
        ("[inputs]", '[terminal_constraints]\nc = "a <= 2"\n[inputs]'),
        "terminal_constraints[c]: unknown symbol a",
        "x",
    ),
    (("states =", 'constraints = "x <= 1"\nstates ='), "constraints: expected a table", "'x <= 1'"),
    (("states =", "constraints = [1]\nstates ="), "constraints.g1: expected text", "got 1"),
    (("[inputs]", '[bounds]\nx = ["free", 1]\n[inputs]'), "bounds.x: 'free' is neither", '"none"'),
    (("[inputs]", "[bounds]\nx = 1\n[inputs]"), "bounds.x: expected two", "got 1"),
    (("[inputs]", "[bounds]\nx = [1]\n[inputs]"), "bounds[x]: expected (low, high)", "got [1]"),
    (
        ("[inputs]", "[bounds]\nx = [nan, 1]\n[inputs]"),
        "bounds[x]: expected a finite number",
        "None",
    ),
    (("[inputs]", "[bounds]\nx = [0.5, 2]\n[inputs]"), "bounds[x]: q_0 sets it to 0", "widen"),
    (("[inputs]", "[bounds]\ndrag = [0, 1]\n[inputs]"), "bounds: 'drag' is specified", "x, v, a"),
    (("states =", "bounds = [1]\nstates ="), "bounds: expected a table", "[bounds]"),
]


@pytest.mark.parametrize(("change", "field", "remedy"), REFUSED)
def test_bad_entry_is_refused_by_path_and_name(write, change, field, remedy):
    path = write(GOOD.replace(*change))
    with pytest.raises(ProblemError, match=re.escape(f"{path}: {field}")) as refusal:
        load_problem(path)
    assert remedy in str(refusal.value)


def test_a_bad_formula_keeps_its_type(write):
    with pytest.raises(ExpressionError):
        load_problem(write(GOOD.replace('"v"\n', '"v +"\n')))


NOT_A_FILE = [
    ("x = ", "not valid TOML", "demos/pendulum.toml"),
    ("a = 1\na = 2", "not valid TOML", "demos/pendulum.toml"),
    (b"\xff\xfe\x00", "not UTF-8", "save it as UTF-8"),
    (b"x = 1\x00", "not valid TOML", "demos/pendulum.toml"),
    ("a = " + "9" * 5000, "a value cannot be read", "digits"),
    ("a = " + "[" * 90_000, "nests too deeply", "demos/pendulum.toml"),
    ("a = " + "{a = " * 90_000, "nests too deeply", "demos/pendulum.toml"),
    ("a." * 400_000 + "a = 1", "too many dots", "demos/pendulum.toml"),
    ('"a\\"" . ' * 90_000 + "a = 1", "too many dots", "demos/pendulum.toml"),
    ("#" * 1_000_001, "larger than 1000000 bytes", "use the path of"),
]


@pytest.mark.parametrize(
    ("text", "fault", "remedy"), NOT_A_FILE, ids=lambda given: str(given)[:20].encode().hex()
)
def test_unreadable_file_is_refused_at_once(write, text, fault, remedy):
    start = time.thread_time()
    with pytest.raises(FileFormatError, match=fault) as refusal:
        load_problem(write(text))
    assert time.thread_time() - start < 2
    assert remedy in str(refusal.value)


@pytest.mark.parametrize("path", ["missing.toml", "", "\0", "/dev/zero"])
def test_missing_file_is_refused(path):
    with pytest.raises(FileFormatError, match=r"use the path of a \.toml problem file"):
        load_problem(path)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match="is a folder"):
        load_problem(tmp_path)
