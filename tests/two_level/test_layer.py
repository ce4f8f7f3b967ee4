"""The two-level iteration: to IPOPT's optimum with two gains or Newton, and nowhere as printed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from designs import designed
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from reference import ipopt

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import PRINTED, switch
from ann_dc.errors import NetworkError
from ann_dc.gain_design.gains import apply_gains, hand_gains
from ann_dc.gain_design.procedure import Design, design
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import COORDINATION, Network
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solution import certificate_of, neuron_values
from ann_dc.solver import synthesize
from ann_dc.two_level.layer import TwoLevelLayer, TwoLevelRun
from ann_dc.two_level.lower_level import Closed, Iterated
from ann_dc.two_level.oracle_gain import OracleGain
from ann_dc.two_level.upper_gains import UpperGains, UpperMap
from ann_dc.two_level.upper_level import Gradient, NewtonCoordinator, Oracle

NEURON = switch("S14")
CAR = plants.car()


@cache
def closed_chain(problem: OptimalControlProblem) -> Design:
    """Closing B: q_0 is a neuron."""
    return design(synthesize(decompose(problem, NEURON)))


@cache
def best(problem: OptimalControlProblem) -> UpperGains:
    found = closed_chain(problem)
    return UpperMap(network=found.network, settled=found.state).best()


def gradient(problem: OptimalControlProblem) -> Gradient:
    gains = best(problem)
    return Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta)


def two_level(problem=CAR, *, upper=None, lower=None) -> TwoLevelLayer:
    upper = upper or gradient(problem)
    return TwoLevelLayer(closed_chain(problem).network, upper=upper, lower=lower)


def near(problem, size: float, seed: int = 0) -> np.ndarray:
    """The solution and a normal deviation."""
    state = closed_chain(problem).state
    return state + size * np.random.default_rng(seed).standard_normal(len(state))


def coordination(network: Network, states: np.ndarray) -> np.ndarray:
    """t and beta of states (..., n)."""
    return states[..., network.of_population(*COORDINATION)]


def assert_ipopts_optimum(problem, network, x) -> None:
    reference = ipopt(problem)
    proof, values = certificate_of(problem, network, x), neuron_values(network, x)
    assert proof.certified
    np.testing.assert_allclose(proof.objective, reference.objective, rtol=1e-6)
    scale = np.abs(reference.q).max()
    np.testing.assert_allclose(values["t"].T, reference.q[:, 1:], atol=1e-5 * scale)
    scale = np.abs(reference.u).max()
    np.testing.assert_allclose(values["u"].T, reference.u, atol=1e-5 * scale)


# ---- two gains ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cold() -> TwoLevelRun:
    """The car from its line, to the last digits."""
    return two_level().run(settled=closed_chain(CAR).state, tolerance=1e-10)


def test_two_gains_solve_the_papers_example(cold):
    assert cold.settled.tolist() == [True]
    assert 0 < replace(cold, tolerance=1e-6).outer_iterations[0] <= 200
    assert_ipopts_optimum(CAR, closed_chain(CAR).network, cold.states[0])
    np.testing.assert_allclose(cold.gains[:, 0], best(CAR).lambda_t)
    np.testing.assert_allclose(cold.gains[:, 1], best(CAR).lambda_beta)
    assert len(cold.residuals) == len(cold.inner) == len(cold.gains) + 1


def test_the_map_foretells_the_iterations(cold):
    """Near the solution, where the map is the iteration."""
    early, late = (replace(cold, tolerance=eps).outer_iterations[0] for eps in (1e-6, 1e-10))
    np.testing.assert_allclose(late - early, best(CAR).predicted(1e-4), rtol=0.2)
    run = two_level().run(near(CAR, 1e-3), tolerance=1e-9)
    drop = 1e-9 / run.residuals[0, 0]
    np.testing.assert_allclose(run.outer_iterations[0], best(CAR).predicted(drop), rtol=0.2)


CONVEX = {"lq": plants.lq(N=4, state_weight=10.0), "least effort": plants.double_integrator(N=4)}


@pytest.mark.parametrize("problem", CONVEX.values(), ids=CONVEX)
def test_convex_problems(problem):
    run = two_level(problem).run(tolerance=1e-9)
    assert run.settled.all()
    assert_ipopts_optimum(problem, closed_chain(problem).network, run.states[0])


def test_a_convex_problem_needs_no_rho():
    problem = plants.lq(N=4)
    found = closed_chain(problem)
    plain = apply_gains(found.network, hand_gains(found.network))
    gains = UpperMap(network=plain, settled=found.state).best()
    upper = Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta)
    run = TwoLevelLayer(plain, upper=upper).run(tolerance=1e-5)
    assert run.settled.all()
    proof = certificate_of(problem, plain, run.states[0])
    np.testing.assert_allclose(proof.objective, ipopt(problem).objective, rtol=1e-4)
    assert proof.kkt_residual < 1e-4


def test_the_plain_car_is_repelled():
    """rho = 0: along the worst eigenvector of S the error grows by |1 + lambda s| an iteration."""
    found, gain, count = closed_chain(CAR), 0.03, 60
    plain = apply_gains(found.network, hand_gains(found.network))
    values, vectors = np.linalg.eig(UpperMap(network=plain, settled=found.state).schur.T)
    worst = values.real.argmax()
    left = vectors[:, worst]
    start = found.state.copy()
    start[plain.of_population(*COORDINATION)] += 1e-5 * left.real
    layer = TwoLevelLayer(plain, upper=Gradient(lambda_t=gain, lambda_beta=gain))
    run = layer.run(start, tolerance=1e-9, limit=count)
    assert run.outer_iterations.tolist() == [-1]
    before, after = (coordination(plain, x - found.state) for x in (start, run.states[0]))
    growth = abs(1 + gain * values[worst]) ** count
    assert growth > 1.4
    np.testing.assert_allclose(abs(left @ after) / abs(left @ before), growth, rtol=0.01)


# ---- the lower level ---------------------------------------------------------------------------


def test_steps_and_equations_give_the_same_lower_level():
    """One sample starts cold, the other settles."""
    x = np.stack([closed_chain(CAR).network.start_state, near(CAR, 1e-3)])
    closed, iterated = (
        two_level(lower=lower).run(x, tolerance=1e-3, limit=15)
        for lower in (Closed(), Iterated(tolerance=1e-8))
    )
    assert 3 < closed.outer_iterations[1] < 15
    np.testing.assert_allclose(iterated.outer_iterations, closed.outer_iterations, atol=1)
    np.testing.assert_allclose(iterated.states, closed.states, atol=1e-6)
    assert iterated.inner.min() > 10 * closed.inner.max()


@pytest.mark.parametrize("lower", [Closed(), Iterated()], ids=["closed", "iterated"])
def test_the_lower_level_leaves_its_coordinator_alone(lower):
    network = closed_chain(CAR).network
    layer = two_level(lower=lower)
    start = near(CAR, 0.01)
    run = layer.run(start, limit=0)
    np.testing.assert_array_equal(*(coordination(network, x) for x in (run.states[0], start)))
    flow = layer.cell.flow()
    drives = flow.read(layer.cell.fill(torch.as_tensor(run.states), flow.inputs)).drives
    assert drives[layer.levels.lower].abs().max() < lower.tolerance
    assert drives[layer.levels.t].abs().max() > 1e-3


def test_neurons_that_are_left_out_stay_out():
    """S11: cell 0 has neither u nor mu, and its q alone is solved for."""
    network = synthesize(decompose(CAR, replace(NEURON, printed_ranges=True)))
    upper = Gradient(lambda_t=0.1, lambda_beta=0.1)
    start = network.start_state + 0.01
    closed, iterated = (
        TwoLevelLayer(network, upper=upper, lower=lower).run(start, limit=0).states
        for lower in (Closed(), Iterated())
    )
    np.testing.assert_allclose(closed, iterated, atol=1e-6)
    assert np.abs(closed - start).max() > 0.01


def test_one_call_is_one_outer_iteration():
    layer, count = two_level(), 3
    x = torch.as_tensor(closed_chain(CAR).network.start_state)[None]
    run = layer.run(x, limit=count)
    with torch.no_grad():
        for _ in range(count):
            x = layer(x)
    network = closed_chain(CAR).network
    np.testing.assert_array_equal(*(coordination(network, np.asarray(y)) for y in (x, run.states)))


@pytest.mark.parametrize("lower", [Closed(), Iterated()], ids=["closed", "iterated"])
def test_a_given_start_leaves_stage_0_too_many_equations(lower):
    says = r"q\.x, q\.y, q\.phi, q\.varphi of cell 0 is pinned.*Form\(start_is_neuron=True\)"
    with pytest.raises(NetworkError, match=says):
        TwoLevelLayer(
            designed("car").network, upper=Gradient(lambda_t=0.1, lambda_beta=0.1), lower=lower
        )


def test_a_network_without_a_problem_has_no_levels():
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="t")),
        connections=(Connection(source="x", target="x", weight=-1.0),),
    )
    network = Network(cell=cell, stages=2, title="by hand")
    for upper in (Gradient(lambda_t=0.1, lambda_beta=0.1), NewtonCoordinator()):
        with pytest.raises(NetworkError, match="by hand has no q, u, mu, beta;"):
            TwoLevelLayer(network, upper=upper)


# ---- Newton ------------------------------------------------------------------------------------

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
    run = TwoLevelLayer(network, upper=NewtonCoordinator()).run()
    assert 0 < run.outer_iterations[0] <= 10
    assert np.isnan(run.gains).all()
    assert_ipopts_optimum(CAR, network, run.states[0])


@CLOSINGS
def test_newton_follows_a_start_that_moves(found):
    """ "Convergence after the third iteration" is honest only so."""
    shares = np.array([0.01, 0.05, 0.2])
    run = TwoLevelLayer(found().network, upper=NewtonCoordinator()).run(
        found().state, moved(shares)
    )
    assert run.settled.all()
    assert (run.outer_iterations <= [2, 3, 4]).all()
    for share, x in zip(shares, run.states):
        problem = plants.car(q_0=tuple(share * np.array(CAR.q_d)))
        network = found().network.with_inputs({k: v[0] for k, v in moved([share]).items()})
        assert_ipopts_optimum(problem, network, x)


@pytest.mark.parametrize("problem", CONVEX.values(), ids=CONVEX)
def test_newton_needs_one_iteration_where_all_is_linear(problem):
    """Without a slew to shorten it."""
    layer = TwoLevelLayer(synthesize(problem), upper=NewtonCoordinator(slew=1e6))
    run = layer.run(tolerance=1e-9)
    assert run.outer_iterations.tolist() == [1]
    assert_ipopts_optimum(problem, layer.cell.network, run.states[0])


def test_a_newton_step_is_shortened_to_the_slew():
    network = synthesize(CAR)
    chain = network.of_population("q", "t")
    duals = network.of_population("mu", "beta")
    x = torch.as_tensor(np.where(duals, 100.0, network.start_state))[None]
    whole, short = (
        (TwoLevelLayer(network, upper=NewtonCoordinator(slew=slew))(x) - x).detach().numpy()[0]
        for slew in (1e6, 0.1)
    )
    assert np.abs(whole).max() > np.abs(whole[chain]).max() > 0.1  # duals may move further
    np.testing.assert_allclose(np.abs(short[chain]).max(), 0.1)
    np.testing.assert_allclose(short, whole * 0.1 / np.abs(whole[chain]).max(), rtol=1e-9)


# ---- Theta -------------------------------------------------------------------------------------


def oracle_run(share: float, limit: int) -> TwoLevelRun:
    settled = closed_chain(CAR).state
    return two_level(upper=Oracle(settled=settled, share=share)).run(settled=settled, limit=limit)


@pytest.mark.parametrize("share", [0.3, 0.5, 1.0])
def test_theta_changes_as_A_and_B_say(share):
    """A lambda^2 + B lambda with lambda = share |B/A|, since the lower level moves no t or beta."""
    run = oracle_run(share, 5 if share == 1.0 else 30)
    theta, A, B = (part[:, 0] for part in run.lyapunov)
    gain = run.gains[:, 0, 0]
    np.testing.assert_array_equal(run.gains[:, 1, 0], gain)
    np.testing.assert_allclose(gain, share * np.abs(B / A)[:-1], rtol=1e-12)
    change = A[:-1] * gain**2 + B[:-1] * gain
    np.testing.assert_allclose(np.diff(theta), change, rtol=1e-6, atol=1e-9 * theta.max())
    expected = np.where(B < 0, share**2 - share, share**2 + share)[:-1] * (B**2 / A)[:-1]
    np.testing.assert_allclose(np.diff(theta), expected, rtol=1e-6, atol=1e-9 * theta.max())


def test_half_the_bound_lowers_theta_and_all_of_it_does_not():
    half, whole = oracle_run(0.5, 30).lyapunov, oracle_run(1.0, 1).lyapunov
    falls = half.B[:-1, 0] < 0
    assert falls.sum() > 10
    assert (np.diff(half.theta[:, 0])[falls] < 0).all()
    assert whole.B[0, 0] < 0
    np.testing.assert_allclose(whole.theta[1], whole.theta[0], rtol=1e-12)


def test_the_oracle_is_the_one_of_the_ode():
    settled = closed_chain(CAR).state
    run = oracle_run(1.0, 0)  # the lower level alone
    found = OracleGain(network=closed_chain(CAR).network, settled=settled)(run.states[0])
    np.testing.assert_allclose(np.abs(run.lyapunov.bound), [[found]], rtol=1e-9)


def test_the_oracle_has_a_largest_gain():
    settled = closed_chain(CAR).state
    upper = Oracle(settled=settled, share=1.0, high=1e-3)
    run = two_level(upper=upper).run(near(CAR, 0.1), limit=2)
    np.testing.assert_array_equal(run.gains, 1e-3)


def test_theta_ends_at_zero(cold):
    theta = cold.lyapunov.theta
    assert theta.shape == cold.residuals.shape
    assert theta[-1] < 1e-10 * theta[0]
    assert two_level().run(limit=1).lyapunov is None


# ---- as printed --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_the_printed_lower_level_says_what_the_coordinator_says(seed):
    """(30): q_k = t_{k-1} and mu_k = -beta_{k+1} leave t and beta nothing to do, anywhere."""
    network = synthesize(decompose(CAR, replace(NEURON, closed_lower_level=True)))
    start = network.start_state
    if seed is not None:
        start = start + 0.1 * np.random.default_rng(seed).standard_normal(len(start))
    layer = TwoLevelLayer(network, upper=Gradient(lambda_t=0.3, lambda_beta=0.6))
    run = layer.run(start, limit=5)
    assert run.outer_iterations.tolist() == [0]  # the network is content
    ended = run.states[0]
    np.testing.assert_array_equal(*(coordination(network, x) for x in (ended, start)))
    flow = layer.cell.flow()
    drives = flow.read(layer.cell.fill(torch.as_tensor(run.states), flow.inputs)).drives
    for rows in (layer.levels.t, layer.levels.beta):
        np.testing.assert_allclose(drives[rows], 0.0, atol=1e-14)
    once_more = layer(torch.as_tensor(run.states)).detach().numpy()[0]
    np.testing.assert_allclose(once_more, ended, atol=1e-14)
    assert not certificate_of(CAR, network, ended).certified


def test_the_printed_iteration_does_not_settle():
    network = synthesize(decompose(CAR, replace(PRINTED, start_is_neuron=True)))
    network = apply_gains(network, closed_chain(CAR).gains)
    run = two_level(CAR).run(limit=15)
    layer = TwoLevelLayer(network, upper=gradient(CAR), lower=Iterated(limit=100))
    printed = layer.run(limit=15)
    assert printed.outer_iterations.tolist() == [-1]
    assert printed.residuals[-1] > 100 * run.residuals[-1]
    with np.errstate(all="ignore"):  # its numbers overflow
        assert not certificate_of(CAR, network, printed.states[0]).certified


# ---- batches -----------------------------------------------------------------------------------

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


@pytest.mark.parametrize("lower", [Closed(), Iterated(limit=400)], ids=["closed", "iterated"])
def test_a_lost_sample_costs_no_inner_steps(lower):
    layer, x = two_level(lower=lower), near(CAR, 1e-3)
    lost, sound = ({"q_0.x": np.array(values)} for values in ([0.0, np.nan], [0.0]))
    run, clean = (layer.run(x, inputs, limit=1) for inputs in (lost, sound))
    np.testing.assert_allclose(run.states[0], clean.states[0], atol=1e-6)
    np.testing.assert_array_equal(run.inner, clean.inner)


# ---- counting ----------------------------------------------------------------------------------


def counted(residuals, tolerance=1e-6) -> np.ndarray:
    residuals = np.array(residuals, float)
    count = len(residuals) - 1
    return TwoLevelRun(
        states=np.zeros((residuals.shape[1], 1)),
        residuals=residuals,
        gains=np.full((count, 2, residuals.shape[1]), np.nan),
        inner=np.zeros(count + 1, int),
        lyapunov=None,
        tolerance=tolerance,
    ).outer_iterations


def test_outer_iterations_are_a_last_exit():
    dip, rise, still, lost = [1, 1e-9, 1, 1e-9], [1e-9, 1e-9, 1, 1], [1e-9] * 4, [1, np.nan, 1, 1]
    found = counted(np.transpose([dip, rise, still, lost, [1, np.inf, 1e-9, 1e-9]]))
    assert found.tolist() == [3, -1, 0, -1, 2]


@given(
    arrays(float, st.tuples(st.integers(1, 8), st.integers(1, 3)), elements=st.floats(0, 1)),
    st.floats(0.01, 0.99),
)
def test_residuals_stay_below_the_tolerance_from_then_on(residuals, tolerance):
    for count, history in zip(counted(residuals, tolerance), residuals.T):
        below = history < tolerance
        if count < 0:
            assert not below[-1]
        else:
            assert below[count:].all()
            assert count == 0 or not below[count - 1]


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (lambda: Gradient(lambda_t=-1.0, lambda_beta=1.0), "lambda_t"),
        (lambda: Gradient(lambda_t=1.0, lambda_beta=np.nan), "lambda_beta"),
        (lambda: NewtonCoordinator(slew=0.0), "slew"),
        (lambda: Oracle(settled=np.zeros(1), share=np.inf), "share"),
        (lambda: Iterated(limit=0), "limit"),
        (lambda: Closed(tolerance=-1e-9), "tolerance"),
    ],
)
def test_a_number_out_of_range_is_named(build, name):
    with pytest.raises(NetworkError, match=name):
        build()
