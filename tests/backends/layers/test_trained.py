"""Gains that learn: positive, one factor each, and written back into a network."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from cell_layers import assert_close, with_factors
from designs import coordinated, near_start, small
from hypothesis import given, settings, strategies as st

from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.step_rules import FixedStep
from ann_dc.evaluation.reference import evaluator


@settings(max_examples=25, deadline=None)
@given(theta=st.floats(-100, 100))
def test_gains_are_positive_whatever_the_parameters(theta):
    network = coordinated("double_integrator")
    layer = CellLayer(network, trainable=True)
    torch.nn.init.constant_(layer.log_gain.rows, theta)
    weights, rates, grids = (tensor.detach() for tensor in layer.constants())
    factor = np.exp(theta)
    assert_close(rates[:, :, 0], evaluator(network).tape.rates / factor)
    assert_close(grids, evaluator(network).tape.grids * factor)
    for connection, row in evaluator(network).edges.items():
        trained = connection in [f"{d.multiplier}<-{d.residual}" for d in network.cell.duals]
        expected = evaluator(network).tape.weights[row] * (factor if trained else 1.0)
        assert_close(weights[row, :, 0], expected)
        assert not trained or (expected > 0).all()


def test_one_factor_one_gain():
    """Doubling what the logarithm says of one tau halves the moves of that neuron alone."""
    network = small("double_integrator")
    layer, x = CellLayer(network, trainable=True), near_start(network, 9)
    with torch.no_grad():
        layer.log_gain["tau.mu.v"].copy_(torch.tensor(np.log(2.0)))
    derivatives = layer(torch.as_tensor(x)[None], step=1.0)[0].detach().numpy() - x
    ours = network.places[:, 0] == network.neuron_index["mu.v"]
    assert_close(derivatives, np.where(ours, 0.5, 1.0) * evaluator(network).rhs(x), 1e-10)


@pytest.mark.parametrize("wired", [small, coordinated])
@pytest.mark.parametrize("seed", [None, 10])
def test_the_trained_network_moves_as_the_layer(wired, seed):
    network = wired("car")
    layer = CellLayer(network, trainable=True) if seed is None else with_factors(network, seed)
    trained, x = layer.trained(), near_start(network, 10, count=3)
    flow = layer.flow()
    state = layer.fill(torch.as_tensor(x), flow.inputs)
    drives = flow.read(state).drives
    assert_close(evaluator(trained).rhs(x), layer.pack(flow.derivative(drives, state)).detach())
    if seed is None:
        assert_close(evaluator(trained).rhs(x), evaluator(network).rhs(x))
        assert_close(evaluator(trained).jacobian(x[0]), evaluator(network).jacobian(x[0]))
    else:
        assert np.abs(evaluator(trained).rhs(x) - evaluator(network).rhs(x)).max() > 1e-3


def test_trained_keeps_penalties_of_every_stage():
    network = small("double_integrator")
    paths = [f"{dual.multiplier}<-{dual.residual}" for dual in network.cell.duals]
    connections = tuple(
        replace(c, weight=c.weight * np.arange(1.0, 5.0)) if c.name in paths else c
        for c in network.cell.connections
    )
    network = replace(network, cell=replace(network.cell, connections=connections))
    x = near_start(network, 10)
    assert_close(
        evaluator(CellLayer(network, trainable=True).trained()).rhs(x), evaluator(network).rhs(x)
    )


def test_a_layer_without_trainable_gains_has_nothing_to_train():
    assert list(CellLayer(small("car")).parameters()) == []


def test_training_lowers_the_residual():
    network = coordinated("double_integrator")
    layer = RecurrentLayer(network, step=FixedStep(step=0.4), trainable=True)

    def loss() -> torch.Tensor:
        flow = layer.cell.flow()
        state = layer.cell.fill(layer(steps=10), flow.inputs)
        return flow.residuals(state, flow.read(state).drives).square().sum()

    optimiser = torch.optim.Adam(layer.parameters(), lr=0.05)
    losses = []
    for _ in range(8):
        optimiser.zero_grad()
        losses.append(loss())
        losses[-1].backward()
        optimiser.step()
    assert loss() < 0.9 * losses[0]
