"""What a state says about the problem: populations in its units, multipliers as they work."""

import numpy as np
import pytest
from designs import designed

from ann_dc.evaluation.populations import kkt_point, neuron_values


@pytest.mark.parametrize("name", ["double_integrator", "car"])
def test_where_a_network_has_settled_its_duals_are_its_multipliers(name):
    """m = mu + rho c, and c = 0."""
    network, x = designed(name).network, designed(name).state
    values = neuron_values(network, x)
    for population, found in zip(("q", "u", "t", "mu", "beta"), kkt_point(network, x)):
        wanted = values[population].T
        np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())


def test_elsewhere_a_multiplier_is_moved_by_its_residual():
    network = designed("car").network
    values = neuron_values(network, network.start_state)
    q, _, _, mu, _ = kkt_point(network, network.start_state)
    np.testing.assert_array_equal(q, values["q"].T)
    assert np.abs(mu - values["mu"].T).max() > 0
