"""The lower level: steps and equations give the same stages, and leave the coordinator alone."""

from dataclasses import replace

import numpy as np
import pytest
from closed_chains import CAR, NEURON, closed_chain, coordination, near, two_level
from designs import designed

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import LowerForm
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.lower_level import Closed, Iterated
from ann_dc.two_level.upper_level import Gradient


@pytest.mark.slow
def test_steps_and_equations_give_the_same_lower_level():
    """One sample starts cold, the other settles."""
    x = np.stack([closed_chain(CAR).network.start_state, near(CAR, 1e-3)])
    closed, iterated = (
        two_level(lower=lower).run(x, tolerance=1e-3, limit=60)
        for lower in (Closed(), Iterated(tolerance=1e-8))
    )
    assert 3 < closed.outer_iterations[1] < 60
    np.testing.assert_allclose(iterated.outer_iterations, closed.outer_iterations, atol=1)
    np.testing.assert_allclose(iterated.states, closed.states, atol=1e-6)
    assert (iterated.inner > 10 * closed.inner).all()


@pytest.mark.parametrize("lower", [Closed(), Iterated()], ids=["closed", "iterated"])
def test_the_lower_level_leaves_its_coordinator_alone(lower):
    network = closed_chain(CAR).network
    layer = two_level(lower=lower)
    start = near(CAR, 0.01)
    run = layer.run(start, limit=0)
    np.testing.assert_array_equal(*(coordination(network, x) for x in (run.states[0], start)))
    drives = network.pack(evaluator(network).drives(run.states[0]))
    assert np.abs(drives[network.of_population("q", "u", "mu")]).max() < lower.tolerance
    assert np.abs(drives[network.of_population("t")]).max() > 1e-3


def test_neurons_that_are_left_out_stay_out():
    """S11: cell 0 has neither u nor mu, and its q alone is solved for."""
    network = synthesize(decompose(CAR, replace(NEURON, printed_ranges=True)))
    upper = Gradient(lambda_t=0.1, lambda_beta=0.1)
    start = network.start_state + 0.01
    closed, iterated = (
        TwoLevels(network, upper=upper, lower=lower).run(start, limit=0).states
        for lower in (Closed(), Iterated())
    )
    np.testing.assert_allclose(closed, iterated, atol=1e-6)
    assert np.abs(closed - start).max() > 0.01


@pytest.mark.parametrize("lower", [Closed(), Iterated()], ids=["closed", "iterated"])
def test_a_given_start_leaves_stage_0_too_many_equations(lower):
    says = r"q\.x, q\.y, q\.phi, q\.varphi of cell 0 is fixed.*Form\(start_is_neuron=True\)"
    with pytest.raises(NetworkError, match=says):
        TwoLevels(
            designed("car").network, upper=Gradient(lambda_t=0.1, lambda_beta=0.1), lower=lower
        )


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_the_printed_lower_level_says_what_the_coordinator_says(seed):
    """(30): q_k = t_{k-1} and mu_k = -beta_{k+1} leave t and beta nothing to do, anywhere."""
    network = synthesize(decompose(CAR, replace(NEURON, lower_level=LowerForm.CLOSED)))
    start = network.start_state
    if seed is not None:
        start = start + 0.1 * np.random.default_rng(seed).standard_normal(len(start))
    layer = TwoLevels(network, upper=Gradient(lambda_t=0.3, lambda_beta=0.6))
    run = layer.run(start, limit=5)
    assert run.outer_iterations.tolist() == [0]  # the network is content
    ended = run.states[0]
    np.testing.assert_array_equal(*(coordination(network, x) for x in (ended, start)))
    drives = network.pack(evaluator(network).drives(ended))
    np.testing.assert_allclose(coordination(network, drives), 0.0, atol=1e-14)
    once_more = layer.step(ended)[0]
    np.testing.assert_allclose(once_more, ended, atol=1e-14)
    assert not certificate_of(CAR, network, ended).certified


@pytest.mark.parametrize("lower", [Closed(), Iterated(limit=400)], ids=["closed", "iterated"])
def test_a_lost_sample_costs_no_inner_steps(lower):
    layer, x = two_level(lower=lower), near(CAR, 1e-3)
    lost, sound = ({"q_0.x": np.array(values)} for values in ([0.0, np.nan], [0.0]))
    run, clean = (layer.run(x, inputs, limit=1) for inputs in (lost, sound))
    np.testing.assert_allclose(run.states[0], clean.states[0], atol=1e-6)
    np.testing.assert_array_equal(run.inner, clean.inner)


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (lambda: Iterated(limit=0), "limit"),
        (lambda: Closed(tolerance=-1e-9), "tolerance"),
    ],
)
def test_a_number_out_of_range_is_named(build, name):
    with pytest.raises(NetworkError, match=name):
        build()
