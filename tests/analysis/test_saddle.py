"""The saddle problem of a large network, by sparse factors, against dense algebra."""

import numpy as np
import pytest
from designs import designed

from ann_dc.analysis.saddle import saddle_of


@pytest.fixture
def sparse(monkeypatch):
    """From here on every network is a large one."""
    return lambda: monkeypatch.setattr("ann_dc.analysis.saddle.DENSE_LIMIT", 10)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["car", "van_der_pol", "unicycle"])
def test_a_minimum_is_told_from_a_saddle_by_factors_too(name, sparse):
    """At the optimum, and at states around it, of which some are minima and some are not."""
    found = designed(name)
    rng = np.random.default_rng(0)
    sizes = 10 ** rng.uniform(-3, 0, 20)
    derivatives = [size * rng.standard_normal(found.network.size) for size in sizes]
    saddles = [
        saddle_of(found.network, found.state + derivative) for derivative in (0.0, *derivatives)
    ]
    dense = [saddle.is_minimum for saddle in saddles]
    assert dense[0]
    assert 1 < sum(dense) < len(dense)
    sparse()
    assert [saddle.is_minimum for saddle in saddles] == dense


@pytest.mark.parametrize("name", ["car", "van_der_pol"])
def test_both_ends_of_the_shadow_stiffness_by_iterations(name, sparse):
    found = designed(name)
    saddle = saddle_of(found.network, found.state)
    weights = np.random.default_rng(0).uniform(0.5, 2.0, len(saddle.dual))
    dense = saddle.sensitivity_range(weights)
    sparse()
    np.testing.assert_allclose(saddle.sensitivity_range(weights), dense, rtol=1e-3)
