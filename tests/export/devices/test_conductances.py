"""Conductances: what comes back, what quantising costs, what is refused."""

import json
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest
from seeds import seeds

import ann_dc
from ann_dc.backends.ode import OdeBackend
from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.devices.conductances import conductances_check, conductances_files, weights_of
from ann_dc.export.reference.vector import reference_vector
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network


@pytest.fixture(scope="module")
def network() -> Network:
    return ann_dc.design(ann_dc.plants.car()).network


@pytest.fixture(scope="module")
def vector(network):
    return reference_vector(network)


def pairs(files) -> np.ndarray:
    rows = files["conductances.csv"].decode().splitlines()[1:]
    return np.array([[float(g) for g in row.rsplit(",", 2)[1:]] for row in rows])


def random_row(seed: int, stages: int = 40) -> Network:
    """A leak and three wires whose weights and time constants are any float64 of two decades."""
    rng = np.random.default_rng(seed)
    tau, *weights = 10 ** rng.uniform(-0.9, 0.9, (4, stages)) * rng.choice([-1, 1], (4, stages))
    names = ("x", "y", "z")
    wires = [
        Connection(source=n, target="x", weight=w, template=-1) for n, w in zip(names, weights)
    ]
    leaks = [Connection(source=n, target=n, weight=-1.0) for n in names]
    neurons = tuple(Neuron(name=n, tau=np.abs(tau)) for n in names)
    return Network(cell=Cell(neurons=neurons, connections=(*wires, *leaks)), stages=stages)


@pytest.mark.parametrize("folded", [False, True])
@seeds(5)
def test_every_bit_comes_back(seed, folded):
    row = random_row(seed)
    files = conductances_files(row, reference_vector(row), decades=4.0, folded=folded, lowest=3e-7)
    found = weights_of(files)
    for wire in row.cell.connections:
        np.testing.assert_array_equal(found[wire.name], np.broadcast_to(wire.weight, 40))
    assert "last bit" in conductances_check(files)


def test_a_pair_has_one_device_within_the_range(network, vector):
    given = pairs(conductances_files(network, vector, lowest=2e-6, decades=2.0))
    assert ((given == 0).sum(axis=1) >= 1).all()
    devices = given[given > 0]
    assert devices.min() >= 2e-6 * (1 - 1e-12)
    assert devices.max() == pytest.approx(2e-4)


def test_of_one_node_conductances_are_in_the_ratio_of_the_weights(network, vector):
    """Folded, so are those of all integrators, with time constants in them."""
    stages = network.stages
    for folded in (False, True):
        files = conductances_files(network, vector, decades=4.0, folded=folded)
        plus, minus = pairs(files).reshape(-1, stages, 2).transpose(2, 0, 1)
        ratios: dict[str, list[float]] = {}
        for wire, siemens in zip(network.cell.connections, plus - minus):
            tau, node = 1.0, wire.target
            if folded and node in network.neuron_index:
                tau, node = network.neuron(node).tau, "integrators"
            found = siemens / (np.broadcast_to(wire.weight, stages) / tau)
            ratios.setdefault(node, []).extend(found)
        for found in ratios.values():
            np.testing.assert_allclose(found, found[0], rtol=1e-13)


def test_quantised_devices_take_so_many_values(network, vector):
    given = pairs(conductances_files(network, vector, levels=16))
    step = (1e-4 - 1e-6) / 15
    places = (given[given > 0] - 1e-6) / step
    np.testing.assert_allclose(places, np.round(places), atol=1e-9)
    assert places.max() == pytest.approx(15)


def test_quantised_weights_come_back_as_what_the_devices_say(network, vector):
    files = conductances_files(network, vector, levels=64)
    scales = json.loads(files["conductances.json"])["scales_S"]
    signed = pairs(files) @ [1, -1]
    found = weights_of(files)
    for wire, siemens in zip(network.cell.connections, signed.reshape(-1, network.stages)):
        expected = siemens / float(scales[wire.target])
        np.testing.assert_allclose(found[wire.name], expected, rtol=1e-14)


def test_the_cost_of_quantising_is_what_another_run_finds(network, vector):
    """The quantised network, integrated in continuous time, against the optimum."""
    files = conductances_files(network, vector, levels=256)
    notes, found = json.loads(files["conductances.json"]), weights_of(files)
    wires = tuple(replace(c, weight=found[c.name]) for c in network.cell.connections)
    rough = replace(network, cell=replace(network.cell, connections=wires))
    settling = ann_dc.Settling(tolerance=1e-9)
    ends = [
        OdeBackend(verify=False, settling=settling).run(n).trajectory.final
        for n in (network, rough)
    ]
    u = network.of_population("u")
    exact, other = (network.user_units(end)[u] for end in ends)
    off = np.abs(other - exact).max() / np.abs(exact).max()
    assert notes["control_error"] == pytest.approx(off, rel=1e-4)
    assert conductances_check(files).endswith(f"controls {off:.1e} off, NOT within 1%")
    fine = conductances_check(conductances_files(network, vector, levels=4096))
    assert fine.endswith("off")
    changes = [np.abs(found[c.name] / c.weight - 1).max() for c in network.cell.connections]
    assert notes["weight_error"] == pytest.approx(max(changes))


def test_more_levels_cost_less(network, vector):
    off = [
        json.loads(conductances_files(network, vector, levels=n)["conductances.json"])
        for n in (2**8, 2**12, 2**16)
    ]
    errors = [notes["control_error"] for notes in off]
    assert errors[0] > 4 * errors[1] > 16 * errors[2] > 0


def test_weights_that_do_not_fit_are_refused_with_node_and_decades():
    wires = (
        Connection(source="x", target="x", weight=-1.0),
        Connection(source="y", target="x", weight=5e-4),
        Connection(source="y", target="y", weight=-1.0),
    )
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), connections=wires)
    row = Network(cell=cell, stages=2, start={"y": 1.0})
    vector = reference_vector(row)
    with pytest.raises(ExportError, match=r"at x, from x<-y to x<-x, span 3\.30.*decades=3\.4"):
        conductances_files(row, vector)
    assert "last bit" in conductances_check(conductances_files(row, vector, decades=3.4))


@pytest.mark.parametrize(
    ("options", "named"),
    [({"levels": 1}, "levels"), ({"levels": 2**25}, "levels"), ({"decades": 31.0}, "decades")],
)
def test_options_are_refused_by_name(network, vector, options, named):
    with pytest.raises(ExportError, match=named):
        conductances_files(network, vector, **options)


def test_the_vector_of_another_network_is_refused(network, vector):
    with pytest.raises(ExportError, match="another network"):
        conductances_files(network.with_inputs({"q_d.x": 4.0}), vector)


def changed(files, name, old, new):
    assert old in files[name]
    return {**files, name: files[name].replace(old, new, 1)}


def test_what_was_changed_is_refused(network, vector):
    files = conductances_files(network, vector)
    first = files["conductances.csv"].split(b"\n")[1].split(b",")
    value = next(part for part in first[2:] if Decimal(part.decode()))
    for other in (
        changed(files, "conductances.csv", value, b"1.00001e-5"),
        changed(files, "conductances.csv", value, b"nan"),
        changed(files, "conductances.csv", value, b"-1e-5"),
        changed(files, "conductances.csv", value, b"1e99999999"),
        changed(files, "conductances.csv", b",0,", b",1,"),
        changed(files, "conductances.json", b'"schema": 1', b'"schema": 2'),
        changed(files, "conductances.json", b'"scales_S"', b'"scales"'),
        {**files, "conductances.json": b"\xff"},
        {**files, "network.npz": files["network.npz"][:-20]},
        {name: content for name, content in files.items() if name != "conductances.csv"},
    ):
        with pytest.raises(FileFormatError):
            conductances_check(other)


@pytest.mark.slow
def test_a_network_of_ninety_stages_with_a_preconditioner():
    network = ann_dc.design(ann_dc.plants.car(N=90, dt=0.01)).network
    files = conductances_files(network, reference_vector(network), levels=4096)
    assert "weights within" in conductances_check(files)
