"""Soft rows: what they cost, how they are declared, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, strategies as st
from scipy.optimize import minimize_scalar

from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.serialisation import declared, written
from ann_dc.problem.soft import Soft
from ann_dc.problem.toml_file import load_problem

x, v, a = sp.symbols("x v a")
PROBLEM = OptimalControlProblem(
    states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, cost=a**2, horizon=5,
    q_0=(0, 0), q_d=(1, None), constraints={"wall": x + v <= 2},
    terminal_constraints=(x**2 + v**2 <= 4,), bounds={v: (-1, 1), a: (-3, 3)},
)  # fmt: skip

POSITIVE = st.floats(1e-6, 1e6)
SOFT = st.one_of(
    st.builds(Soft, weight=POSITIVE),
    st.builds(Soft, weight=POSITIVE, compliance=st.floats(1e-9, 1e3)),
    st.builds(Soft, compliance=st.floats(1e-9, 1e3)),
)


@given(soft=SOFT, g=st.floats(-10, 10))
def test_the_cost_is_the_least_that_two_slacks_cost(soft, g):
    """Of y, which costs y^2 / 2d, and s, which costs P, with g <= y + s."""
    found = float(soft.cost(np.array(g)))
    if g <= 0:
        assert found == 0
        return
    share = min(g, soft.compliance * soft.weight)
    least = (share**2 / (2 * soft.compliance) if soft.compliance else 0.0) + (
        soft.weight * (g - share) if g > share else 0.0
    )
    assert found == pytest.approx(least, rel=1e-9)
    if soft.compliance and math.isfinite(soft.weight):
        cost = lambda y: y**2 / (2 * soft.compliance) + soft.weight * (g - y)  # noqa: E731
        best = minimize_scalar(cost, bounds=(0, g), method="bounded").fun
        assert found <= best * (1 + 1e-9)


@given(soft=SOFT, g=st.floats(1e-3, 10))
def test_the_slope_of_the_cost_is_the_multiplier(soft, g):
    """Between zero and the price, and g = d zeta below it."""
    step = 1e-6 * g
    below, above = soft.cost(np.array([g - step, g + step]))
    zeta = soft.weight if not soft.compliance else min(soft.weight, g / soft.compliance)
    assert (above - below) / (2 * step) == pytest.approx(zeta, rel=1e-5)


@given(soft=SOFT)
def test_what_is_declared_comes_back(soft):
    problem = replace(PROBLEM, soft={"wall": soft})
    assert problem.soft == declared(written(problem)).soft == {"wall": soft}
    by_name = {row.name: row.soft for row in problem.inequalities}
    assert by_name == {"wall": soft, "v_low": None, "v_high": None}


@given(price=POSITIVE)
def test_a_price_without_a_name_is_that_of_all_rows(price):
    for given_soft in (price, Soft(weight=price), sp.Float(price), np.float64(price)):
        problem = replace(PROBLEM, soft=given_soft)
        rows = (*problem.inequalities, *problem.end_inequalities)
        assert [row.name for row in rows] == ["wall", "v_low", "v_high", "end1", "v_low", "v_high"]
        assert all(row.soft == Soft(weight=price) for row in rows)


def test_nothing_is_soft_unless_told():
    assert not PROBLEM.soft
    assert all(row.soft is None for row in PROBLEM.inequalities)


def test_soft_rows_stay_soft_with_other_data():
    problem = replace(PROBLEM, soft={"v_high": 3, "end1": Soft(compliance=0.1)})
    for other in (problem.with_horizon(9), problem.with_inputs(q_0=(0.5, 0))):
        assert other.soft == {"v_high": Soft(weight=3), "end1": Soft(compliance=0.1)}


def test_an_end_may_break_a_soft_row_only():
    for place, soft in ((3, {"wall": 5}), (1.5, {"v_high": 5, "wall": 5})):
        with pytest.raises(ProblemError, match="q_0"):
            replace(PROBLEM, q_0=(3 if place == 3 else 0, 0 if place == 3 else place))
        assert replace(PROBLEM, q_0=(0, 2.5) if place != 3 else (3, 0), soft=soft).soft
    with pytest.raises(ProblemError, match=r"bounds\[v\]: q_0"):
        replace(PROBLEM, q_0=(0, 1.5), soft={"v_low": 5})


@pytest.mark.parametrize(
    ("given_soft", "words"),
    [
        (-1, "weight: expected a positive finite number, got -1"),
        (0, "weight: expected a positive"),
        (math.nan, "weight: expected a positive"),
        (math.inf, "expected a finite weight or a compliance"),
        (True, "weight: expected a positive"),
        ("30", "weight: expected a positive"),
        (None, "weight: expected a positive"),
        ({"wal": 3}, "unknown constraint 'wal'; choose one of wall, end1, v_low, v_high"),
        ({"a": 3}, "a is a control, whose bounds are hard"),
        ({"a_high": 3}, "a is a control, whose bounds are hard"),
        ({"wall": {"prize": 3}}, "unknown key 'prize'; a soft constraint has weight, compliance"),
        ({"wall": -3}, r"soft\[wall\].weight"),
        ({"wall": {}}, "expected a finite weight or a compliance"),
    ],
)
def test_what_is_no_price_is_refused(given_soft, words):
    with pytest.raises(ProblemError, match=words):
        replace(PROBLEM, soft=given_soft)


@pytest.mark.parametrize("compliance", [-1e-9, math.inf, math.nan, "soft", None])
def test_a_compliance_is_a_number_from_zero_on(compliance):
    with pytest.raises(ProblemError, match=r"soft\.compliance"):
        Soft(weight=1, compliance=compliance)


def test_there_has_to_be_a_row():
    with pytest.raises(ProblemError, match="no inequality constraint"):
        replace(PROBLEM, constraints=(), terminal_constraints=(), bounds={a: (-1, 1)}, soft=3)


TEXT = """
states = ["x"]
controls = ["a"]
dt = 0.1
horizon = 3
q_0 = [0]
cost = "a**2"
{before}

[map]
x = "x + a"

[constraints]
wall = "-1 <= x <= 2"

[bounds]
a = [-2, "none"]

{after}
"""


def loaded(tmp_path, before="", after=""):
    path = tmp_path / "problem.toml"
    path.write_text(TEXT.format(before=before, after=after))
    return load_problem(path).soft


def test_files_say_the_same(tmp_path):
    wall = ("wall_low", "wall_high")
    assert loaded(tmp_path) == {}
    assert loaded(tmp_path, before="soft = 30") == dict.fromkeys(wall, Soft(weight=30))
    assert loaded(tmp_path, after="[soft]\nwall_low = 3") == {"wall_low": Soft(weight=3)}
    table = "[soft.wall_high]\nweight = 30\ncompliance = 0.001"
    assert loaded(tmp_path, after=table) == {"wall_high": Soft(weight=30, compliance=0.001)}
    assert loaded(tmp_path, after="[soft]\nwall_low = {compliance = 1}") == {
        "wall_low": Soft(compliance=1)
    }
    with pytest.raises(ProblemError, match=r"problem.toml: soft: unknown constraint 'wall'"):
        loaded(tmp_path, after="[soft]\nwall = 3")
    with pytest.raises(ProblemError, match=r"problem.toml: soft\[a\]: a is a control"):
        loaded(tmp_path, after="[soft]\na = 3")
