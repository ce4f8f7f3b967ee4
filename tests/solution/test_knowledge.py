"""What is asked of a problem at a state of its network."""

from dataclasses import replace

import numpy as np
import pytest

import ann_dc
from ann_dc.optimality.existence import Hopeless, Prospect
from ann_dc.solution.knowledge import knowledge_of, path_of

CART = ann_dc.plants.double_integrator(N=5)


@pytest.mark.parametrize("bounds", [{}, {"v": (None, 9), "a": (-99, None)}], ids=str)
def test_a_path_has_its_end_whatever_neurons_there_are(bounds):
    problem = replace(CART, bounds=bounds)
    start = ann_dc.interpolated_guess(problem)
    network = ann_dc.synthesize(problem)
    q, u = path_of(network, network.start_state)
    np.testing.assert_allclose(q, start.q)
    np.testing.assert_allclose(u, start.u)
    knowledge_of(Prospect(problem=problem), network).doubt(network.start_state)


def test_a_target_out_of_reach_stays_so_with_bounds():
    problem = replace(CART, horizon=1, bounds={"a": (-99, 99)})
    network = ann_dc.synthesize(problem)
    with pytest.raises(Hopeless, match=r"no controls reach q_d\.x = 1"):
        knowledge_of(Prospect(problem=problem), network).doubt(network.start_state)
