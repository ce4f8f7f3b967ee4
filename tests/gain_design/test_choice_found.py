"""Networks for optima that a search found: kinds in turn, penalties, presets."""

import numpy as np
import pytest
import sympy as sp

import ann_dc
from ann_dc import PreconditionerKind, StepLength
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE
from ann_dc.gain_design.rule_presets import COARSE

x, y, v, a, b, h, theta = sp.symbols("x y v a b h theta")


def thrifty():
    """A price of the absolute effort, as two controls that do not pull against each other."""
    return ann_dc.OptimalControlProblem(
        states=(x, v), controls=(a, b), dynamics=(v, a - b - 0.1 * v), dt=0.2, horizon=30,
        cost=a + b + 1e-3 * (a**2 + b**2), q_0=(0, 0), q_d=(5, 0), bounds={a: (0, 1), b: (0, 1)},
    )  # fmt: skip


def boat():
    """Zermelo's boat: the shortest crossing of a current, by its heading."""
    return ann_dc.OptimalControlProblem(
        states=(x, y), controls=(theta,), dynamics=(sp.cos(theta) - y / 2, sp.sin(theta)),
        dt=StepLength(low=0.05, high=1), cost=h, horizon=25, q_0=(3.66, -1.86), q_d=(0, 0),
    )  # fmt: skip


def catalysts():
    """Two catalysts with a tiny price: the penalty of the closed form is far too small."""
    return ann_dc.OptimalControlProblem(
        states=(x, y), controls=(a,), dynamics=(a * (10 * y - x), a * (x - 10 * y) - (1 - a) * y),
        dt=0.02, horizon=50, cost=1e-2 * (a - 0.5) ** 2, terminal_cost=x + y - 1, q_0=(1, 0),
        bounds={a: (0, 1)},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "objective"),
    [(thrifty, 10.173420), (boat, 5.4515622), (catalysts, -0.035970892)],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_network_of_a_found_optimum_settles_from_the_start_or_a_coarse_preset(problem, objective):
    solution = ann_dc.solve(problem())  # objectives: IPOPT, the best of six starts
    assert solution.certified, solution.status
    assert solution.status.settled
    assert solution.objective == pytest.approx(objective, rel=1e-5)
    assert solution.design.first.found_by
    assert solution.design.start in ("", *COARSE)
    assert solution.normalised_settling_time < 200
    assert np.isfinite(solution.design.best.ratio)


@pytest.mark.slow
def test_penalty_is_raised_where_the_grid_of_the_closed_form_does_not_settle():
    solution = ann_dc.solve(thrifty(), preconditioner=PreconditionerKind.RESISTIVE_GRID)
    assert solution.design.best.gain_rule.penalty > MULTILEVEL_RULE.penalty


@pytest.mark.slow
def test_multipliers_of_dependent_rows_do_not_make_a_network_slow():
    """Every control is at a limit, so that two ends have one free variable, the step length."""
    problem = ann_dc.OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=StepLength(low=0.02, high=0.5),
        cost=h, horizon=20, q_0=(0, 0), q_d=(1, 0), bounds={a: (-1, 1)},
    )  # fmt: skip
    solution = ann_dc.solve(problem)
    assert solution.certified
    assert solution.status.settled
    assert solution.total_time == pytest.approx(2.0, abs=1e-6)  # bang-bang with a switch half-way
    assert solution.design.best.ratio < 100


def unicycle(N):
    """A unicycle with limits beside a disc, over the same three seconds."""
    q_x, q_y, heading, speed, turn = sp.symbols("q_x q_y heading speed turn")
    return ann_dc.OptimalControlProblem(
        states=(q_x, q_y, heading), controls=(speed, turn), dt=3 / N, horizon=N,
        dynamics=(speed * sp.cos(heading), speed * sp.sin(heading), turn),
        cost=(speed**2 + turn**2) / 2, q_0=(0, 0, 0), q_d=(3, 0.4, 0),
        bounds={speed: (0, 1.3), turn: (-1.2, 1.2)},
        constraints=[(q_x - 1.5) ** 2 + (q_y - 0.1) ** 2 >= 0.5**2],
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("N", "objective"),
    [(10, 7.310723), (30, 22.031823), (100, 73.083503), (300, 218.878542), (1000, 729.150759)],
)
def test_settling_with_limits_and_a_disc_does_not_grow_with_the_row(N, objective):
    solution = ann_dc.solve(unicycle(N))
    assert solution.certified
    assert solution.objective == pytest.approx(objective, rel=1e-6)
    assert solution.design.start in ("", *COARSE)
    assert 30 < solution.normalised_settling_time < (120 if N <= 300 else 150)
