"""The answer where a network does not settle, and what is known without it."""

from dataclasses import dataclass

import numpy as np
import pytest
import sympy as sp
from constrained import CONSTRAINED
from reference import ipopt

import ann_dc
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome, not_settled
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.network.preconditioners.base import ALL_KINDS
from ann_dc.progress import Stopped, silent
from ann_dc.solution.solution import certificate_of


@dataclass(frozen=True)
class Never:
    """A backend on which no network settles; it counts the networks that it is given."""

    seen: list
    progress: object = silent
    stops: bool = False

    kinds = ALL_KINDS

    def run(self, network):
        self.seen.append(network)
        if self.stops:
            raise Stopped("somebody pressed a key")
        x = network.start_state
        residuals, recorder = fast_evaluator(network).residuals(x), Recorder(network)
        recorder.record(0.0, x, residuals)
        reported = not_settled(residuals, 1e4, "a test said so")
        return recorder.run(0.0, x, reported, Settling(), 0)


@pytest.fixture(scope="module")
def problem():
    return ann_dc.plants.double_integrator(N=8)


def test_known_optimum_is_the_answer_if_no_network_settles_there(problem):
    found = ann_dc.solve(problem, backend=Never([]))
    assert found.status.outcome is Outcome.FOUND
    assert found.certified
    assert not found.status.settled
    assert "found by the gain-scheduled run" in found.status.message
    assert "a test said so" in found.status.message
    assert found["a"] == pytest.approx(ann_dc.solve(problem)["a"], abs=1e-6)


def test_next_best_networks_run_before_one_gives_up(problem):
    backend = Never([])
    found = ann_dc.solve(problem, backend=backend)
    settled = sum(candidate.settling < np.inf for candidate in found.design.candidates)
    presets = 2  # of a short row: the path and a state near the optimum
    assert len(backend.seen) == min(settled, 3) + presets
    assert settled > 1
    gains = [network.preconditioner.kind for network in backend.seen]
    assert gains[0] is found.design.best.kind


def test_stopped_run_says_so_beside_the_known_optimum(problem):
    found = ann_dc.solve(problem, backend=Never([], stops=True))
    assert found.status.outcome is Outcome.STOPPED
    assert found.certified
    assert "(somebody pressed a key); raise --time-limit" in found.status.message
    assert found.status.message.endswith("; the optimum was found by the gain-scheduled run")


def test_gains_by_hand_leave_nothing_known(problem):
    gains = ann_dc.design(problem).gains
    found = ann_dc.solve(problem, gains=gains, backend=Never([]))
    assert found.status.outcome is Outcome.NOT_SETTLED
    assert not found.certified
    assert np.isnan(found.settling_time)


@pytest.mark.slow
def test_run_that_settles_at_a_dearer_optimum_is_not_the_answer():
    """Euler steps of a rehearsal and the ODE lead to different optima: 172.4 and 226.9."""
    problem = CONSTRAINED["car_disc3"].problem
    solution = ann_dc.solve(problem)
    aim = certificate_of(problem, solution.network, solution.design.state)
    assert solution.certified
    assert solution.status.settled
    assert solution.objective == pytest.approx(aim.objective, rel=1e-6)


@pytest.mark.slow
def test_flat_cost_is_followed_until_a_newton_step_is_small():
    """Treatment of an infection: a residual of 5e-9 left a Newton step of 2.8e-4 of a control."""
    T, i, v, u = sp.symbols("T I V u")
    problem = ann_dc.OptimalControlProblem(
        states=(T, i, v),
        controls=(u,),
        dynamics=(
            10 - 0.02 * T - (1 - u) * 2.4e-5 * v * T,
            (1 - u) * 2.4e-5 * v * T - 0.24 * i,
            28.8 * i - 2.4 * v,
        ),
        dt=0.5,
        horizon=40,
        cost=-T / 1000 + u**2 / 20,
        q_0=(800, 0.04, 1.5),
        bounds={u: (0, 0.9)},
    )
    solution = ann_dc.solve(problem)
    assert solution.status.settled
    assert solution.certified
    assert solution.objective == pytest.approx(ipopt(problem).objective, rel=1e-6)


def test_run_that_rounding_keeps_from_its_end_has_settled(problem):
    never = ann_dc.OdeBackend(settling=Settling(confirm=1e-12))
    stalled = never.run(ann_dc.design(problem).network)
    assert stalled.status.outcome is Outcome.STALLED
    found, usual = ann_dc.solve(problem, backend=never), ann_dc.solve(problem)
    assert found.certified
    assert found.status.settled
    assert "rounding" in found.run.verified
    assert found.run.settling_time == pytest.approx(usual.run.settling_time, rel=1e-3)
