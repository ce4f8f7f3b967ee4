"""Networks of points: gains multiplied, starts and defects drawn by the point's seed."""

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import StudyError
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.study.realisation import network_at, started, with_gains


@pytest.fixture(scope="module")
def network():
    problem = ann_dc.plants.double_integrator(N=5)
    return ann_dc.design(problem, preconditioner=PreconditionerKind.MULTILEVEL).network


def test_nothing_set_is_the_network_itself(network):
    assert network_at(network, {}, 1) is network


def test_penalties_are_multiplied_where_their_paths_are(network):
    double = with_gains(network, {"rho": 2.0, "rho.mu.x": 3.0})
    problem = ann_dc.plants.double_integrator(N=5)
    gains = ann_dc.design(problem, preconditioner=PreconditionerKind.MULTILEVEL).gains
    rho = gains.rho.copy()
    for dual in network.cell.duals:
        rho[network.neuron_index[dual.neuron]] *= 6.0 if dual.neuron == "mu.x" else 2.0
    by_gains = ann_dc.apply_gains(
        ann_dc.synthesize(problem),
        ann_dc.Gains(rho=rho, rate=gains.rate, preconditioner=gains.preconditioner),
    )
    x = np.linspace(-1, 1, network.size)
    ours, theirs = (ann_dc.evaluator(n).rhs(x) for n in (double, by_gains))
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)


def test_time_constants_by_population_and_by_neuron(network):
    slow = with_gains(network, {"tau": 2.0, "tau.u": 3.0, "tau.mu.x": 5.0})
    for name, factor in (("u.a", 6.0), ("mu.x", 10.0), ("q.x", 2.0), ("mu.v", 2.0)):
        np.testing.assert_allclose(
            slow.neuron(name).tau, factor * np.asarray(network.neuron(name).tau)
        )


def test_coordinators_are_multiplied(network):
    twice = with_gains(network, {"coarse": 2.0})
    for ours, theirs in zip(twice.preconditioner.gains, network.preconditioner.gains):
        np.testing.assert_array_equal(ours, 2 * theirs)
    alone = ann_dc.design(
        ann_dc.plants.double_integrator(N=5), preconditioner=PreconditionerKind.DIAGONAL
    ).network
    with pytest.raises(StudyError, match="no coarse levels"):
        with_gains(alone, {"coarse": 2.0})


@pytest.mark.parametrize("factor", [0.0, -1.0, float("inf")])
def test_factors_are_positive(network, factor):
    with pytest.raises(StudyError, match=r"gains\.rho: a factor is a positive number"):
        with_gains(network, {"rho": factor})


def test_starts(network):
    line = network.start_state
    assert (started(line, {"kind": "line"}, 1) == line).all()
    assert (started(line, {"kind": "zero"}, 1) == 0).all()
    near, far = (started(line, {"spread": spread}, 1) - line for spread in (0.1, 0.2))
    np.testing.assert_allclose(far, 2 * near)
    assert not np.array_equal(near, started(line, {"spread": 0.1}, 2) - line)


def test_draws_of_one_defect_do_not_move_another(network):
    weights = {"nonideal.mismatch": 0.01}
    both = network_at(network, weights | {"nonideal.time_constants": 0.01}, 7)
    one = network_at(network, weights, 7)
    for ours, theirs in zip(both.cell.connections, one.cell.connections):
        np.testing.assert_array_equal(ours.weight, theirs.weight)
    other = network_at(network, weights, 8)
    assert any(
        not np.array_equal(a.weight, b.weight)
        for a, b in zip(one.cell.connections, other.cell.connections)
    )


def test_inputs_move_the_start_with_the_ends(network):
    moved = network_at(network, {"input.q_d.x": 3.0}, 1)
    family = ann_dc.synthesize(ann_dc.plants.double_integrator(N=5, q_d=(3.0, 0.0)))
    shift = moved.user_units(moved.start_state) - network.user_units(network.start_state)
    assert moved.inputs["q_d.x"][0] == 3.0
    assert np.abs(shift).max() > 0.5
    assert family.size == moved.size
