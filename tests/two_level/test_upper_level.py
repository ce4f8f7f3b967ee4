"""The upper level: two gains that are repelled without rho, and Newton steps."""

import numpy as np
import pytest
from closed_chains import CAR, CONVEX, assert_ipopts_optimum, closed_chain, coordination
from designs import designed
from reference import ipopt

from ann_dc.errors import NetworkError
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.network.network import COORDINATION
from ann_dc.problem import plants
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.upper_gains import UpperMap
from ann_dc.two_level.upper_level import Gradient, NewtonCoordinator


@pytest.mark.slow
def test_a_convex_problem_needs_no_rho():
    problem = plants.lq(N=4)
    found = closed_chain(problem)
    plain = apply_gains(found.network, manual_gains(found.network))
    gains = UpperMap(network=plain, settled=found.state).best()
    upper = Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta)
    run = TwoLevels(plain, upper=upper).run(tolerance=1e-5)
    assert run.settled.all()
    certificate = certificate_of(problem, plain, run.states[0])
    np.testing.assert_allclose(certificate.objective, ipopt(problem).objective, rtol=1e-4)
    assert certificate.kkt_residual < 1e-4


@pytest.mark.slow
def test_the_plain_car_is_repelled():
    """rho = 0: along the worst eigenvector of S the error grows by |1 + lambda s| an iteration."""
    found, gain, count = closed_chain(CAR), 0.1, 250
    plain = apply_gains(found.network, manual_gains(found.network))
    values, vectors = np.linalg.eig(UpperMap(network=plain, settled=found.state).schur.T)
    worst = values.real.argmax()
    left = vectors[:, worst]
    start = found.state.copy()
    start[plain.of_population(*COORDINATION)] += 1e-5 * left.real
    layer = TwoLevels(plain, upper=Gradient(lambda_t=gain, lambda_beta=gain))
    run = layer.run(start, tolerance=1e-9, limit=count)
    assert run.outer_iterations.tolist() == [-1]
    before, after = (coordination(plain, x - found.state) for x in (start, run.states[0]))
    growth = abs(1 + gain * values[worst]) ** count
    assert growth > 1.4
    np.testing.assert_allclose(abs(left @ after) / abs(left @ before), growth, rtol=0.01)


CLOSINGS = pytest.mark.parametrize(
    "found", [lambda: designed("car"), lambda: closed_chain(CAR)], ids=["closing A", "closing B"]
)


def moved(shares) -> dict[str, np.ndarray]:
    """Inputs with q_0 a share of the way to q_d."""
    way = zip(CAR.states, CAR.q_0, CAR.q_d)
    return {f"q_0.{s}": a + np.asarray(shares) * (d - a) for s, a, d in way}


@CLOSINGS
def test_newton_from_a_cold_start(found):
    network = found().network
    run = TwoLevels(network, upper=NewtonCoordinator()).run(tolerance=1e-9)
    assert 0 < run.outer_iterations[0] <= 10
    assert np.isnan(run.gains).all()
    assert_ipopts_optimum(CAR, network, run.states[0])


@CLOSINGS
def test_newton_follows_a_start_that_moves(found):
    """ "Convergence after the third iteration" is honest only so."""
    shares = np.array([0.01, 0.05, 0.2])
    run = TwoLevels(found().network, upper=NewtonCoordinator()).run(found().state, moved(shares))
    assert run.settled.all()
    assert (run.outer_iterations <= [2, 3, 4]).all()
    for share, x in zip(shares, run.states):
        problem = plants.car(q_0=tuple(share * np.array(CAR.q_d)))
        network = found().network.with_inputs({k: v[0] for k, v in moved([share]).items()})
        assert_ipopts_optimum(problem, network, x)


@pytest.mark.parametrize("problem", CONVEX.values(), ids=CONVEX)
def test_newton_needs_one_iteration_where_all_is_linear(problem):
    """Without a slew to shorten it."""
    layer = TwoLevels(synthesize(problem), upper=NewtonCoordinator(slew=1e6))
    run = layer.run(tolerance=1e-9)
    assert run.outer_iterations.tolist() == [1]
    assert_ipopts_optimum(problem, layer.network, run.states[0])


def test_a_newton_step_is_shortened_to_the_slew():
    network = synthesize(CAR)
    chain = network.of_population("q", "t")
    duals = network.of_population("mu", "beta")
    x = np.where(duals, 100.0, network.start_state)
    whole, short = (
        TwoLevels(network, upper=NewtonCoordinator(slew=slew)).step(x)[0] - x for slew in (1e6, 0.1)
    )
    assert np.abs(whole).max() > np.abs(whole[chain]).max() > 0.1  # duals may move further
    np.testing.assert_allclose(np.abs(short[chain]).max(), 0.1)
    np.testing.assert_allclose(short, whole * 0.1 / np.abs(whole[chain]).max(), rtol=1e-9)


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (lambda: Gradient(lambda_t=-1.0, lambda_beta=1.0), "lambda_t"),
        (lambda: Gradient(lambda_t=1.0, lambda_beta=np.nan), "lambda_beta"),
        (lambda: NewtonCoordinator(slew=0.0), "slew"),
    ],
)
def test_a_number_out_of_range_is_named(build, name):
    with pytest.raises(NetworkError, match=name):
        build()
