"""Stage equations of a problem that can be split by hand."""

import pytest
import sympy as sp

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import PRINTED, PRINTED_CONDITIONS, PRINTED_EXAMPLE, SWITCHES, switch
from ann_dc.errors import FormError
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.step_length import StepLength

x, a = sp.symbols("x a")
mu, t, t_prev, beta, beta_next = sp.symbols("mu_x t_x t_prev_x beta_x beta_next_x")


def problem(**changes) -> OptimalControlProblem:
    fields = {
        "states": (x,),
        "controls": (a,),
        "map": (x + sp.sin(x) * a,),
        "cost": x**2 + a**2 / 2,
        "terminal_cost": 3 * x**2,
        "horizon": 3,
        "q_0": (0,),
    }
    return OptimalControlProblem(**(fields | changes))


def test_every_equation_is_a_derivative_of_the_lagrangian():
    stage = decompose(problem())
    L = x**2 + a**2 / 2 + mu * (x + sp.sin(x) * a - t) + beta * (x - t_prev)
    assert sp.expand(stage.lagrangian - L) == 0
    by_hand = {x: L.diff(x), a: L.diff(a), mu: L.diff(mu), t: -mu - beta_next, beta: L.diff(beta)}
    for equation in stage.all:
        assert sp.expand(equation.expression - by_hand[equation.variable]) == 0
        assert equation.sign == (1 if equation.variable in (mu, beta) else -1)
    assert stage.terminal_cost == 3 * t**2


def test_equations_carry_the_papers_numbers():
    numbers = {str(e.variable): number for number, e in decompose(problem()).numbered}
    assert numbers == {"x": 11, "a": 12, "mu_x": 13, "t_x": 14, "beta_x": 15}


def test_printed_iteration_carries_the_numbers_16_and_17():
    stage = decompose(problem(), PRINTED)
    numbers = {str(e.variable): number for number, e in stage.numbered}
    assert numbers == {"x": 16, "a": 16, "mu_x": 16, "t_x": 17, "beta_x": 17}
    L = (x**2 + a**2 / 2) / 3 + mu * (x + sp.sin(x) * a - t) + beta * (x - t_prev)
    assert sp.expand(stage.lagrangian - L) == 0  # (10) has none of the slips of (16), (17)


def test_printed_conditions_of_the_car_are_those_of_11_to_15():
    car = plants.car()
    stage = decompose(car, PRINTED_CONDITIONS)
    nu, phi = (sp.Symbol(name) for name in ("nu", "phi"))
    own = {str(e.variable): (number, sp.nsimplify(e.expression)) for number, e in stage.numbered}
    mu_x, mu_y, mu_phi = sp.symbols("mu_x mu_y mu_phi")
    varphi, x_, t_x, t_prev_x, beta_x, beta_next_x = sp.symbols(
        "varphi x t_x t_prev_x beta_x beta_next_x"
    )
    kept = sp.Rational(9, 10)  # 1 - gamma
    pushed = mu_x * sp.cos(phi) + mu_y * sp.sin(phi) + mu_phi * sp.tan(varphi)
    by_hand = {
        "x": (11, kept * mu_x + beta_x),
        "nu": (12, pushed),
        "mu_x": (13, nu * sp.cos(phi) + kept * x_ - t_x),
        "t_x": (14, -mu_x + beta_next_x),
        "beta_x": (15, x_ + t_prev_x),
    }
    for name, (number, expression) in by_hand.items():
        assert own[name][0] == number
        assert sp.simplify(own[name][1] - expression) == 0


def test_printed_example_has_the_lagrangian_of_25():
    stage = decompose(problem(), PRINTED_EXAMPLE)
    L = 3 * (x**2 + a**2 / 2) + mu * (x + sp.sin(x) * a - t) + beta * (0.99 * x - t_prev)
    assert sp.expand(stage.lagrangian - L) == 0


def test_as_text():
    lines = str(decompose(problem())).splitlines()
    assert lines[0] == "form: corrected"
    assert lines[3] == "(12) tau da/ds = -( a + mu_x*sin(x) )"
    assert lines[4] == "(13) tau dmu_x/ds = +( a*sin(x) - t_x + x )"
    assert lines[6] == "(15) tau dbeta_x/ds = +( -t_prev_x + x )"


def test_a_name_that_the_user_has_taken():
    taken = sp.Symbol("mu_x")
    stage = decompose(problem(controls=(taken,), map=(x + taken,), cost=taken**2))
    assert [str(s) for s in stage.mu] == ["mu_x_"]


def test_a_switch_without_a_meaning_here():
    with pytest.raises(FormError, match="no value at u = 0"):
        decompose(problem(map=(x + 1 / a,)), SWITCHES["S4"])


def test_the_printed_form_differs_where_it_says():
    stage = decompose(problem(), PRINTED)
    assert stage.t_neighbour == (sp.Symbol("t_next_x"),)
    assert stage.grad_beta[0].expression == x + sp.Symbol("t_next_x")
    assert [e.sign for e in (*stage.grad_q, *stage.grad_u)] == [1, 1]


@pytest.mark.parametrize("name", ["S11", "S15", "S17"])
def test_a_free_start_needs_its_first_stage(name):
    with pytest.raises(FormError, match="S11, S15, S17: q_0 leaves x free"):
        decompose(problem(q_0=(None,)), SWITCHES[name])


@pytest.mark.parametrize("form", [*map(switch, ("S4", "S6", "S17")), PRINTED], ids=str)
def test_a_dt_that_is_chosen_cannot_be_left_out(form):
    with pytest.raises(FormError, match=r"S4, S6, S17: .* which this problem determines|S11, S15"):
        decompose(problem(dt=StepLength(low=0.1)), form)
