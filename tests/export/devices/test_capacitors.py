"""Capacitor ratios: whole numbers that come back, what rounding costs, what is refused."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import ExportError, FileFormatError
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.devices.capacitors import capacitors_check, capacitors_files, units_of
from ann_dc.export.reference.vector import ReferenceVector, reference_vector
from ann_dc.network.cell import ONE, Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network

KINDS = [ann_dc.PreconditionerKind.DIAGONAL]


@pytest.fixture(scope="module")
def network() -> Network:
    return ann_dc.design(ann_dc.plants.car(N=5), preconditioner=KINDS).network


@pytest.fixture(scope="module")
def vector(network) -> ReferenceVector:
    return reference_vector(network)


def notes_of(files) -> dict:
    return json.loads(files["capacitors.json"])


def weights(network: Network, units, step: float) -> dict[str, np.ndarray]:
    """What whole numbers stand for, by the rule that the files state."""
    tau = {n.name: n.tau for n in network.cell.neurons}
    found = {}
    for wire in network.cell.connections:
        own, across = units[wire.name].T
        found[wire.name] = own / across * (tau.get(wire.target, step) / step)
    return found


def reweighed(network: Network, found) -> Network:
    wires = tuple(replace(c, weight=found[c.name]) for c in network.cell.connections)
    return replace(network, cell=replace(network.cell, connections=wires))


def test_ratios_are_the_nearest_that_fit(network, vector):
    """Against a search with fractions, over one op amp after the other."""
    files = capacitors_files(network, vector, largest=6.4e-12)
    units, step = units_of(files), vector.step
    for node in {c.target for c in network.cell.connections}:
        wires = [c for c in network.cell.connections if c.target == node]
        rate = step / network.neuron(node).tau if node in network.neuron_index else 1.0
        wanted = [abs(np.broadcast_to(c.weight * rate, network.stages)[2]) for c in wires]
        worst = {
            m: max(abs(round(r * m) / m / r - 1) for r in wanted)
            for m in range(1, 65)
            if all(1 <= round(r * m) <= 64 for r in wanted)
        }
        taken = [units[c.name][2] for c in wires]
        assert len({across for _, across in taken}) == 1
        assert worst[taken[0][1]] == pytest.approx(min(worst.values()))
        assert [abs(own) for own, _ in taken] == [round(r * taken[0][1]) for r in wanted]


def test_whole_numbers_come_back(network, vector):
    """The network of the ratios has the same whole numbers."""
    files = capacitors_files(network, vector)
    units = units_of(files)
    rough = reweighed(network, weights(network, units, vector.step))
    again = capacitors_files(rough, reference_vector(rough), step=vector.step)
    assert again["capacitors.csv"] == files["capacitors.csv"]
    assert notes_of(again)["ratio_error"] < 1e-14
    for name, pairs in units_of(again).items():
        np.testing.assert_array_equal(pairs, units[name])


def test_branches_in_periods_are_the_recurrence(network, vector):
    """Charges in fractions, one period, against the step of the network of these ratios."""
    units = units_of(capacitors_files(network, vector))
    rough = reweighed(network, weights(network, units, vector.step))
    x, values = network.start_state, evaluator(rough).values(network.start_state)
    after = network.unpack(x + vector.step * evaluator(rough).rhs(x))
    stage = 2
    for name, row in network.neuron_index.items():
        charge = sum(
            Fraction(*map(int, units[c.name][stage]))
            * Fraction(values[network.node_index[c.source], stage + 1 + c.template])
            for c in network.cell.connections
            if c.target == name
        )
        assert float(values[row, stage + 1] + charge) == pytest.approx(after[row, stage], abs=1e-12)


def test_the_cost_is_what_another_run_finds(network, vector):
    files = capacitors_files(network, vector)
    notes, units = notes_of(files), units_of(files)
    rough = reweighed(network, weights(network, units, vector.step))
    settling = ann_dc.Settling(tolerance=1e-9)
    ends = [
        ann_dc.OdeBackend(verify=False, settling=settling).run(n).trajectory.final
        for n in (network, rough)
    ]
    u = network.of_population("u")
    exact, other = (network.user_units(end)[u] for end in ends)
    off = np.abs(other - exact).max() / np.abs(exact).max()
    assert notes["control_error"] == pytest.approx(off, rel=1e-4)
    assert f"controls {off:.1e} off" in capacitors_check(files)


def test_larger_capacitors_cost_less(network, vector):
    off = [
        notes_of(capacitors_files(network, vector, largest=units * 1e-13))["ratio_error"]
        for units in (64, 256, 1024, 4096)
    ]
    assert off == sorted(off, reverse=True)
    assert off[0] > 10 * off[-1]


def test_capacitors_are_whole_units(network, vector):
    files = capacitors_files(network, vector, unit=2e-14, largest=2e-12)
    for row in files["capacitors.csv"].decode().splitlines()[1:]:
        _, _, own, across, farads, feedback = row.rsplit(",", 5)
        assert float(farads) == pytest.approx(abs(int(own)) * 2e-14)
        assert float(feedback) == pytest.approx(int(across) * 2e-14)
        assert 1 <= int(across) <= 100
        assert abs(int(own)) <= 100


def test_a_node_that_needs_more_is_refused_by_name(network, vector):
    with pytest.raises(ExportError, match=r"\[\d\]: ratios from .* need capacitors of \d+ units"):
        capacitors_files(network, vector, largest=1e-13)
    with pytest.raises(ExportError, match=r"largest: expected 1 to 4096 units"):
        capacitors_files(network, vector, largest=1e-14)
    with pytest.raises(ExportError, match=r"largest: expected 1 to 4096 units"):
        capacitors_files(network, vector, largest=1e-6)


def test_another_preconditioner_is_refused():
    grid = ann_dc.design(ann_dc.plants.double_integrator(N=4)).network
    with pytest.raises(
        ExportError, match=r"resistive grid.*preconditioner=PreconditionerKind.DIAGONAL"
    ):
        capacitors_files(grid, reference_vector(grid))


def test_rails_are_told():
    neuron = Neuron(name="x", limiter=Limiter(low=-0.5))
    wires = (
        Connection(source="x", target="x", weight=-1.0),
        Connection(source=ONE, target="x", weight=-1.0),
    )
    network = Network(cell=Cell(neurons=(neuron,), connections=wires), stages=2)
    files = capacitors_files(network, reference_vector(network))
    assert notes_of(files)["rails"] == {"x": [-0.5, None]}
    assert "controls 0.0e+00 off" in capacitors_check(files)


def changed(files, name, old, new):
    assert old in files[name]
    return {**files, name: files[name].replace(old, new, 1)}


def test_what_was_changed_is_refused(network, vector):
    files = capacitors_files(network, vector)
    row = files["capacitors.csv"].split(b"\n")[1]
    head, own, across, farads, feedback = row.rsplit(b",", 4)
    other = abs(int(own)) + 1
    for damaged in (
        b",".join([head, str(other).encode(), across, farads, feedback]),
        b",".join([head, str(other).encode(), across, f"{other * 1e-13:.6g}".encode(), feedback]),
        b",".join([head, own, b"0", farads, b"0"]),
        b",".join([head, b"1.5", across, farads, feedback]),
        b",".join([head, b"9" * 30, across, farads, feedback]),
    ):
        with pytest.raises(FileFormatError):
            capacitors_check(changed(files, "capacitors.csv", row, damaged))
    for other in (
        changed(files, "capacitors.csv", b",0,", b",1,"),
        changed(files, "capacitors.json", b'"step": ', b'"step": -'),
        changed(files, "capacitors.json", b'"schema": 1', b'"schema": 2'),
        {**files, "capacitors.json": b"\xff"},
        {**files, "network.npz": files["network.npz"][:-20]},
        {name: content for name, content in files.items() if name != "capacitors.csv"},
    ):
        with pytest.raises(FileFormatError):
            capacitors_check(other)
