"""Names in a state_dict: those of the network, through files and errors."""

import io
from dataclasses import replace

import numpy as np
import pytest
import torch
from cell_layers import wire
from designs import coordinated, near_start, small

from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.network.cell import Cell, Neuron, Template
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.solver import synthesize
from ann_dc.weights.hashes import wiring_hash


def test_a_state_dict_speaks_the_networks_names():
    network = coordinated("car")
    state = CellLayer(network).state_dict()
    neurons = [neuron.name for neuron in network.cell.neurons]
    expected = [f"weight.{name}" for name in evaluator(network).edges]
    expected += [f"{group}.{name}" for group in ("tau", "start") for name in neurons]
    expected += [f"input.{name}" for name in network.cell.inputs]
    expected += [f"coordinator.level_{j}" for j in range(len(network.preconditioner.gains))]
    assert sorted(state) == sorted([*expected, "_extra_state"])
    assert bytes(state["_extra_state"][0].tolist()).hex() == wiring_hash(network)
    assert {"tau.mu.phi", "start.q.x", "input.q_d.x", "coordinator.level_0"} <= set(state)
    np.testing.assert_array_equal(state["input.q_d.x"], [5.0] * 4)
    np.testing.assert_array_equal(state["coordinator.level_0"], network.preconditioner.gains[0])
    for connection in network.cell.connections:
        weight = np.broadcast_to(connection.weight, 4)
        np.testing.assert_array_equal(state[f"weight.{connection.name}"], weight)


def test_trainable_factors_have_names_too():
    network = coordinated("double_integrator")
    fixed = set(CellLayer(network).state_dict())
    added = set(CellLayer(network, trainable=True).state_dict()) - fixed
    neurons = [neuron.name for neuron in network.cell.neurons]
    duals = [dual.neuron for dual in network.cell.duals]
    levels = [f"level_{j}" for j in range(len(network.preconditioner.gains))]
    assert added == {
        *(f"log_gain.tau.{name}" for name in neurons),
        *(f"log_gain.rho.{name}" for name in duals),
        *(f"log_gain.coordinator.{name}" for name in levels),
    }


def through_a_file(state: dict) -> dict:
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)


@pytest.mark.parametrize("wired", [small, coordinated])
def test_a_state_dict_survives_a_file(wired):
    """Loaded into a layer with other constants, it moves as the one that was saved."""
    network, rng = wired("car"), np.random.default_rng(8)
    saved, loaded = (CellLayer(network, trainable=True) for _ in range(2))
    with torch.no_grad():
        for tensor in (*saved.parameters(), saved.weight.rows, saved.tau.rows, saved.input.rows):
            tensor *= torch.as_tensor(rng.uniform(0.5, 2.0, tensor.shape))
        saved.log_gain.rows += 0.1
        saved.start.rows += 1.0
    x = torch.as_tensor(near_start(network, 8, count=3))
    assert not torch.equal(loaded(x, step=0.1), saved(x, step=0.1))
    loaded.load_state_dict(through_a_file(saved.state_dict()))
    assert torch.equal(loaded(x, step=0.1), saved(x, step=0.1))
    assert torch.equal(loaded.start_vector(), saved.start_vector())


def test_a_state_dict_survives_safetensors():
    theirs = pytest.importorskip("safetensors.torch")
    layer = CellLayer(coordinated("car"), trainable=True)
    state = theirs.load(theirs.save(layer.state_dict()))
    assert all(torch.equal(state[name], held) for name, held in layer.state_dict().items())
    CellLayer(coordinated("car"), trainable=True).load_state_dict(state)


def test_a_saved_layer_is_a_copy():
    layer = CellLayer(small("double_integrator"))
    state = layer.state_dict()
    state["tau.q.x"] *= 7.0
    assert float(layer.tau["q.x"][0]) == 1.0


def test_what_does_not_fit_is_reported():
    layer = CellLayer(small("car"))
    state = layer.state_dict()
    del state["tau.mu.phi"]
    state["weight.nowhere<-nothing"] = torch.zeros(4)
    state["start.q.x"] = torch.zeros(5)
    with pytest.raises(RuntimeError) as error:
        layer.load_state_dict(state)
    message = str(error.value)
    assert '"tau.mu.phi"' in message.partition("Missing key(s)")[2]
    assert '"weight.nowhere<-nothing"' in message.partition("Unexpected key(s)")[2]
    assert "start.q.x: expected the shape (4,), got (5,)" in message


def test_keys_of_another_network_are_told_without_an_error():
    layer, state = CellLayer(small("car")), {"tau.q.z": torch.ones(4)}
    meaning = layer.load_state_dict(state, strict=False)
    assert meaning.unexpected_keys == ["tau.q.z"]
    assert sorted(meaning.missing_keys) == sorted(layer.state_dict())


def test_numbers_of_another_wiring_are_refused():
    """One more wire, or another at the same place, is another wiring: nothing is taken of it."""
    network = small("car")
    wires = network.cell.connections
    moved = replace(wires[0], template=Template.NEXT)
    for others in ((moved, *wires[1:]), wires[::-1]):
        other = replace(network, cell=replace(network.cell, connections=others))
        layer, before = CellLayer(network), CellLayer(network).state_dict()
        state = CellLayer(other).state_dict() | {"tau.q.x": torch.full((4,), 7.0)}
        with pytest.raises(NetworkError, match=r"network with other wiring than 'car'; load them"):
            layer.load_state_dict(state)
        assert all(torch.equal(layer.state_dict()[name], held) for name, held in before.items())


def test_numbers_in_other_units_are_refused():
    """A car with another wheelbase has the same wires, but its turning has another unit."""
    short, long = (synthesize(plants.car(N=4, D=wheelbase)) for wheelbase in (0.5, 1.0))
    assert wiring_hash(short) == wiring_hash(long)
    with pytest.raises(NetworkError, match="other units, limits or stiffness than 'car'"):
        RecurrentLayer(short).load_state_dict(RecurrentLayer(long).state_dict())
    with pytest.raises(NetworkError, match="other wiring"):
        CellLayer(short).set_extra_state("nonsense")


def test_numbers_of_other_gains_and_inputs_are_taken():
    network = small("car")
    gains = manual_gains(network, rho={"mu": 0.3}, tau={"u": 0.2})
    other = apply_gains(network, gains).with_inputs({"q_d.x": 3.0})
    layer = RecurrentLayer(network)
    layer.load_state_dict(through_a_file(RecurrentLayer(other).state_dict()))
    x = torch.as_tensor(near_start(other, 8, count=3))
    assert torch.equal(layer.cell(x, step=0.1), CellLayer(other)(x, step=0.1))


def test_neurons_may_be_called_as_methods_of_torch_are():
    names = ("q.train", "forward", "rows", "q.state_dict")
    cell = Cell(
        neurons=tuple(Neuron(name=name) for name in names),
        connections=tuple(wire(name, name, -1.0) for name in names),
    )
    network = Network(cell=cell, stages=2, start=dict.fromkeys(names, 1.0))
    layer = CellLayer(network, trainable=True)
    layer.load_state_dict(through_a_file(layer.state_dict()))
    np.testing.assert_allclose(
        layer(layer.start_vector(), step=0.25).detach(), np.full((1, 8), 0.75)
    )
