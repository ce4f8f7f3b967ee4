"""Limits of steps follow the gains that a layer has now, trained or loaded."""

import numpy as np
import pytest
import torch
from designs import coordinated, designed, small

import ann_dc
from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.step_rules import FixedStep, lengths_of

NETWORKS = {
    "time constants": lambda: small("car"),
    "a pyramid": lambda: coordinated("car"),
    "a grid": lambda: designed("car").network,
}


def limits(cell: CellLayer):
    flow = cell.flow()
    return flow.limits.of(flow.constants)


@pytest.mark.parametrize("name", NETWORKS)
def test_trained_gains_count_as_those_of_the_trained_network(name):
    layer = RecurrentLayer(NETWORKS[name](), trainable=True)
    before = limits(layer.cell).fastest_rate
    with torch.no_grad():
        layer.cell.log_gain.rows -= np.log(5.0)
    trained = RecurrentLayer(layer.cell.trained())
    assert limits(layer.cell).fastest_rate == pytest.approx(limits(trained.cell).fastest_rate)
    assert limits(layer.cell).fastest_rate > 1.5 * before
    there, here = (limits(one.cell).dual for one in (trained, layer))
    assert here == pytest.approx(there, rel=1e-12)
    assert limits(layer.cell).stable == pytest.approx(limits(trained.cell).stable, rel=1e-9)


def test_loaded_gains_count():
    """Those of slow duals, in a layer of fast ones."""
    network = small("car")
    slow = ann_dc.apply_gains(
        network, ann_dc.manual_gains(network, rho={"mu": 0.1}, tau={"mu": 0.2})
    )
    layer = CellLayer(network)
    first = limits(layer)
    layer.load_state_dict(CellLayer(slow).state_dict())
    assert limits(layer).fastest_rate == pytest.approx(limits(CellLayer(slow)).fastest_rate)
    layer.load_state_dict(CellLayer(network).state_dict())
    assert limits(layer) is first


def test_the_same_gains_are_looked_at_once():
    layer = CellLayer(small("car"), trainable=True)
    with torch.no_grad():
        layer.log_gain.rows += 0.3
    assert limits(layer) is limits(layer)


def test_a_fixed_step_above_the_limit_of_trained_gains_is_told():
    network = small("double_integrator")
    layer = CellLayer(network, trainable=True)
    rule = FixedStep(step=0.9 * stability_limit(network, network.start_state))
    lengths_of(rule, limits(layer))
    with torch.no_grad():
        for name in layer.tau.names:
            layer.log_gain[f"tau.{name}"].fill_(-np.log(3.0))
    with pytest.warns(UserWarning, match="above the stability limit"):
        lengths_of(rule, limits(layer))
