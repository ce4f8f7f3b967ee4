"""Many chips drawn at once: the same numbers as their networks have, bit for bit."""

import numpy as np
import pytest
from designs import coordinated, wired_with

from ann_dc.backends.ode import BATCHES, OdeBackend
from ann_dc.errors import NetworkError
from ann_dc.evaluation.variant_numbers import numbers_of
from ann_dc.hardware.nonidealities.numbers import detuned, drawn_numbers, mismatch
from ann_dc.network.preconditioners.base import PreconditionerKind

SEEDS = (0, 7, 2**40)


@pytest.mark.parametrize("sizes", [(0.01, 0.02), (0.0, 0.01), (0.01, 0.0)])
def test_they_are_those_of_the_networks(sizes):
    weights, tau = sizes
    network = coordinated("car")
    drawn = drawn_numbers(network, SEEDS, weights=weights, time_constants=tau)
    each = [mismatch(detuned(network, tau, seed=s), weights, seed=s) for s in SEEDS]
    expected = numbers_of(each)
    np.testing.assert_array_equal(drawn.weights, expected.weights)
    np.testing.assert_array_equal(drawn.rates, expected.rates)


def test_a_batch_of_them_settles_as_the_networks_do():
    network = wired_with("double_integrator", PreconditionerKind.DIAGONAL)
    numbers = drawn_numbers(network, SEEDS, weights=0.01, time_constants=0.01)
    backend = OdeBackend(method=BATCHES.tighter(1000.0), verify=False)
    batch = backend.run_batch(network, {}, numbers=numbers)
    for sample, seed in enumerate(SEEDS):
        own = mismatch(detuned(network, 0.01, seed=seed), 0.01, seed=seed)
        alone = backend.run(own)
        assert batch.settled[sample]
        assert alone.status.settled
        assert batch.settling_times[sample] == pytest.approx(alone.settling_time, rel=2e-3)


def test_weights_and_time_constants_of_one_seed_do_not_depend_on_each_other():
    network = coordinated("car")
    numbers = drawn_numbers(network, range(20), weights=0.01, time_constants=0.01)
    own = numbers_of([network])
    live = own.rates[0] > 0
    e = (numbers.weights / np.where(own.weights, own.weights, 1) - 1).reshape(20, -1)
    f = (own.rates[:, live] / numbers.rates[:, live] - 1).reshape(20, -1)
    assert e.std() == pytest.approx(0.01, rel=0.1)
    assert f.std() == pytest.approx(0.01, rel=0.1)
    size = min(e.shape[1], f.shape[1])
    assert abs(np.corrcoef(e[:, :size].ravel(), f[:, :size].ravel())[0, 1]) < 0.1


@pytest.mark.parametrize("field", ["weights", "time_constants"])
def test_sizes_are_numbers_that_leave_time_constants(field):
    with pytest.raises(NetworkError, match=f"{field}: expected a finite number"):
        drawn_numbers(coordinated("car"), [0], **{field: np.inf})
    with pytest.raises(NetworkError, match="time_constants: errors of 5 leave time constants"):
        drawn_numbers(coordinated("car"), [0], time_constants=5.0)
