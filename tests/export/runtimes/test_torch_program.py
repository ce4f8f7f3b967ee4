"""Programs of torch.export: the steps of the layer, at any size of the batch."""

import io
import json
import subprocess
import sys
import textwrap
from functools import cache
from types import SimpleNamespace

import constrained
import minimax
import numpy as np
import pytest
import torch
from clamped_runs import run_with_changes
from onnx_runs import vector_of

import ann_dc
from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.errors import ArgumentError, FileFormatError
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.reference.vector import reference_vector
from ann_dc.export.runtimes.torch_program import torch_program_check, torch_program_files
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron, Role
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid

CASES = {
    "time constants": lambda: (
        ann_dc.design(
            ann_dc.plants.double_integrator(N=2),
            preconditioner=ann_dc.PreconditionerKind.DIAGONAL,
        ).network
    ),
    "a state, no pin": lambda: decay(),
}
SLOW = {
    "car with a grid": lambda: ann_dc.design(ann_dc.plants.car(N=3)).network,
    "pyramid": lambda: (
        ann_dc.design(
            ann_dc.plants.unicycle(N=4), preconditioner=ann_dc.PreconditionerKind.MULTILEVEL
        ).network
    ),
    "tree": lambda: (
        ann_dc.design(
            ann_dc.plants.car(N=4), preconditioner=ann_dc.PreconditionerKind.CYCLIC_REDUCTION
        ).network
    ),
    "shared neurons": lambda: ann_dc.design(minimax.small(4)).network,
    "inequalities": lambda: ann_dc.design(constrained.dint_u()).network,
}


def decay() -> Network:
    leak = Connection(source="x", target="x", weight=-1.0)
    cell = Cell(neurons=(Neuron(name="x", tau=2.0),), connections=(leak,))
    return Network(cell=cell, stages=2, start={"x": 1.0})


@cache
def exported(case: str):
    network = (CASES | SLOW)[case]()
    vector = reference_vector(network)
    return network, vector, torch_program_files(network, vector)


def loaded(files):
    return torch.export.load(io.BytesIO(files["torch_program.pt2"])).module()


@pytest.mark.parametrize(
    "case",
    [
        "a state, no pin",
        *(pytest.param(case, marks=pytest.mark.slow) for case in ("time constants", *SLOW)),
    ],
)
def test_a_program_takes_the_steps_of_the_layer(case):
    """Whatever the states and the inputs of the samples are, to 1e-15 of the largest state."""
    network, vector, files = exported(case)
    program, layer = loaded(files), CellLayer(network)
    rng = np.random.default_rng(7)
    for size in (1, 3, 64):
        x = torch.as_tensor(network.start_state + 0.01 * rng.standard_normal((size, network.size)))
        given = {
            name: values + 0.01 * rng.standard_normal((size, network.stages))
            for name, values in network.inputs.items()
        }
        scaled = [network.input_scale(name).network(given[name]) for name in network.cell.inputs]
        rows = np.array(scaled).reshape(-1, size, network.stages).transpose(1, 0, 2)
        step = torch.tensor(vector.step, dtype=torch.float64)
        found = program(x, torch.as_tensor(rows.copy()), step)
        expected = layer(x, given, step=vector.step)
        largest = max(1.0, float(expected.abs().max()))
        assert float((found["x"] - expected).abs().max()) <= 1e-15 * largest
        for sample, residual in enumerate(found["residual"].tolist()):
            own = network.with_inputs({name: rows[sample] for name, rows in given.items()})
            wanted = max(evaluator(own).residuals(x[sample].numpy()))
            assert residual == pytest.approx(wanted, rel=1e-9, abs=1e-13)
    assert "batches of 1, 3, 64" in torch_program_check(files)


@pytest.mark.slow
def test_a_program_runs_where_this_package_is_not(tmp_path):
    """In an interpreter that cannot import it."""
    files = exported("a state, no pin")[2]
    (tmp_path / "torch_program.pt2").write_bytes(files["torch_program.pt2"])
    script = """
        import sys, torch
        sys.modules["ann_dc"] = None
        program = torch.export.load("torch_program.pt2").module()
        x = torch.ones(5, 2, dtype=torch.float64)
        inputs, step = torch.zeros(5, 0, 2).double(), torch.tensor(0.5).double()
        print(program(x, inputs, step)["x"].tolist())
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert run.stdout.strip() == str([[0.75, 0.75]] * 5), run.stderr


@pytest.mark.slow
def test_names_tell_what_tensors_are():
    network, _, files = exported("time constants")
    notes = json.loads(files["torch_program.json"])
    held = torch.export.load(io.BytesIO(files["torch_program.pt2"])).state_dict
    assert {name: len(rows) for name, rows in notes["tensors"].items()} == {
        name: len(held[name]) for name in held
    }
    assert notes["tensors"]["cell.tau.rows"] == [n.name for n in network.cell.neurons]
    assert list(notes["inputs"]) == list(network.cell.inputs)
    assert notes["x"] == [network.label(i) for i in range(network.size)]
    row = notes["tensors"]["cell.weight.rows"].index(network.cell.connections[0].name)
    weight = network.cell.connections[0].weight
    np.testing.assert_array_equal(held["cell.weight.rows"][row], np.broadcast_to(weight, 2))


def pulled() -> Network:
    """A neuron at its rail, whose drive points outward, and another one that pulls it off."""
    own, following = np.array([[[1.0, -0.5], [-0.5, 1.0]]]), np.zeros((0, 2, 2))
    low = Limiter(low=0.0)
    cell = Cell(
        neurons=tuple(Neuron(name=n, role=Role.PRIMAL, limiter=low) for n in ("u.a", "u.b")),
        inputs=("a", "b"),
        connections=tuple(Connection(source=n, target=f"u.{n}") for n in ("a", "b")),
    )
    grid = ResistiveGrid(own=own, following=following)
    return Network(cell=cell, stages=1, inputs={"a": -1.0, "b": 4.0}, preconditioner=grid)


@pytest.mark.slow
def test_a_program_moves_a_neuron_off_its_rail_where_another_one_pulls():
    """With a drive of -1 it is pulled off, with -3 it is held: see `projection.projected`."""
    program = loaded(torch_program_files(pulled(), vector_of(pulled())))
    inputs = torch.tensor([[[-1.0], [4.0]], [[-3.0], [4.0]]], dtype=torch.float64)
    x, step = torch.zeros(2, 2, dtype=torch.float64), torch.tensor(0.5, dtype=torch.float64)
    expected = torch.tensor([[4 / 3, 14 / 3], [0.0, 4.0]], dtype=torch.float64)
    torch.testing.assert_close(program(x, inputs, step)["x"], 0.5 * expected)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [pytest.param(np.nan, marks=pytest.mark.slow), 1e-5])
def test_a_program_with_another_residual_is_refused(wrong, monkeypatch):
    files, load = exported("time constants")[2], torch.export.load

    def program(content):
        own = load(content).module()
        return lambda *given: own(*given) | {"residual": torch.tensor([wrong])}

    monkeypatch.setattr(torch.export, "load", lambda c: SimpleNamespace(module=lambda: program(c)))
    with pytest.raises(FileFormatError, match="the residual at the end"):
        torch_program_check(files)


@pytest.mark.slow
def test_a_vector_with_another_end_is_refused():
    _, _, files = exported("time constants")
    table = json.loads(files["reference_vector.json"])
    for changed in ({"residual": 0.0}, {"end": table["start"]}):
        other = json.dumps(table | changed).encode()
        with pytest.raises(FileFormatError, match="the residual at the end"):
            torch_program_check({**files, "reference_vector.json": other})


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [ann_dc.PreconditionerKind.RESISTIVE_GRID, ann_dc.PreconditionerKind.MULTILEVEL]
)
def test_a_program_projects_moves_at_rails_as_the_layer(kind):
    network, states, _ = run_with_changes(kind)
    program, layer = loaded(torch_program_files(network, vector_of(network))), CellLayer(network)
    inputs = torch.as_tensor(np.array([*network.input_values.values()]))
    step = torch.tensor(0.1, dtype=torch.float64)
    for size in (1, 3, 64):
        x = torch.as_tensor(states[5 : 9 * size + 5 : 9])
        found = program(x, inputs.expand(len(x), -1, -1).clone(), step)["x"]
        torch.testing.assert_close(found, layer(x, step=0.1), rtol=0, atol=1e-14)


def test_single_precision():
    network = decay()
    files = torch_program_files(network, reference_vector(network), precision="float32")
    step = torch.tensor(0.5)
    after = loaded(files)(torch.ones(4, 2), torch.zeros(4, 0, 2), step)["x"]
    assert after.dtype is torch.float32
    torch.testing.assert_close(after, torch.full((4, 2), 0.75))
    assert "50 steps" in torch_program_check(files)


def test_another_precision_is_refused():
    network = decay()
    with pytest.raises(ArgumentError, match="precision: expected one of 'float64', 'float32'"):
        torch_program_files(network, reference_vector(network), precision="bfloat16")


def test_a_program_with_another_hash_is_not_loaded(monkeypatch):
    """Loading may run what somebody has put into it."""
    _, _, files = exported("a state, no pin")
    content = bytearray(files["torch_program.pt2"])
    content[len(content) // 2] ^= 1
    loads = []
    monkeypatch.setattr(torch.export, "load", loads.append)
    with pytest.raises(FileFormatError, match="not loaded"):
        torch_program_check({**files, "torch_program.pt2": bytes(content)})
    assert loads == []


def test_what_was_changed_is_refused():
    _, _, files = exported("a state, no pin")
    _, _, other = exported("time constants")
    notes = json.loads(files["torch_program.json"])
    for changed in (
        {**files, "reference_vector.json": other["reference_vector.json"]},
        {**files, "torch_program.json": json.dumps(notes | {"schema": 2}).encode()},
        {**files, "torch_program.json": json.dumps(notes | {"places": []}).encode()},
        {**files, "torch_program.json": json.dumps(notes | {"inputs": {"x": 1}}).encode()},
        {**files, "torch_program.json": b"\xff"},
        {name: content for name, content in files.items() if name != "torch_program.pt2"},
    ):
        with pytest.raises(FileFormatError):
            torch_program_check(changed)
