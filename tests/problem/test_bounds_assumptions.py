"""SymPy assumptions of symbols: bounds, or refused by name."""

import math

import numpy as np
import pytest
import sympy as sp

import ann_dc
from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem

x, v, a, p = sp.symbols("x v a p")


def declared(**given) -> OptimalControlProblem:
    fields = {
        "states": (x, v), "controls": (a,), "dynamics": (v, a), "dt": 0.1, "cost": a**2 / 2,
        "horizon": 8, "q_0": (0, 0), "q_d": (1, None),
    }  # fmt: skip
    return OptimalControlProblem(**(fields | given))


def with_control(**assumptions) -> OptimalControlProblem:
    control = sp.Symbol("a", **assumptions)
    return declared(controls=(control,), dynamics=(v, control), cost=control**2 / 2)


@pytest.mark.parametrize(
    "fact",
    [
        *("integer=True", "integer=False", "even=True", "odd=True", "prime=True"),
        *("rational=True", "irrational=True", "algebraic=True", "zero=True", "nonzero=True"),
        *("real=False", "extended_real=False", "imaginary=True", "infinite=True"),
        *("commutative=False", "finite=False"),
    ],
)
def test_assumptions_that_no_network_keeps_are_refused_by_name(fact):
    name, _, value = fact.partition("=")
    reported = "infinite=True" if fact == "finite=False" else fact
    with pytest.raises(ProblemError, match=f"^a: expected a real number .* {reported},"):
        with_control(**{name: value == "True"})
    symbol = sp.Symbol("p", **{name: value == "True"})
    with pytest.raises(ProblemError, match=r"^p: expected a real number"):
        declared(inputs={symbol: 1.0})
    state = sp.Symbol("x", **{name: value == "True"})
    with pytest.raises(ProblemError, match=r"^x: expected a real number"):
        declared(states=(state, v), q_d=(None, 1))


@pytest.mark.parametrize("fact", ["real", "extended_real", "complex", "hermitian", "commutative"])
def test_assumptions_of_every_real_number_change_nothing(fact):
    problem = with_control(**{fact: True})
    assert problem.bounds == {}
    assert [*map(str, problem.f)] == [*map(str, declared().f)]


@pytest.mark.parametrize(
    ("fact", "bounds"),
    [
        *(({s: True}, (0.0, math.inf)) for s in ("positive", "nonnegative", "extended_positive")),
        *(({s: True}, (-math.inf, 0.0)) for s in ("negative", "nonpositive")),
        ({"negative": False}, (0.0, math.inf)),
        ({"positive": False}, (-math.inf, 0.0)),
    ],
)
def test_signs_become_bounds(fact, bounds):
    problem = with_control(**fact)
    assert problem.bounds == {"a": bounds}
    assert problem.with_horizon(3).bounds == problem.bounds
    assert "bounds: a" in str(problem)


def test_bounds_on_the_assumed_side_stay():
    control = sp.Symbol("a", positive=True)
    given = {"controls": (control,), "dynamics": (v, control), "cost": control**2}
    assert declared(**given, bounds={"a": (0.5, 2)}).bounds == {"a": (0.5, 2.0)}
    with pytest.raises(ProblemError, match=r"bounds\[a\]: -1 to 2 contradicts .* positive=True"):
        declared(**given, bounds={"a": (-1, 2)})


def test_solution_keeps_the_sign_of_a_control():
    """x_N = 2 a + 2 costs 8 a^2 + (x_N - 1)^2 / 4: least at a = -1/18, at 0 if a >= 0."""
    for assumptions, best in (({}, -1 / 18), ({"nonnegative": True}, 0.0)):
        control = sp.Symbol("a", **assumptions)
        problem = OptimalControlProblem(
            states=(x,), controls=(control,), dynamics=(control + 1,), dt=0.5, horizon=4,
            q_0=(0,), cost=2 * control**2, terminal_cost=(x - 1) ** 2 / 4,
        )  # fmt: skip
        solution = ann_dc.solve(problem)
        assert solution.certified, solution
        np.testing.assert_allclose(solution["a"], best, atol=1e-7)


@pytest.mark.parametrize("fact", ["positive", "nonnegative", "negative", "nonpositive"])
def test_input_with_a_sign_is_refused_with_the_remedy(fact):
    """A synthesized network, a batch or a family may set any value later: |p| is not p there."""
    size = sp.Symbol("p", **{fact: True})
    reported = rf"inputs\[p\]: .* {fact}=True, .*; declare it as sp.Symbol\('p'\)"
    with pytest.raises(ProblemError, match=reported):
        declared(inputs={size: 0.0}, cost=a**2 / 2 + sp.sqrt(size**2) * x**2)
    declared(inputs={sp.Symbol("p", real=True): -1.0})


@pytest.mark.parametrize("value", ["3", True, 3j, ["1"] * 8, [True] * 8, b"3"])
def test_inputs_that_only_look_like_numbers_are_refused(value):
    with pytest.raises(ProblemError, match=r"inputs\[p\]: expected one number or 8 of them"):
        declared(inputs={p: value})


@pytest.mark.parametrize(
    "formula",
    [
        sp.Function("thrust")(x),
        sp.Derivative(sp.sin(x), x),
        sp.Integral(x, (v, 0, 1)),
        sp.Sum(x, (p, 0, 1)),
        sp.Subs(x**2, x, v),
    ],
    ids=lambda formula: type(formula).__name__,
)
def test_formulas_that_sympy_only_names_are_refused(formula):
    for field in ({"cost": a**2 + formula}, {"dynamics": (v, a + formula)}):
        with pytest.raises(ProblemError, match="that is not evaluated"):
            declared(**field)


def test_a_symbol_with_other_assumptions_is_told_as_another():
    with pytest.raises(ProblemError, match=r"unknown symbol x .* other SymPy assumptions"):
        declared(cost=a**2 + sp.Symbol("x", positive=True))
