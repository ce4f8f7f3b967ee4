"""The two-level iteration: to IPOPT's optimum with two gains, and nowhere as printed."""

from dataclasses import replace

import numpy as np
import pytest
from closed_chains import (
    CAR,
    CONVEX,
    assert_ipopts_optimum,
    best,
    closed_chain,
    coordination,
    gradient,
    near,
    two_level,
)

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import PRINTED
from ann_dc.gain_design.gains import apply_gains
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.lower_level import Iterated
from ann_dc.two_level.run import TwoLevelRun
from ann_dc.two_level.upper_level import NewtonCoordinator


@pytest.fixture(scope="module")
def cold() -> TwoLevelRun:
    """The car from its line, to the last digits."""
    return two_level().run(settled=closed_chain(CAR).state, tolerance=1e-10)


@pytest.mark.slow
def test_two_gains_solve_the_papers_example(cold):
    assert cold.settled.tolist() == [True]
    needed = replace(cold, tolerance=1e-6).outer_iterations[0]
    assert 0 < needed <= 1.1 * best(CAR).predicted(1e-6)
    assert_ipopts_optimum(CAR, closed_chain(CAR).network, cold.states[0])
    np.testing.assert_allclose(cold.gains[:, 0], best(CAR).lambda_t)
    np.testing.assert_allclose(cold.gains[:, 1], best(CAR).lambda_beta)
    assert len(cold.residuals) == len(cold.inner) == len(cold.gains) + 1


@pytest.mark.slow
def test_the_map_foretells_the_iterations(cold):
    """Near the solution, where the map is the iteration."""
    early, late = (replace(cold, tolerance=eps).outer_iterations[0] for eps in (1e-6, 1e-10))
    np.testing.assert_allclose(late - early, best(CAR).predicted(1e-4), rtol=0.2)
    run = two_level().run(near(CAR, 1e-3), tolerance=1e-9)
    drop = 1e-9 / run.residuals[0, 0]
    np.testing.assert_allclose(run.outer_iterations[0], best(CAR).predicted(drop), rtol=0.2)


@pytest.mark.parametrize("problem", CONVEX.values(), ids=CONVEX)
def test_convex_problems(problem):
    run = two_level(problem).run(tolerance=1e-9)
    assert run.settled.all()
    assert_ipopts_optimum(problem, closed_chain(problem).network, run.states[0])


def test_one_call_is_one_outer_iteration():
    levels, count = two_level(), 3
    x = closed_chain(CAR).network.start_state
    run = levels.run(x, limit=count)
    for _ in range(count):
        x = levels.step(x)
    network = closed_chain(CAR).network
    np.testing.assert_array_equal(*(coordination(network, y) for y in (x, run.states)))


@pytest.mark.slow
def test_theta_ends_at_zero(cold):
    theta = cold.lyapunov.theta
    assert theta.shape == cold.residuals.shape
    assert theta[-1] < 1e-10 * theta[0]
    assert two_level().run(limit=1).lyapunov is None


def test_the_printed_iteration_does_not_settle():
    network = synthesize(decompose(CAR, replace(PRINTED, start_is_neuron=True)))
    network = apply_gains(network, closed_chain(CAR).gains)
    run = two_level(CAR).run(limit=15)
    layer = TwoLevels(network, upper=gradient(CAR), lower=Iterated(limit=100))
    printed = layer.run(limit=15)
    assert printed.outer_iterations.tolist() == [-1]
    assert printed.residuals[-1] > 100 * run.residuals[-1]
    with np.errstate(all="ignore"):  # its numbers overflow
        assert not certificate_of(CAR, network, printed.states[0]).certified


STARTS = np.array([[0.5, -0.2, 0.1, 0.0], [1.0, 1.0, 0.2, 0.1], [0.0, 0.3, 0.0, -0.2]])


def start_inputs(starts: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip((f"q_0.{s}" for s in CAR.states), starts.T))


@pytest.mark.parametrize("upper", [None, NewtonCoordinator()], ids=["gradient", "newton"])
def test_a_batch_is_its_samples(upper):
    layer, x, limit = two_level(upper=upper), closed_chain(CAR).state, 10
    run = layer.run(x, start_inputs(STARTS), limit=limit)
    assert run.residuals.shape[1] == len(run.states) == 3
    for sample, start in enumerate(STARTS):
        alone = layer.run(x, start_inputs(start[None]), limit=limit)
        same = len(alone.residuals)
        together = run.residuals[:same, sample]
        np.testing.assert_allclose(together, alone.residuals[:, 0], rtol=1e-4, atol=1e-9)
        assert alone.outer_iterations[0] == run.outer_iterations[sample]
        np.testing.assert_allclose(run.states[sample], alone.states[0], atol=1e-5)


def test_a_sample_that_is_no_number_costs_itself_only():
    layer, x = two_level(upper=NewtonCoordinator()), closed_chain(CAR).state
    bad = np.insert(STARTS, 1, [np.nan, 0, 0, 0], axis=0)
    run, clean = (layer.run(x, start_inputs(starts)) for starts in (bad, STARTS))
    assert run.settled.tolist() == [True, False, True, True]
    assert run.residuals[-1, 1] == np.inf
    np.testing.assert_array_equal(run.states[[0, 2, 3]], clean.states)
    np.testing.assert_array_equal(run.outer_iterations[[0, 2, 3]], clean.outer_iterations)


def test_a_sample_that_runs_away_costs_itself_only():
    x = near(CAR, 1e-4)
    run, clean = (two_level().run(np.stack(s), limit=12) for s in ((x, 50 * x), (x,)))
    assert run.residuals[-1, 1] == np.inf
    np.testing.assert_allclose(run.residuals[:, 0], clean.residuals[:, 0], rtol=1e-6, atol=1e-10)
    np.testing.assert_allclose(run.states[0], clean.states[0], atol=1e-8)
