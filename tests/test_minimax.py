"""Several objectives, of which the largest is minimised: against IPOPT's epigraph form."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from minimax import CASES, car, epigraph, small

import ann_dc
from ann_dc.errors import DesignError, FormError, NetworkError, ProblemError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.evaluation.reference import evaluator
from ann_dc.optimality.reference_solvers import ipopt_point
from ann_dc.two_level.coordination import coordinate


@pytest.mark.parametrize(
    "name", [n if n == "two by range" else pytest.param(n, marks=pytest.mark.slow) for n in CASES]
)
def test_shares_are_those_of_ipopt(name):
    objectives, least = CASES[name]
    problem = car(objectives)
    solution, known = ann_dc.solve(problem), epigraph(problem)
    assert solution.certified, solution.certificate
    largest = solution.certificate.largest
    assert known.objective == pytest.approx(least, abs=2e-5)
    np.testing.assert_allclose(largest.shares, known.shares, atol=5e-5)
    assert solution.certificate.objective == pytest.approx(known.objective, abs=1e-6)
    assert largest.shares.sum() == pytest.approx(1.0, abs=1e-7)
    np.testing.assert_allclose(solution["J"][-1], largest.values, atol=1e-6)
    assert solution["E.max"][-1] == pytest.approx(largest.values.max(), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("temperature", [0.3, 0.01])
@pytest.mark.parametrize("name", CASES)
def test_a_temperature_softens_the_largest_within_its_bound(name, temperature):
    hard = car(CASES[name][0])
    problem = replace(hard, temperature=temperature)
    solution, known, least = ann_dc.solve(problem), epigraph(problem), epigraph(hard).objective
    assert solution.certified, solution.certificate
    largest = solution.certificate.largest
    np.testing.assert_allclose(largest.shares, known.shares, atol=5e-5)
    np.testing.assert_allclose(largest.values, known.values, atol=1e-6)
    assert solution.certificate.objective == pytest.approx(known.objective, abs=1e-6)
    assert solution["E.max"][-1] == pytest.approx(largest.level, abs=1e-6)
    bound = temperature * np.log(len(largest.values))
    assert least - 1e-6 < largest.values.max() < least + bound
    assert largest.values.max() < largest.level < largest.values.max() + bound


def test_a_cold_network_is_the_one_of_the_largest_itself():
    """Where it settles, and about as fast: heat is no stiffness."""
    hard = small()
    plain, cold = (ann_dc.design(replace(hard, temperature=t)) for t in (0.0, 1e-3))
    assert cold.spectrum.stiffness_ratio < 3 * plain.spectrum.stiffness_ratio
    one, other = (kkt_point(d.network, d.state)[1] for d in (plain, cold))
    np.testing.assert_allclose(one, other, atol=1e-2 * np.abs(one).max())


@pytest.mark.slow
def test_a_winner_that_takes_all_chatters():
    """Weight one for the largest and none for the other: the temperature zero of shares that only
    follow the objectives. It never comes to rest."""
    problem, first, second = small(), *sp.symbols("first second")
    effort, error = problem.objectives.values()
    given = {first: 0.5, second: 0.5}
    summed = replace(problem, objectives=(), cost=first * effort + second * error, inputs=given)
    designed = ann_dc.design(summed)
    takers = [
        evaluator(designed.network.with_inputs({"first": taken, "second": 1 - taken}))
        for taken in (1.0, 0.0)
    ]
    x, winners, residuals = designed.network.start_state, [], []
    for _ in range(20_000):
        q, u, t, *_ = kkt_point(designed.network, x)
        winners.append(int(np.argmax(problem.objective_values(np.column_stack([q, t[:, -1]]), u))))
        residuals.append(max(takers[winners[-1]].residuals(x)))
        x = x + 0.2 * designed.spectrum.largest_step * takers[winners[-1]].rhs(x)
    late = slice(10_000, None)
    assert np.abs(np.diff(winners[late])).sum() > 100
    assert min(residuals[late]) > 1e-3


def test_an_objective_that_is_not_the_largest_has_no_share():
    problem = small(weights={"effort": 0.99, "error": 0.01})
    solution, known = ann_dc.solve(problem), epigraph(problem)
    assert solution.certified, solution.certificate
    assert known.shares == pytest.approx([1.0, 0.0], abs=1e-6)
    np.testing.assert_allclose(solution.certificate.largest.shares, known.shares, atol=1e-6)


def test_a_common_cost_counts_beside_the_largest():
    v, a = ann_dc.plants.double_integrator(N=2).states[1], small().controls[0]
    problem = small(cost=0.01 * v**2 + 1e-3 * a**2, terminal_cost=0)
    solution, known = ann_dc.solve(problem), epigraph(problem)
    assert solution.certified, solution.certificate
    assert solution.certificate.objective == pytest.approx(known.objective, rel=1e-6)
    np.testing.assert_allclose(solution.certificate.largest.shares, known.shares, atol=5e-5)


def test_objectives_and_inequalities_together():
    problem = small(stages=12, bounds={"v": (None, 1.2), "a": (-9, 9)})
    solution = ann_dc.solve(problem)
    assert solution.certified, solution.certificate
    assert solution.certificate.complementarity.strong > 0


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "backend",
    [
        ann_dc.OdeBackend(method=ann_dc.ode.RK45),
        ann_dc.RecurrentBackend(),
        ann_dc.RecurrentBackend(order=ann_dc.TWO_PHASE),
        ann_dc.RecurrentBackend(acceleration=ann_dc.Anderson()),
    ],
    ids=("scipy", "simultaneous", "two-phase", "accelerated"),
)
def test_backends_agree(backend):
    network = ann_dc.design(small()).network
    mine, other = ann_dc.OdeBackend().run(network), backend.run(network)
    assert other.status.settled, other.status
    for one, two in zip(
        kkt_point(network, mine.trajectory.final), kkt_point(network, other.trajectory.final)
    ):
        np.testing.assert_allclose(two, one, atol=1e-5 * max(np.abs(one).max(initial=0), 1))


def test_weights_are_inputs_of_a_batch():
    problem = small(weights=(0.5, 0.5))
    network, w = ann_dc.design(problem).network, np.linspace(0.2, 0.8, 7)
    batch = ann_dc.OdeBackend().run_batch(network, {"weight_effort": w, "weight_error": 1 - w})
    for share, state in zip(w, batch.states):
        known = epigraph(problem.with_inputs(weight_effort=share, weight_error=1 - share))
        *_, shares = kkt_point(network, state)
        np.testing.assert_allclose(shares, known.shares, atol=5e-5)


def test_what_objectives_exclude_is_refused_by_name():
    problem = small()
    with pytest.raises(FormError, match="effort, error"):
        ann_dc.solve(problem, form=ann_dc.PRINTED)
    with pytest.raises(DesignError, match="preconditioner: a resistive grid or cyclic reduction"):
        ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.RESISTIVE_GRID)
    with pytest.raises(ProblemError, match="objectives: cart has effort, error"):
        ipopt_point(problem)
    network = ann_dc.synthesize(problem)
    with pytest.raises(NetworkError, match="shared by all cells"):
        ann_dc.RecurrentBackend(order=ann_dc.STAGE_BY_STAGE).run(network)
    with pytest.raises(
        NetworkError, match=r"J\.effort.* shared by all cells is not supported at level ota-c"
    ):
        ann_dc.SpiceBackend(level=ann_dc.levels.ota_c()).run(network)


def test_two_levels_know_of_no_objectives():
    with pytest.raises(ProblemError, match="two levels: cart has the objectives effort, error"):
        coordinate(small())
