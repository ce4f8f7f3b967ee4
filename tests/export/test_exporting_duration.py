"""Exports of networks that never settle, scaled by a run of a given duration."""

import csv
import re
import subprocess

import numpy as np
import pytest
from oscillators import chua, reference, van_der_pol, wire
from simulator import needs_ngspice

import ann_dc
from ann_dc.errors import ExportError
from ann_dc.export.catalogue import FORMATS, inspect_export
from ann_dc.export.reference.vector import ReferenceVector, reference_vector
from ann_dc.network import Cell, Network, Neuron

CIRCUITS = ("pack", "ltspice", "xyce", "kicad", "verilog_a", "schematic", "analog_computer")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("van_der_pol")
    found = ann_dc.export_network(van_der_pol(), "all", folder, duration=20.0)
    return folder, {each.name: each for each in found}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", CIRCUITS)
def test_a_circuit_of_every_format_is_written_and_checked(exported, name):
    _, found = exported
    assert not found[name].why_not
    assert found[name].files


def test_what_cannot_be_held_is_refused_by_name(exported):
    _, found = exported
    assert {name for name in FORMATS if found[name].why_not} <= {"nir", "c99", "hdl", "capacitors"}
    assert "xx (product)" in found["nir"].why_not
    for name in ("c99", "hdl"):
        assert found[name].why_not.startswith("duration: expected a network that settles, got a ")


@pytest.mark.parametrize("refused", ["c99", "hdl", "nir"])
def test_a_refusal_names_formats_that_take_the_network(exported, refused):
    _, found = exported
    named = [name for name in FORMATS if re.search(rf"\b{name}\b", found[refused].why_not)]
    assert len(named) >= 3
    assert not any(found[name].why_not for name in named)


def test_fixed_point_without_a_duration_names_the_design():
    network = van_der_pol()
    with pytest.raises(ExportError, match="network: expected a network that settles within"):
        FORMATS["c99"].write(network, reference_vector(network))


def test_a_linear_oscillator_is_a_graph_of_nir(tmp_path):
    """x'' = -x, whose steps are linear."""
    wires = wire("y", "x"), wire("x", "y", -1.0)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), connections=wires)
    network = Network(cell=cell, stages=1, start={"x": 1.0})
    [found] = ann_dc.export_network(network, "nir", tmp_path, duration=20.0)
    assert "50 steps of the graph" in found.worth


@needs_ngspice
@pytest.mark.parametrize(("network", "duration"), [(van_der_pol(), 20.0), (chua(), 8.7)])
def test_a_pack_runs_by_hand_and_ends_where_the_equations_do(network, duration, tmp_path):
    ann_dc.export_network(network, "pack", tmp_path, duration=duration)
    folder = tmp_path / "pack"
    said = subprocess.run(
        ["ngspice", "-n", "-b", "deck.cir"], cwd=folder, capture_output=True, text=True, check=True
    )
    assert "at the end of the run" in said.stdout
    wanted = reference(network, duration)(duration)
    with open(folder / "controls.csv") as file:
        found = [float(row["settled"]) for row in csv.DictReader(file)]
    np.testing.assert_allclose(found, wanted, atol=1e-2 * np.abs(wanted).max())


def test_a_vector_knows_its_duration():
    vector = reference_vector(van_der_pol(), duration=20.0)
    assert not vector.settles
    again = ReferenceVector.from_json(vector.as_json())
    assert again.duration == 20.0
    assert again.as_json() == vector.as_json()
    assert (
        "duration"
        not in reference_vector(ann_dc.design(ann_dc.plants.double_integrator(N=3)).network)
        .as_json()
        .decode()
    )


@pytest.mark.parametrize("name", ["pack", "analog_computer", "onnx", "weights"])
def test_an_export_is_inspected(exported, name):
    folder, _ = exported
    [found] = inspect_export(folder / name)
    assert found.good, found.wrong


def test_a_settling_network_is_exported_with_a_duration_as_well(tmp_path):
    network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    found = ann_dc.export_network(network, ["weights", "onnx", "c99"], tmp_path, duration=100.0)
    assert not any(each.why_not for each in found)


@needs_ngspice
def test_inputs_over_time_are_held_or_refused_by_name(tmp_path):
    network = ann_dc.design(
        ann_dc.plants.double_integrator(N=3), preconditioner=ann_dc.PreconditionerKind.DIAGONAL
    ).network
    target = ann_dc.Waveform(times=[0.0, 100.0, 200.0], values=[1.0, 2.0, 1.5])
    moving = network.with_inputs({"q_d.x": target})
    found = {e.name: e for e in ann_dc.export_network(moving, "all", tmp_path, duration=200.0)}
    held = {name for name, each in found.items() if not each.why_not}
    assert held == {"weights", "csv", "pack", "ltspice", "xyce"}
    for name in found.keys() - held:
        expected = f"inputs: expected constant values for {name}, got q_d.x over time; use one of "
        assert found[name].why_not.startswith(expected + "weights, csv, pack")
    for name in ("pack", "ltspice", "xyce"):
        assert "PWL(" in (tmp_path / name / "deck.cir").read_text()
    said = subprocess.run(
        ["ngspice", "-n", "-b", "deck.cir"], cwd=tmp_path / "pack", capture_output=True, text=True
    )
    off = float(re.search(r"off by (\S+) of", said.stdout)[1])
    assert off < 1e-3
