"""Problems as plain data: every field comes back, of every plant and every problem of the suite."""

from dataclasses import fields, replace

import numpy as np
import pytest
import sympy as sp
from network_files import assert_same
from problems import SUITE

from ann_dc.errors import ProblemError
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.serialisation import WrittenProblem, WrittenRelation, declared, written
from ann_dc.problem.soft import Soft
from ann_dc.problem.step_length import StepLength
from ann_dc.scale import Scale

x, a, w = sp.symbols("x a w")
FULL = OptimalControlProblem(
    name="all fields",
    states=(x,),
    controls=(a,),
    map=(x + a * w,),
    cost=a**2 + w,
    terminal_cost=x**2 * w,
    horizon=3,
    dt=0.3,
    q_0=(0.1,),
    q_d=None,
    inputs={w: (1.0, 2.0, 1 / 3)},
    units={x: "m", "time": "h"},
    scales={x: Scale(2.0, 0.5), "cost": 3.0},
    constraints={"disc": x**2 + a**2 >= w, "below": sp.Lt(x, 1 / (2 + sp.exp(a)))},
    terminal_constraints=[x * w <= 1 / sp.Integer(3)],
    bounds={a: (-1 / 3, None), x: (None, 2)},
    soft={"disc": 3.5, "x_high": Soft(weight=1 / 3, compliance=0.1), "end1": Soft(compliance=1)},
)
PROBLEMS = {
    **{name: plants.get(name) for name in plants.names()},
    **{f"suite {name}": entry.build for name, entry in SUITE.items()},
    "all fields": lambda: FULL,
}


def relation(left: str, sign: str) -> WrittenRelation:
    return WrittenRelation(left=(left,), sign=sign, right=("1",))


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_field_comes_back(name):
    problem = PROBLEMS[name]()
    again = declared(written(problem))
    for field in fields(problem):
        if field.name in ("inputs", "units", "scales"):
            assert_same(dict(getattr(again, field.name)), dict(getattr(problem, field.name)))
        elif isinstance(problem.dt, StepLength) and field.name == "dt":
            assert_same(again.dt, problem.dt, "dt")
        else:
            assert getattr(again, field.name) == getattr(problem, field.name), field.name
    assert again.f == problem.f
    assert again.inequalities == problem.inequalities
    assert again.end_inequalities == problem.end_inequalities


def test_no_field_of_a_declaration_is_forgotten():
    """A new field of a problem has to be written, or a solution would come back as another's."""
    names = {field.name for field in fields(WrittenProblem)}
    assert names - {"assumptions", "step"} == {
        field.name for field in fields(OptimalControlProblem)
    }


def test_what_is_assumed_of_a_symbol_comes_back():
    r = sp.Symbol("r", positive=True)
    problem = OptimalControlProblem(
        states=(r,), controls=(a,), map=(r + a,), cost=sp.sqrt(r**2) + a**2, horizon=3, q_0=(1,)
    )
    again = declared(written(problem))
    assert again.states == (r,)
    assert again.cost == r + a**2


def test_numbers_are_the_same_to_the_last_bit():
    problem = plants.lq(seed=4)
    again = declared(written(problem))
    rng = np.random.default_rng(0)
    q, u = rng.standard_normal((problem.n, 5)), rng.standard_normal((problem.m, 5))
    problem, again = problem.with_horizon(5), again.with_horizon(5)
    np.testing.assert_array_equal(again.functions.map(q, u), problem.functions.map(q, u))
    np.testing.assert_array_equal(again.functions.cost(q, u), problem.functions.cost(q, u))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cost": ("open('/etc/passwd')",)}, "cost: .* not allowed"),
        ({"map": (("x + b",),)}, r"map\[0\]: .*not a name"),
        ({"map": None}, "dynamics, map: neither"),
        ({"states": ("x", "y")}, "map: 2 expressions"),
        ({"states": ("lambda",)}, r"map\[0\]"),
        ({"assumptions": {"x": {"positive": True, "negative": True}}}, r"assumptions\.x"),
        ({"assumptions": {"x": {"name": True}}}, r"assumptions\.x"),
        ({"scales": {"x": ()}}, r"scales\[x\]"),
        ({"horizon": 10**9}, "horizon"),
        ({"inputs": {"w": np.ones(4)}}, r"inputs\[w\]"),
        ({"constraints": {"c": relation("open('x')", "<=")}}, r"constraints\[c\]: .* not allowed"),
        (
            {"constraints": {"c": relation("x", "==")}},
            r"constraints\[c\]: '==' is not one of <=, <",
        ),
        ({"constraints": {"c d": relation("x", "<=")}}, "constraints: name 'c d'"),
        ({"constraints": {"c": relation("w", "<=")}}, r"constraints\[c\]: w <= 1 has none of"),
        ({"terminal_constraints": {"c": relation("a", "<=")}}, r"terminal_constraints\[c\]"),
        ({"bounds": {"x": (1.0,)}}, r"bounds\[x\]"),
    ],
    ids=str,
)
def test_bad_data_is_refused_by_the_field(change, message):
    with pytest.raises(ProblemError, match=message):
        declared(replace(written(FULL), **change))
