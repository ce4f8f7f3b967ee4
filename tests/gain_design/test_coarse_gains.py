"""Gains of coarse coordinators against their definition, with every hat and A and H written out."""

import tracemalloc

import numpy as np
import pytest
from designs import small

from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation
from ann_dc.analysis.saddle import saddle_of
from ann_dc.gain_design.coarse_gains import pyramid
from ann_dc.problem import plants
from ann_dc.solver import synthesize


def definition(network, x, rho, level: int) -> np.ndarray:
    """hat' (H + A'WA) hat (points, C, C), H of the cost alone."""
    dual = [network.neuron_index[d.neuron] for d in network.cell.duals]
    still = np.where(np.isin(network.places[:, 0], dual), 0.0, x)
    saddle = saddle_of(network, still)
    neuron, stage = network.places.T
    W = np.diag(rho[neuron[saddle.dual]])
    G = saddle.H.toarray() + saddle.A.toarray().T @ W @ saddle.A.toarray()
    grid = np.linspace(0, 2 * network.stages - 1, (1 << level) + 1)
    found = np.zeros((len(grid), len(network.chain_rows), len(network.chain_rows)))
    for point in range(len(grid)):
        height = np.interp(np.arange(2 * network.stages), grid, np.eye(len(grid))[point])
        hats = np.zeros((len(saddle.primal), len(network.chain_rows)))
        for chain, rows in enumerate(network.chain_rows):
            for half, row in enumerate(rows):
                own = neuron[saddle.primal] == row
                hats[own, chain] = height[2 * stage[saddle.primal][own] + half]
        found[point] = hats.T @ G @ hats
    return found


@pytest.mark.parametrize("name", ["car", "cstr", "lq_unst"])
def test_a_coupled_gain_is_gamma_over_the_stiffness_under_its_hat(name):
    network = small(name)
    rng = np.random.default_rng(0)
    x = network.start_state + 0.1 * rng.standard_normal(network.size)
    linear = Linearisation(network).at(x)
    rho = np.where(linear.dual, rng.uniform(0.5, 2.0, len(linear.dual)), 0.0)
    found = pyramid(linear, rho, 0.5, coupled=True)
    assert [len(gain) for gain in found.gains] == [5, 3]
    for level, gain in zip((2, 1), found.gains):
        G = definition(network, x, rho, level)
        for a in range(1, len(G) - 1):
            if np.linalg.eigvalsh(G[a])[0] > 1e-9 * np.abs(G[a]).max():
                np.testing.assert_allclose(gain[a] @ G[a], 0.5 * np.eye(len(G[a])), atol=1e-8)


def test_a_level_has_the_gain_of_its_stiffest_grid_point():
    network = small("car")
    linear = Linearisation(network).at(network.start_state)
    rho = linear.dual.astype(float)
    found = pyramid(linear, rho, 0.5)
    stiffest = np.einsum("aii->ai", definition(network, network.start_state, rho, 2))[1:-1].max(0)
    np.testing.assert_allclose(np.diag(found.gains[0][1]), 0.5 / stiffest, rtol=1e-10)
    twice = pyramid(MeanLinearisation([linear, linear]), rho, 0.5)
    assert all(np.array_equal(one, two) for one, two in zip(found.gains, twice.gains))


def test_hats_take_memory_in_proportion_to_the_row():
    """Tables of all grid points by all stages would take four times as much."""
    peak = []
    for stages in (500, 1000):
        network = synthesize(plants.double_integrator(N=stages, dt=2.0 / stages))
        linear = Linearisation(network).at(network.start_state)
        tracemalloc.start()
        pyramid(linear, linear.dual.astype(float), 0.5)
        peak.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peak[1] < 2.4 * peak[0]
