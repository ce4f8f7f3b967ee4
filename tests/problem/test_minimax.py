"""Several objectives and their weights: what a declaration takes, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from minimax import small

import ann_dc
from ann_dc.errors import ProblemError
from ann_dc.problem.serialisation import declared, written

x, v, a = sp.symbols("x v a")
EFFORT, ERROR = a**2 / 800, (x - 1) ** 2


def cart(**more) -> ann_dc.OptimalControlProblem:
    return ann_dc.OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, horizon=4, q_0=(0, 0), q_d=(1, 0),
        **more,
    )  # fmt: skip


def test_objectives_without_names_are_numbered():
    problem = cart(objectives=(EFFORT, ERROR))
    assert problem.objective_names == ("J1", "J2")
    assert (problem.cost, problem.weights) == (0, {})
    first, second = problem.shares
    assert sp.expand(problem.l - first * EFFORT - second * ERROR) == 0


def test_weights_are_inputs_and_stay_what_they_are():
    problem = cart(objectives=(EFFORT, ERROR), weights=(0.3, 0.7))
    assert problem.weights == {"J1": 0.3, "J2": 0.7}
    assert [str(s) for s in problem.inputs] == ["weight_J1", "weight_J2"]
    again = replace(problem, horizon=3, inputs={})
    assert again.weights == problem.weights
    moved = problem.with_inputs(weight_J1=0.5, weight_J2=0.5)
    assert moved.weights == {"J1": 0.5, "J2": 0.5}
    assert moved.inputs[sp.Symbol("weight_J1")].tolist() == [0.5] * 4
    with pytest.raises(ProblemError, match="expected a sum of 1"):
        problem.with_inputs(weight_J1=0.9)


def test_objectives_of_a_path():
    problem, rng = small(6, weights=(0.25, 0.75), cost=0.1 * v**2), np.random.default_rng(3)
    q, u = rng.standard_normal((2, 7)), rng.standard_normal((1, 6))
    expected = [
        0.25 * (u**2 / 800).sum(),
        0.75 * ((q[0, :-1] - 1) ** 2 + u[0] ** 2 / 8000).sum(),
    ]
    np.testing.assert_allclose(problem.objective_values(q, u), expected)
    stages = problem.objective_stages(q, u)
    np.testing.assert_allclose(stages.sum(axis=1), expected)
    common = 0.1 * (q[1, :-1] ** 2).sum()
    whole = problem.functions_with(np.array([0.2, 0.8])).objective(q, u)
    assert whole == pytest.approx(common + np.dot([0.2, 0.8], expected))


def test_a_problem_without_objectives_has_no_shares():
    problem = cart(cost=EFFORT)
    assert (problem.shares, problem.objective_names) == ({}, ())
    assert problem.objective_values(np.zeros((2, 5)), np.zeros((1, 4))).shape == (0,)
    assert problem.l == problem.cost


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "cost: missing"),
        ({"objectives": (EFFORT,)}, "objectives: expected two or more; declare a single"),
        ({"objectives": (EFFORT, sp.Integer(3))}, r"objectives\[J2\]: 3 has none of a, v, x"),
        ({"objectives": (EFFORT, sp.Abs(x))}, r"objectives\[J2\]: .* not smooth"),
        ({"objectives": (EFFORT, sp.Symbol("w"))}, r"objectives\[J2\]: unknown symbol w"),
        ({"objectives": {"a b": EFFORT, "c": ERROR}}, "not a plain identifier"),
        ({"objectives": {"E": EFFORT, "e": ERROR}}, "used twice"),
        ({"objectives": {1: EFFORT, 2: ERROR}}, "objectives: expected names"),
        ({"objectives": EFFORT}, "objectives: expected a sequence"),
        ({"cost": EFFORT, "weights": (1.0,)}, "weights: the problem has no objectives"),
        ({"objectives": (EFFORT, ERROR), "weights": (1.0,)}, "weights: expected one for each"),
        ({"objectives": (EFFORT, ERROR), "weights": (0.5, 0.6)}, "add up to 1.1"),
        ({"objectives": (EFFORT, ERROR), "weights": (1.5, -0.5)}, r"weights\[J2\]"),
        ({"objectives": (EFFORT, ERROR), "weights": (float("nan"), 1)}, r"weights\[J1\]"),
        ({"objectives": (EFFORT, ERROR), "weights": {"J1": 1.0}}, "weights: expected one for each"),
        ({"objectives": (EFFORT, ERROR), "weights": "half"}, "weights: expected one for each"),
        ({"objectives": (EFFORT, ERROR), "temperature": -0.1}, "temperature: expected zero or"),
        ({"objectives": (EFFORT, ERROR), "temperature": float("inf")}, "temperature: expected"),
        ({"cost": EFFORT, "temperature": 0.1}, "temperature: the problem has no objectives"),
    ],
)
def test_what_is_no_objective_is_refused_by_its_field(given, message):
    with pytest.raises(ProblemError, match=message):
        cart(**given)


def test_the_name_of_a_share_is_taken():
    share = sp.Symbol("share_J1")
    with pytest.raises(ProblemError, match="share_J1"):
        cart(objectives=(EFFORT, ERROR * share), inputs={share: 1.0})


def test_as_plain_data_and_back():
    problem = small(5, weights=(0.25, 0.75), cost=0.1 * v**2, temperature=0.2)
    again = declared(written(problem))
    assert again.temperature == 0.2
    assert again.objectives == problem.objectives
    assert (again.weights, again.cost) == (problem.weights, problem.cost)
    assert [str(s) for s in again.inputs] == [str(s) for s in problem.inputs]
    plain = declared(written(small()))
    assert plain.weights == {}


TOML = """
states = ["x", "v"]
controls = ["a"]
dt = 0.1
horizon = 4
q_0 = [0, 0]
q_d = [1, 0]
{}
[dynamics]
x = "v"
v = "a"
{}
"""


@pytest.mark.parametrize(
    ("keys", "tables", "names"),
    [
        ('objectives = ["a**2/800", "(x - 1)**2"]\nweights = [0.3, 0.7]', "", ("J1", "J2")),
        (
            "",
            '[objectives]\nmuch = "a**2/800"\nfar = "(x - 1)**2"\n[weights]\nmuch = 0.3\nfar = 0.7',
            ("much", "far"),
        ),
    ],
)
def test_objectives_in_a_file(tmp_path, keys, tables, names):
    path = tmp_path / "cart.toml"
    path.write_text(TOML.format(keys, tables), encoding="utf-8")
    problem = ann_dc.load_problem(path)
    assert problem.weights == dict(zip(names, (0.3, 0.7)))
    given = dict(zip(names, (EFFORT, ERROR)))
    assert all(sp.expand(own - given[n]) == 0 for n, own in problem.objectives.items())


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("", "cost: missing; add a stage cost, or objectives"),
        ('objectives = "a**2"', "objectives: expected a table"),
        ('objectives = ["a**2", "x**2"]\nweights = "half"', "weights: expected one"),
        ('objectives = ["a**2", "y**2"]', "objectives.J2"),
    ],
)
def test_a_file_is_refused_by_its_field(tmp_path, keys, message):
    path = tmp_path / "cart.toml"
    path.write_text(TOML.format(keys, ""), encoding="utf-8")
    with pytest.raises(ProblemError, match=message):
        ann_dc.load_problem(path)


def test_a_temperature_in_a_file(tmp_path):
    path = tmp_path / "cart.toml"
    keys = 'objectives = ["a**2/800", "(x - 1)**2"]\ntemperature = 0.05'
    path.write_text(TOML.format(keys, ""), encoding="utf-8")
    assert ann_dc.load_problem(path).temperature == 0.05
    path.write_text(TOML.format(keys.replace("0.05", '"cold"'), ""), encoding="utf-8")
    with pytest.raises(ProblemError, match="temperature: expected zero or a positive number"):
        ann_dc.load_problem(path)


def test_units_of_shared_neurons():
    problem = replace(small(), units={"cost": "J"})
    assert [problem.unit(n) for n in ("J.effort", "E.max", "z_J.error")] == ["J", "J", ""]
