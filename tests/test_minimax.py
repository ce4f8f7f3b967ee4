"""Several objectives, of which the largest is minimised: against IPOPT's epigraph form."""

import numpy as np
import pytest
from minimax import CASES, car, epigraph, small

import ann_dc
from ann_dc.errors import DesignError, FormError, NetworkError, ProblemError
from ann_dc.evaluation import kkt_point
from ann_dc.optimality import ipopt_point
from ann_dc.two_level import coordinate


@pytest.mark.parametrize("name", CASES)
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
    with pytest.raises(DesignError, match="kinds: a grid or a tree"):
        ann_dc.design(problem, kinds=[ann_dc.Kind.GRID])
    with pytest.raises(ProblemError, match="objectives: cart has effort, error"):
        ipopt_point(problem)
    network = ann_dc.synthesize(problem)
    with pytest.raises(NetworkError, match="shared by all cells"):
        ann_dc.RecurrentBackend(order=ann_dc.STAGE_BY_STAGE).run(network)
    with pytest.raises(
        NetworkError, match=r"J\.effort.* shared by all cells is not built at level ota-c"
    ):
        ann_dc.SpiceBackend(level=ann_dc.levels.ota_c()).run(network)


def test_two_levels_know_of_no_objectives():
    with pytest.raises(ProblemError, match="two levels: cart has the objectives effort, error"):
        coordinate(small())
