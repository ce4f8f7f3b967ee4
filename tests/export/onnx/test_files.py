"""What stands in the files: names, units, hashes; and which networks are refused."""

import importlib.util
import json
from dataclasses import replace

import numpy as np
import onnx
import pytest
from onnx import numpy_helper
from onnx_runs import vector_of

import ann_dc
from ann_dc.errors import ArgumentError, ExportError, ExportPackageMissing
from ann_dc.export.onnx.files import onnx_files
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.scale import Scale
from ann_dc.weights.hashes import content_hash, wiring_hash


def test_a_file_says_whose_network_it_is(car, files):
    for name in ("step.onnx", "settle.onnx"):
        model = onnx.load_model_from_string(files[name])
        said = {entry.key: entry.value for entry in model.metadata_props}
        assert said["title"] == car.title
        assert (said["wiring"], said["content"]) == (wiring_hash(car), content_hash(car))
        names = [row["name"] for row in json.loads(said["neurons"])]
        assert names == list(car.neuron_index)
        assert [row["name"] for row in json.loads(said["inputs"])] == list(car.cell.inputs)


def test_it_has_the_units_of_every_neuron_and_input():
    cell = Cell(
        neurons=(Neuron(name="x", scale=Scale(factor=2.0, offset=300.0)),),
        inputs=("c",),
        connections=(Connection(source="c", target="x"),),
    )
    network = Network(
        cell=cell, stages=1, inputs={"c": 1.0}, input_scales={"c": Scale(factor=0.5, offset=-1.0)}
    )
    model = onnx.load_model_from_string(onnx_files(network, vector_of(network))["step.onnx"])
    said = {entry.key: json.loads(entry.value) for entry in model.metadata_props
            if entry.key in ("neurons", "inputs")}  # fmt: skip
    assert said == {
        "neurons": [{"name": "x", "factor": 2.0, "offset": 300.0}],
        "inputs": [{"name": "c", "factor": 0.5, "offset": -1.0}],
    }


def test_numbers_have_the_names_of_the_network(car, files):
    model = onnx.load_model_from_string(files["settle.onnx"])
    tables = {table.name: numpy_helper.to_array(table) for table in model.graph.initializer}
    for neuron in car.cell.neurons:
        tau = tables[f"tau.{neuron.name}"].ravel()
        np.testing.assert_array_equal(np.broadcast_to(tau, car.stages), neuron.tau)
    for connection in car.cell.connections:
        weight = np.ravel(connection.weight)
        if connection.source != "one" and not (np.abs(weight) == 1).all():
            np.testing.assert_array_equal(tables[f"weight.{connection.name}"].ravel(), weight)
    for level, gain in enumerate(car.preconditioner.gains):
        np.testing.assert_array_equal(tables[f"coordinator.{level}"], gain)


def test_the_same_network_gives_the_same_bytes(car, vector, files):
    assert onnx_files(car, vector) == files


def test_float32_is_half_of_it(car, vector, files):
    single = onnx_files(car, vector, precision="float32")
    tables = onnx.load_model_from_string(single["step.onnx"]).graph.initializer
    kinds = {table.data_type for table in tables}
    assert onnx.TensorProto.DOUBLE not in kinds
    assert len(single["step.onnx"]) < len(files["step.onnx"])


def test_no_file_refers_to_another(files):
    for name in ("step.onnx", "settle.onnx"):
        model = onnx.load_model_from_string(files[name])
        onnx.checker.check_model(model, full_check=True)
        assert not any(table.external_data for table in model.graph.initializer)


def test_a_network_of_ninety_stages_takes_seconds():
    network = ann_dc.synthesize(ann_dc.plants.car(N=90))
    sizes = {
        name: len(content) for name, content in onnx_files(network, vector_of(network)).items()
    }
    assert max(sizes.values()) < 2e5


def test_another_networks_vector_is_refused(car, vector):
    with pytest.raises(ExportError, match="another network"):
        onnx_files(car.with_inputs({"q_d.x": 4.0}), vector)


def test_what_float32_cannot_hold_is_refused_by_name(car):
    neurons = (replace(car.cell.neurons[0], tau=1e50), *car.cell.neurons[1:])
    slow = replace(car, cell=replace(car.cell, neurons=neurons))
    assert onnx_files(slow, vector_of(slow))
    with pytest.raises(ExportError, match=r"tau\.q\.x: 1e\+50 is too large for float32"):
        onnx_files(slow, vector_of(slow), precision="float32")


def test_precisions_are_two(car, vector):
    with pytest.raises(ArgumentError, match="precision"):
        onnx_files(car, vector, precision="float16")


def test_without_onnx_the_line_is_told_that_installs_it(car, vector, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == "onnx" else found(n))
    with pytest.raises(ExportPackageMissing, match=r"pip install 'ann-dc\[export\]'"):
        onnx_files(car, vector)
