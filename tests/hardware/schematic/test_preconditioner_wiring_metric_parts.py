"""Own integrators, put through the nodes of a preconditioner, are the neurons that it moves."""

import numpy as np
import pytest
from designs import designed
from preconditioner_networks import BEYOND, PYRAMIDS, with_preconditioner

from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.schematic.elements import Adder, GridNode
from ann_dc.hardware.schematic.preconditioner_wiring import (
    OWN,
    preconditioner_parts,
    preconditioner_values,
    wiring_of,
)
from ann_dc.network.preconditioners.base import PreconditionerKind

every_kind = pytest.mark.parametrize("kind", BEYOND)
PLANTS = ("car", "pendulum", "double_integrator")


def reached(network, wiring) -> np.ndarray:
    """Components of the state vector that own integrators stand for."""
    nodes = [wiring.nodes[i] for i in wiring.moved]
    return np.array([network.state_index[network.neuron_index[name], k] for name, k in nodes])


@pytest.mark.sampled(3)
@every_kind
@pytest.mark.parametrize("name", PLANTS)
def test_the_wires_are_the_preconditioner(name, kind):
    network = with_preconditioner(name, kind, 7)
    wiring = wiring_of(network)
    place = reached(network, wiring)
    expected = evaluator(network).preconditioner[place][:, place].toarray()
    np.testing.assert_allclose(wiring.preconditioner, expected, atol=1e-8 * np.abs(expected).max())


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", [*PYRAMIDS, PreconditionerKind.CYCLIC_REDUCTION])
@pytest.mark.parametrize("name", PLANTS)
def test_all_but_a_grid_is_without_a_loop(name, kind):
    weights = (
        wiring_of(with_preconditioner(name, kind, 7)).weights.astype(bool).toarray().astype(int)
    )
    power = weights
    for _ in range(len(weights).bit_length()):
        power = np.minimum(power @ power + power, 1)
    assert not power.diagonal().any()


@pytest.mark.parametrize("name", PLANTS)
def test_wires_of_a_pyramid_are_those_of_the_record(name):
    network = with_preconditioner(name, PreconditionerKind.MULTILEVEL, 7)
    wiring, wires = wiring_of(network), network.preconditioner.wires(network.layout)
    sums = sum(name.startswith("coarse.") for name, _ in wiring.nodes)
    assert sums == wires.nodes
    assert wiring.weights.nnz == 2 * wires.count + len(wiring.own)


@pytest.mark.parametrize("name", PLANTS)
def test_wires_of_a_grid_are_those_of_the_record(name):
    network = with_preconditioner(name, PreconditionerKind.RESISTIVE_GRID, 7)
    wiring = wiring_of(network)
    count = network.preconditioner.wires(network.layout).count
    assert wiring.weights.nnz == pytest.approx(2 * count + len(wiring.own), rel=0.01)
    offsets = [
        abs(wire.offset)
        for part in preconditioner_parts(wiring, network.stages)
        if isinstance(part, GridNode)
        for wire in part.wires
    ]
    assert max(offsets) == 1


@every_kind
def test_parts_have_every_node_and_every_wire(kind):
    network = with_preconditioner("car", kind, 7)
    wiring = wiring_of(network)
    parts = list(preconditioner_parts(wiring, network.stages))
    assert {type(part) for part in parts} == {
        GridNode if kind is PreconditionerKind.RESISTIVE_GRID else Adder
    }
    assert sum(int(part.present.sum()) for part in parts) == len(wiring.nodes) - len(wiring.own)
    wires = wiring.weights.nnz + np.count_nonzero(wiring.constants)
    assert sum(np.count_nonzero(w.weight) for p in parts for w in p.wires) == wires
    assert all(not w.weight[~p.present].any() for p in parts for w in p.wires)


@pytest.mark.parametrize("kind", [*PYRAMIDS, PreconditionerKind.CYCLIC_REDUCTION])
@pytest.mark.parametrize("name", PLANTS)
def test_integrators_start_at_zero_and_neurons_where_the_network_does(name, kind):
    network = with_preconditioner(name, kind, 7)
    held = preconditioner_values(network, network.start_state[None])
    wiring = wiring_of(network)
    start = network.start_state[reached(network, wiring)]
    assert np.abs(start).max() > 0.1
    np.testing.assert_allclose(wiring.start, start, atol=1e-12)
    assert max(np.abs(values).max() for values in held.values()) < 1e-9


def test_integrators_of_a_grid_hold_the_start():
    network = with_preconditioner("car", PreconditionerKind.RESISTIVE_GRID, 7)
    held = preconditioner_values(network, network.start_state[None])
    assert not wiring_of(network).constants.any()
    assert np.abs(held["own.q.x"]).max() > 0.1


@pytest.mark.sampled(2)
@every_kind
def test_own_integrals_are_what_moves_the_neurons(kind):
    """D' = d and z' = M d: the integrals, put through the preconditioner, are z again."""
    network = with_preconditioner("car", kind)
    run = OdeBackend(method=DOP853, verify=False).run(network).trajectory
    held = preconditioner_values(network, run.states)
    x, moved = run.states[0], run.states[10]
    drives = np.zeros(network.live.shape)
    for name, values in held.items():
        if name.startswith(OWN):
            row = network.neuron_index[name.removeprefix(OWN)]
            drives[row] = values[10] - values[0]
    place = reached(network, wiring_of(network))
    change = (evaluator(network).preconditioner @ network.pack(drives))[place]
    np.testing.assert_allclose(change, (moved - x)[place], atol=1e-11)


def test_time_constants_need_no_wires():
    network = design(designed("double_integrator").network, gain_rule=DIAGONAL_RULE).network
    assert wiring_of(network) is None
    assert preconditioner_values(network, network.start_state[None]) == {}
