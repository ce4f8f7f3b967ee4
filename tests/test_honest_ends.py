"""What cannot be solved is told as such, soon, by the whole way and by every backend."""

import io

import numpy as np
import pytest
import sympy as sp
from hopeless import INFEASIBLE, UNBOUNDED
from rich.console import Console

import ann_dc
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import FixedStep
from ann_dc.gain_design.gains import manual_gains
from ann_dc.problem import plants
from ann_dc.report.solution import solution_report

SOON = 2000
"""Steps of the first run after which it is known: a second or two."""
QUICK = OdeBackend(verify=False)


def solved_soon(problem, **options):
    solution = ann_dc.solve(problem, **options)
    assert solution.design.first.steps < SOON
    assert not solution.certified
    return solution


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", INFEASIBLE)
def test_an_infeasible_problem_names_what_cannot_be_met(name):
    problem, nearest = INFEASIBLE[name]
    solution = solved_soon(problem)
    assert solution.status.outcome is Outcome.INFEASIBLE
    assert solution.verdict == "infeasible: no controls reach the target"
    for state in nearest:
        assert f"q_d.{state} = " in str(solution.status)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", UNBOUNDED)
def test_an_unbounded_problem_is_told_as_such(name):
    solution = solved_soon(UNBOUNDED[name])
    assert solution.status.outcome is Outcome.UNBOUNDED
    assert "the cost has no minimum" in str(solution)


def test_with_gains_by_hand_too():
    problem = INFEASIBLE["twins"][0]
    network = ann_dc.synthesize(problem)
    gains = manual_gains(network, rho=1.0, tau=1.0)
    solution = ann_dc.solve(problem, gains=gains, backend=OdeBackend(limit=300.0, verify=False))
    assert solution.status.outcome is Outcome.INFEASIBLE


def test_a_design_says_so_too():
    designed = ann_dc.design(INFEASIBLE["twins"][0])
    assert not designed.settled
    assert "did not settle in" in str(designed)
    assert "no controls reach q_d" in str(designed)


@pytest.fixture(scope="module")
def short_car():
    """A network of a car, which on the way to another target comes to the pole of a tangent."""
    return ann_dc.design(plants.car(N=5)).network


def test_a_run_that_crawls_ends_by_its_own_rule(short_car):
    run = QUICK.run(short_car.with_inputs({"q_d.x": 1.8}))
    assert run.status.outcome is Outcome.STALLED
    assert "steps became very short where neuron" in str(run.status)
    assert run.steps < 5000


def test_samples_that_get_no_further_end_alone(short_car):
    targets = np.r_[np.linspace(4.9, 5.1, 4), np.full(4, 1.8)]
    batch = RecurrentBackend().run_batch(short_car, {"q_d.x": targets})
    assert batch.settled[:4].all()
    assert not batch.settled[4:].any()
    assert batch.steps.max() < 10_000


def test_a_recurrence_that_crawls_is_told(monkeypatch):
    monkeypatch.setattr("ann_dc.backends.settling.WINDOW", 20)
    network = ann_dc.design(plants.double_integrator(N=2)).network
    run = RecurrentBackend(step=FixedStep(step=1e-12), limit=400).run(network)
    assert run.status.outcome is Outcome.STALLED
    assert run.steps == 60
    assert "the last of 60 steps did not reduce it" in str(run.status)


def test_a_point_that_is_flat_is_not_called_a_maximum():
    x, a, b = sp.symbols("x a b")
    problem = ann_dc.OptimalControlProblem(
        states=(x,), controls=(a, b), dynamics=(a + b,), cost=(a + b) ** 2, horizon=4, q_0=(0,),
        q_d=(1,),
    )  # fmt: skip
    solution = ann_dc.solve(problem, backend=QUICK)
    assert "not a strict minimum" in solution.verdict
    assert "NOT a minimum" not in solution.verdict


def an_impatient_run():
    return ann_dc.solve(plants.car(N=6), time_limit=1e-9)


def a_stalled_run():
    network = ann_dc.synthesize(plants.double_integrator(N=3))
    backend = OdeBackend(limit=0.01, verify=False)
    return ann_dc.solve(
        plants.double_integrator(N=3),
        gains=manual_gains(network, rho=1.0, tau=1.0),
        backend=backend,
    )


@pytest.mark.parametrize(
    "ended", [an_impatient_run, a_stalled_run, lambda: ann_dc.solve(INFEASIBLE["twins"][0])]
)
def test_a_run_that_did_not_settle_states_no_second_order(ended):
    solution = ended()
    assert not solution.status.settled
    assert solution.as_dict()["second_order"] is None
    table = Console(width=300, file=io.StringIO())
    table.print(solution_report(solution))
    for reported in (str(solution), table.file.getvalue()):
        assert "strict local minimum" not in reported
        assert "not checked: the KKT residual" in reported
