"""Starts in the domain of map, cost and inequalities."""

import numpy as np
import pytest
import sympy as sp

import ann_dc
from ann_dc.errors import ProblemError
from ann_dc.problem.domain import culprit, defined, into_domain, within_domain

c, k, a, b = sp.symbols("c k a b")


def consumption(bounds=None):
    """Capital from which logarithmic utility is drawn: undefined where nothing is consumed."""
    return ann_dc.OptimalControlProblem(
        states=(k,), controls=(c,), dynamics=(0.5 * k - c,), cost=-0.2 * sp.log(c), dt=0.2,
        horizon=20, q_0=(10,), bounds={k: (0, None), **(bounds or {})},
    )  # fmt: skip


def test_line_of_a_logarithm_starts_where_the_control_holds_the_state():
    assert ann_dc.interpolated_guess(consumption()).u == pytest.approx(np.full((1, 20), 5.0))


def test_controls_outside_the_domain_go_to_the_middle_of_their_limits():
    problem = consumption({c: (0, 3)})
    moved = into_domain(problem, np.full((1, 20), 10.0), np.zeros((1, 20)))
    assert moved == pytest.approx(np.full((1, 20), 1.5))


def test_controls_inside_the_domain_stay_where_they_are():
    u = np.full((1, 20), 0.25)
    assert into_domain(consumption(), np.full((1, 20), 10.0), u) is u


def test_steps_out_of_the_domain_are_halved_where_they_lead_out():
    step = np.where(np.arange(20) < 3, -5.0, 1.0)[None]
    found = within_domain(consumption(), np.full((1, 20), 10.0), np.full((1, 20), 2.0), step)
    assert found[0, :3] == pytest.approx(np.full(3, 2.0 - 1.25))
    assert found[0, 3:] == pytest.approx(np.full(17, 3.0))


def test_line_leaves_the_kink_of_a_norm():
    problem = ann_dc.OptimalControlProblem(
        states=(k,), controls=(a, b), dynamics=(a - b,), cost=a**2 + b**2, horizon=5, dt=0.1,
        q_0=(0,), q_d=(0,), constraints={"norm": sp.sqrt(a**2 + b**2) <= 1},
    )  # fmt: skip
    start = ann_dc.interpolated_guess(problem)
    assert defined(problem, start.q[:, :-1], start.u).all()
    assert ann_dc.synthesize(problem).size


@pytest.mark.parametrize(
    ("formula", "expected"),
    [(sp.log(c) + k, "log(c)"), (sp.sqrt(c) * k, "sqrt(c)"), (k / c, "1/c"), (k**2 + c**2, "")],
)
def test_first_function_without_a_finite_slope_is_named(formula, expected):
    assert culprit([formula], {c: 0.0, k: 10.0}) == expected


def test_start_outside_the_domain_names_the_control_and_the_term():
    problem = consumption()
    start = ann_dc.InitialGuess(q=np.full((1, 21), 10.0), u=np.zeros((1, 20)))
    with pytest.raises(ProblemError, match=r"stage 0 \(k = 10, c = 0\), because of log\(c\)"):
        ann_dc.synthesize(problem, initial_guess=start)
