"""The whole way: problems go in, certified optima come out, under the names of the problem."""

import json

import numpy as np
import pytest
import sympy as sp
from problems import CAR_G3, SUITE
from reference import ipopt

import ann_dc
from ann_dc import solve
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.status import Outcome
from ann_dc.decomposition.form import SWITCHES
from ann_dc.errors import DesignError, FormError, ProblemError, SynthesisError, UnknownNameError
from ann_dc.gain_design.gains import manual_gains
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import interpolated_guess, random_guess, zero_guess
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize

QUICK = OdeBackend(verify=False)


def assert_optimum(solution, reference) -> None:
    assert solution.status.settled
    assert solution.kkt_residual < 1e-8
    assert solution.certificate.second_order
    np.testing.assert_allclose(solution.objective, reference.objective, rtol=1e-6)
    scale = np.abs(reference.q).max()
    np.testing.assert_allclose(solution["q"].T, reference.q, atol=1e-5 * scale)
    scale = max(np.abs(reference.u).max(), 1.0)
    np.testing.assert_allclose(solution["u"].T, reference.u, atol=1e-5 * scale)


# ---- the paper's example -----------------------------------------------------------------------

STARTS = {
    "line": interpolated_guess,
    "zero": zero_guess,
    "random 1": lambda problem: random_guess(problem, 1),
    "random 2": lambda problem: random_guess(problem, 2),
    "random 3": lambda problem: random_guess(problem, 3),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize(("D", "known"), [(1.0, 398.6315), (0.5, 368.1893)])
def test_the_papers_example(D, known, start):
    problem = plants.car(D=D)
    reference = ipopt(problem)
    np.testing.assert_allclose(reference.objective, known, rtol=1e-6)
    assert_optimum(solve(problem, initial_guess=STARTS[start](problem), backend=QUICK), reference)


@pytest.fixture(scope="module")
def solution():
    return solve(plants.car())


def test_values_by_name(solution):
    n, m, N = 4, 2, 9
    shapes = {"q": (N + 1, n), "u": (N, m), "t": (N, n), "mu": (N, n), "beta": (N, n)}
    for population, shape in shapes.items():
        assert solution[population].shape == shape
    assert solution["phi"].shape == (N + 1,)
    assert solution["nu"].shape == (N,)
    assert solution["mu.phi"].shape == (N,)
    np.testing.assert_array_equal(solution["phi"], solution["q"][:, 2])
    np.testing.assert_array_equal(solution["q.phi"], solution["phi"])
    np.testing.assert_array_equal(solution["nu"], solution["u.nu"])
    np.testing.assert_array_equal(solution["mu.phi"], solution["mu"][:, 2])
    np.testing.assert_array_equal(solution["q"][[0, -1]], [[0, 0, 0, 0], [5, 5, 0, 0]])
    np.testing.assert_allclose(solution["t"], solution["q"][1:], atol=1e-6)
    np.testing.assert_allclose(solution["beta"][1:], -solution["mu"][:-1], atol=1e-5)
    with pytest.raises(UnknownNameError, match=r"value 'speed' does not exist; .*\bnu\b"):
        solution["speed"]


def test_populations_whatever_the_problem_calls_its_own():
    """A control called u and a state called q go before the populations of these names."""
    q, mass, u, a = sp.symbols("q mass u a")
    problem = OptimalControlProblem(
        states=(q, mass), controls=(u, a), map=(q + u, mass + a / 2), cost=u**2 + a**2,
        horizon=3, q_0=(0, 0), q_d=(1, 1),
    )  # fmt: skip
    solution = solve(problem, backend=QUICK)
    assert solution["u"].shape == (3,)
    assert solution["q"].shape == (4,)
    assert solution.populations["u"].shape == (3, 2)
    assert solution.populations["q"].shape == (4, 2)
    np.testing.assert_array_equal(solution.populations["u"][:, 0], solution["u"])
    np.testing.assert_array_equal(solution.populations["q"][:, 1], solution["mass"])
    assert {*solution.populations} == {"q", "u", "t", "mu", "beta"}
    assert "mass" not in solution.populations
    with pytest.raises(UnknownNameError, match=r"population 'mass' does not exist; .*q, u, t, mu"):
        solution.populations["mass"]
    with pytest.raises(TypeError):
        solution.populations["u"] = np.zeros((3, 2))  # type: ignore[index]
    with pytest.raises(ValueError, match="read-only"):
        solution.populations["u"][0, 0] = 1.0


def test_figures_of_the_equations(solution):
    """Section 3: the reference solution of the paper's example."""
    np.testing.assert_allclose(solution["u"][0], (4.311, 5.308), atol=6e-4)
    np.testing.assert_allclose(solution["u"][8], (11.634, 5.114), atol=6e-4)
    np.testing.assert_allclose(solution["q"][1], (0.431, 0, 0, 0.531), atol=6e-4)
    np.testing.assert_allclose(solution["q"][8], (4.128, 4.323, 0.667, -0.517), atol=6e-4)
    np.testing.assert_allclose(np.abs(solution["mu"]).max(), 119.2, atol=0.06)


def test_what_a_solution_says(solution):
    assert "agrees" in solution.run.verified
    assert solution.rollout_error < 1e-5
    assert solution.settling_time > 0
    expected = solution.settling_time * solution.spectrum.radius
    assert solution.normalised_settling_time == expected
    text = str(solution)
    for line in (
        "car: 4 states",
        "status                 settled",
        "strict local minimum",
        "predicted",
    ):
        assert line in text


def test_a_solution_is_plain_data(solution):
    data = json.loads(json.dumps(solution.as_dict(), allow_nan=False))
    assert data["problem"] == "car"
    assert data["form"] == "corrected"
    assert data["status"] == "settled"
    assert data["second_order"] is True
    assert set(data["values"]) == {"x", "y", "phi", "varphi", "nu", "eta"}
    np.testing.assert_array_equal(data["values"]["nu"], solution["nu"])


def test_a_failure_is_plain_data():
    failed = solve(plants.car(N=3), backend=OdeBackend(limit=1.0))
    assert failed.status.outcome is Outcome.NOT_SETTLED
    json.dumps(failed.as_dict(), allow_nan=False)


def test_the_example_of_the_package():
    x, v, a = sp.symbols("x v a")
    problem = ann_dc.OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1,
        cost=a**2 / 2, horizon=20, q_0=(0, 0), q_d=(1, 0),
    )  # fmt: skip
    # least effort: a = R' (R R')^-1 d with R = [A^19 B, ..., B]
    A, B = np.array([[1, 0.1], [0, 1]]), np.array([0, 0.1])
    R = np.column_stack([np.linalg.matrix_power(A, 19 - k) @ B for k in range(20)])
    expected = R.T @ np.linalg.solve(R @ R.T, [1.0, 0.0])
    np.testing.assert_allclose(ann_dc.solve(problem)["a"], expected, rtol=1e-6)


def test_every_public_name_exists():
    for name in ann_dc.__all__:
        if name != "plotting":
            assert getattr(ann_dc, name) is not None
    with pytest.raises(AttributeError, match="solved"):
        _ = ann_dc.solved


# ---- forms and gains ---------------------------------------------------------------------------


def test_both_closings_solve_the_same_problem(solution):
    closed = solve(plants.car(), form=SWITCHES["S14"], backend=QUICK)
    assert closed.status.settled
    assert closed.kkt_residual < 1e-8
    np.testing.assert_allclose(closed.objective, solution.objective, rtol=1e-6)
    np.testing.assert_allclose(closed["u"], solution["u"], atol=1e-5 * np.abs(solution["u"]).max())
    # q_0 is a neuron now, held by its own beta_0 = -F_0' mu_0
    F, _ = closed.problem.functions.map_jacobian(closed["q"][:1].T, closed["u"][:1].T)
    expected = -F[:, :, 0].T @ closed["mu"][0]
    np.testing.assert_allclose(closed["beta"][0], expected, atol=1e-4 * np.abs(closed["mu"]).max())


def test_a_free_end_means_no_control():
    """S13: without the terminal condition the least effort is none."""
    problem = plants.car(N=4, q_0=(1, -1, 0.3, 0.2))
    free = solve(problem, form=SWITCHES["S13"], backend=QUICK)
    assert free.status.settled
    np.testing.assert_allclose(free["u"], 0.0, atol=1e-6)


def test_without_the_control_jacobian_nothing_is_solved():
    """S3, Fig. 4: the constraint residual stays, a multiplier grows."""
    backend = OdeBackend(verify=False, limit=2000.0)
    run = solve(
        plants.car(),
        form=SWITCHES["S3"],
        preconditioner=PreconditionerKind.MULTILEVEL,
        backend=backend,
    )
    assert run.status.outcome is Outcome.NOT_SETTLED
    assert run.kkt_residual > 1e-3
    half = len(run.trajectory.time) // 2
    growth = np.abs(run.trajectory["mu.y"]).max(axis=1)
    assert growth[-1] > 1.2 * growth[half]


def test_gains_by_hand():
    problem = plants.double_integrator(N=6)
    gains = manual_gains(synthesize(problem), rho=1.0, tau={"mu": 0.5})
    answer = solve(problem, gains=gains, backend=QUICK)
    assert answer.design is None
    assert answer.as_dict()["predicted_settling_time"] is None
    assert_optimum(answer, ipopt(problem))


def test_a_recipe():
    problem = plants.double_integrator(N=6)
    answer = solve(problem, preconditioner=PreconditionerKind.DIAGONAL, backend=QUICK)
    assert answer.network.preconditioner.kind is PreconditionerKind.DIAGONAL
    assert_optimum(answer, ipopt(problem))


# ---- what the suite does not have --------------------------------------------------------------


def tracked_pendulum(**changes) -> OptimalControlProblem:
    """A nonlinear plant with a price on its end and a reference that moves."""
    x, v, a, wanted = sp.symbols("x v a wanted")
    fields = {
        "states": (x, v),
        "controls": (a,),
        "dynamics": (v, a - sp.sin(x) - v / 5),
        "dt": 0.2,
        "cost": (x - wanted) ** 2 + a**2 / 4,
        "horizon": 12,
        "q_0": (0.5, 0.0),
        "inputs": {wanted: np.sin(np.arange(12) / 3)},
    }
    return OptimalControlProblem(**(fields | changes))


ENDS = {
    "free end": {},
    "fixed end": {"q_d": (1.0, 0.0)},
    "half-free end": {"q_d": (None, 0.0)},
    "price on the end": {"terminal_cost": "5 * (x - 1)**2 + x**2 * v**2"},
    "price on the free half": {"terminal_cost": "5 * (x - 1)**2 + v**4", "q_d": (None, 0.3)},
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "end", [end if "half" in end else pytest.param(end, marks=pytest.mark.slow) for end in ENDS]
)
def test_ends_and_moving_references(end):
    fields = dict(ENDS[end])
    if "terminal_cost" in fields:
        fields["terminal_cost"] = sp.sympify(fields["terminal_cost"])
    problem = tracked_pendulum(**fields)
    assert_optimum(solve(problem, backend=QUICK), ipopt(problem))


def test_another_reference_needs_no_new_gains():
    problem = tracked_pendulum(q_d=(1.0, 0.0))
    gains = solve(problem, backend=QUICK).design.gains
    moved = problem.with_inputs(q_d=(0.5, 0.1), wanted=np.cos(np.arange(12) / 4))
    answer = solve(moved, gains=gains, backend=QUICK)
    assert_optimum(answer, ipopt(moved))


@pytest.mark.parametrize("N", [1, 2])
def test_short_rows(N):
    problem = plants.lq(N=N, q_d=None)
    assert_optimum(solve(problem, backend=QUICK), ipopt(problem))


@pytest.mark.parametrize("name", ["unicycle", "double_integrator"])
def test_known_optima(name):
    entry = SUITE[name]
    answer = solve(entry.problem, backend=QUICK)
    assert answer.certificate.second_order
    assert np.isclose(answer.objective, entry.optima, rtol=1e-4).any()


@pytest.mark.slow
@pytest.mark.parametrize("start", [zero_guess, interpolated_guess])
def test_ipopt_stays_where_the_network_settled(start):
    """The search behind the design finds cheaper optima than the network does from its starts."""
    problem = SUITE["car_g3"].problem
    answer = solve(problem, initial_guess=start(problem), backend=QUICK)
    assert answer.objective < CAR_G3[3]
    confirmed = ipopt(problem, guess=(answer["q"].T, answer["u"].T))
    assert confirmed.success
    assert_optimum(answer, confirmed)


# ---- problems that are not as they should be ---------------------------------------------------

x, y, u, w = sp.symbols("x y u w")
ODD = {
    "controls that are not unique": {
        "states": (x,), "controls": (u, w), "dynamics": (u + w,), "cost": (u + w) ** 2, "q_d": (1,),
    },
    "no cost": {"states": (x,), "controls": (u,), "dynamics": (u,), "cost": sp.S.Zero, "q_d": (1,)},
    "ends that say the same twice": {
        "states": (x, y), "controls": (u,), "dynamics": (u, 2 * u), "cost": u**2, "q_d": (1, 2),
    },
}  # fmt: skip


@pytest.mark.sampled(2)
@pytest.mark.parametrize("horizon", [6, pytest.param(260, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ODD)
def test_a_singular_kkt_matrix_is_data(name, horizon):
    fields = ODD[name]
    problem = OptimalControlProblem(
        dt=0.1, horizon=horizon, q_0=(0,) * len(fields["states"]), **fields
    )
    answer = solve(problem, backend=OdeBackend(verify=False, most_steps=300))
    assert not answer.certified
    json.dumps(answer.as_dict())


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        (
            {"dynamics": (u - sp.sqrt(x),), "q_0": (-1,), "cost": u**2},
            "the map f .* stage 0 .x = -1",
        ),
        ({"dynamics": (u,), "q_0": (0,), "cost": u**2 + sp.log(x)}, "the cost .* stage 0 .x = 0"),
    ],
)
def test_a_start_outside_the_domain_is_refused(fields, says):
    problem = OptimalControlProblem(
        states=(x,), controls=(u,), dt=0.1, horizon=5, q_d=(1,), **fields
    )
    with pytest.raises(ProblemError, match=says):
        solve(problem)


def test_a_function_without_a_block_is_refused():
    problem = OptimalControlProblem(
        states=(x,), controls=(u,), dynamics=(u,), cost=sp.gamma(u), dt=0.1, horizon=5, q_0=(0,)
    )
    with pytest.raises(SynthesisError, match=r"gamma\(u\): no function block 'gamma'"):
        solve(problem)


def test_numbers_that_overflow_are_told():
    """In scales of its own no number is too large, but for what cannot be multiplied at all."""
    answer = solve(plants.car(q_d=(1e100, 1, 0, 0)), backend=OdeBackend(most_steps=50))
    assert not answer.certified
    with pytest.raises(DesignError, match=r"gains overflow.*choose units"):
        solve(plants.car(q_d=(1e300, 1, 0, 0)))


def test_the_oracle_gain_needs_a_design():
    problem = plants.double_integrator(N=5)
    oracle = solve(problem, form=SWITCHES["S16"], backend=QUICK)
    assert oracle.certified
    assert oracle.settling_time != solve(problem, backend=QUICK).settling_time
    gains = oracle.design.gains
    with pytest.raises(FormError, match="S16"):
        solve(problem, form=SWITCHES["S16"], gains=gains)


def test_a_heavy_terminal_cost_settles_as_fast_as_a_light_one():
    """The pyramid's stiffness knows the terminal cost's Hessian."""

    def ratio(weight):
        problem = OptimalControlProblem(
            states=(x, y), controls=(u,), dynamics=(y, u), dt=0.1, horizon=12, q_0=(0, 0),
            cost=u**2 / 2, terminal_cost=weight * ((x - 1) ** 2 + y**2),
        )  # fmt: skip
        return ann_dc.design(problem).spectrum.stiffness_ratio

    assert ratio(100.0) < 4 * ratio(1.0)


def test_inputs_change_without_rewiring(solution):
    """The frozen network of one target settles to the optimum of another."""
    network = solution.network.with_inputs({"q_d.x": 4.5, "q_d.phi": 0.1})
    run = QUICK.run(network)
    problem = solution.problem.with_inputs(q_d=(4.5, 5, 0.1, 0))
    found = certificate_of(problem, network, run.trajectory.final)
    assert run.status.settled
    assert found.certified
    np.testing.assert_allclose(found.objective, ipopt(problem).objective, rtol=1e-6)


def test_a_target_out_of_reach_is_told():
    """One stage of a double integrator cannot move its position."""
    problem = plants.double_integrator(N=1)
    answer = solve(problem, backend=OdeBackend(verify=False, limit=500))
    assert not answer.status.settled
    assert "no controls reach q_d.x = 1 m (nearest 0 m)" in answer.status.message
