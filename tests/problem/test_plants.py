"""The plants against closed forms, then against IPOPT."""

import numpy as np
import pytest
import sympy as sp
from problems import SUITE
from reference import best_of, ipopt

from ann_dc.errors import UnknownNameError
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem

FAST = ["car", "car_D.5", "unicycle", "bicycle", "double_integrator"]
FAST += ["lq_stable", "lq_unst", "lq_unst_nc", "van_der_pol", "pendulum", "cstr"]


def test_suite_is_the_table():
    assert len(SUITE) == 23
    for entry in SUITE.values():
        assert list(entry.optima) == sorted(entry.optima)


def test_car_is_the_printed_map():
    """(22) with D = c/m = 1 and a = 1 - 0.1 dt."""
    problem = plants.car()
    x, y, phi, varphi = problem.states
    nu, eta = problem.controls
    printed = (
        0.99 * x + 0.1 * sp.cos(phi) * nu,
        0.99 * y + 0.1 * sp.sin(phi) * nu,
        0.99 * phi + 0.1 * sp.tan(varphi) * nu,
        0.99 * varphi + 0.1 * eta,
    )
    point = dict(zip((*problem.states, *problem.controls), (0.3, -0.2, 0.5, 0.4, 1.7, -0.6)))
    for ours, theirs in zip(problem.f, printed):
        assert float(ours.subs(point)) == pytest.approx(float(theirs.subs(point)), rel=1e-14)


@pytest.mark.parametrize("name", plants.names())
def test_every_plant_declares_and_takes_the_common_parameters(name):
    plant = plants.get(name)
    n = plant(dt=0.02).n
    problem = plant(dt=0.02, N=5, q_0=(0.5,) * n, q_d=(None,) * n)
    assert (problem.name, problem.dt, problem.horizon) == (name, 0.02, 5)
    assert problem.q_0 == (0.5,) * n
    assert not any(problem.fixed)
    assert plant.__doc__


@pytest.mark.parametrize("name", plants.names())
def test_every_plant_knows_its_units(name):
    problem = plants.get(name)()
    for symbol in (*problem.states, *problem.controls):
        assert problem.unit(str(symbol))


@pytest.mark.parametrize("name", plants.names())
def test_rates_fit_the_units_of_their_states(name):
    """Where a state's rate is another state, as x' = v, its unit is that of x over time."""
    problem = plants.get(name)()
    for state, rate in zip(problem.states, problem.dynamics or ()):
        if rate in problem.states or rate in problem.controls:
            own, time = problem.unit(str(state)), problem.time_unit
            per_time = own if time == "1" else f"{own}/{time}".replace("/s/s", "/s^2")
            assert problem.unit(str(rate)) == per_time


def test_names_are_sorted_and_an_unknown_one_is_answered_with_them():
    assert list(plants.names()) == sorted(plants.names())
    with pytest.raises(
        UnknownNameError, match=r"plant 'boat' does not exist.*car, car_free_time, cart_pole"
    ):
        plants.get("boat")


def test_lq_has_the_spectral_radius_asked_for():
    problem = plants.lq(seed=2, spectral_radius=1.2)
    F, _ = problem.functions.map_jacobian(np.zeros((4, 1)), np.zeros((2, 1)))
    assert abs(np.linalg.eigvals(F[..., 0])).max() == pytest.approx(1.2)


def test_double_integrator_has_its_closed_form():
    """Least norm: u = C'(C C')^-1 d, where C takes the controls to the final state."""
    dt, N = 0.1, 20
    C = np.array([[dt * dt * (N - 1 - k) for k in range(N)], [dt] * N])
    u = np.linalg.lstsq(C, [1.0, 0.0], rcond=None)[0]
    found = ipopt(plants.double_integrator())
    assert found.objective == pytest.approx(u @ u / 2, rel=1e-9)
    assert u @ u / 2 == pytest.approx(SUITE["double_integrator"].optima[0], rel=1e-5)
    np.testing.assert_allclose(found.u[0], u, atol=1e-7)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", FAST)
def test_optimum_of_the_table(name):
    found = best_of(SUITE[name].problem, starts=3)
    assert found.objective == pytest.approx(SUITE[name].optima[0], rel=1e-4)


@pytest.mark.parametrize("name", FAST)
def test_ipopt_and_the_declaration_agree_on_what_was_solved(name):
    problem = SUITE[name].problem
    found = ipopt(problem)
    functions = problem.functions
    assert functions.objective(found.q, found.u) == pytest.approx(found.objective, rel=1e-9)
    gap = functions.map(found.q[:, :-1], found.u) - found.q[:, 1:]
    assert abs(gap).max() < 1e-8
    np.testing.assert_allclose(found.q[:, -1], problem.q_d, atol=1e-8)


def test_reference_handles_free_ends_terminal_cost_and_inputs():
    """x_{k+1} = x_k + a_k with cost a**2/2 + w a and terminal cost (x_N - 1)**2/2."""
    x, a, w = sp.symbols("x a w")
    problem = OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + a,), cost=a**2 / 2 + w * a,
        terminal_cost=(x - 1) ** 2 / 2, horizon=3, q_0=(0,), inputs={w: (0.1, 0.2, 0.3)},
    )  # fmt: skip
    # a_k = -w_k - p with p = x_N - 1 and x_N = sum a_k = -0.6 - 3p, so p = -0.4.
    found = ipopt(problem)
    np.testing.assert_allclose(found.u[0], [0.3, 0.2, 0.1], atol=1e-8)
    assert found.q[0, -1] == pytest.approx(0.6)
