"""NIR: graphs that other tools read, integrated by their nodes' equations."""

import hashlib
import json
import sys
import tracemalloc
import zlib

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import ann_dc
from ann_dc.errors import ExportError, ExportPackageMissing, FileFormatError
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.reference.vector import reference_vector
from ann_dc.export.runtimes.nir_graph import nir_check, nir_files
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron, Sum
from ann_dc.network.network import Network

nir = pytest.importorskip("nir", reason="the package nir is not installed")
h5py = pytest.importorskip("h5py", reason="the package h5py is not installed")
PLANTS = ann_dc.plants
CASES = {
    "grid": lambda: ann_dc.design(PLANTS.double_integrator(N=6)).network,
    "time constants": lambda: (
        ann_dc.design(PLANTS.lq(N=4), preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    ),
    "pyramid, free end": lambda: (
        ann_dc.design(
            PLANTS.lq(N=4, q_d=None), preconditioner=ann_dc.PreconditionerKind.MULTILEVEL
        ).network
    ),
    "fed from the left": lambda: chain(),
    "one for all": lambda: chain(shared=True),
    "from two cells away": lambda: chain(offset=-2),
    "no input": lambda: oscillator(),
    "no input, a bias": lambda: oscillator(rest=0.5),
}


def chain(shared: bool = False, offset: int = -1) -> Network:
    """Leaky integrators in a row through a sum, with a bus that adds them up where ``shared``."""
    wires = [
        Connection(source="x", target="x", weight=np.array([-1.0, -2.0, -3.0])),
        Connection(source="y", target="x", weight=0.5, template=offset),
        Connection(source="x", target="y", weight=2.0, template=1),
        Connection(source="one", target="y", weight=0.25),
        Connection(source="drive", target="x", weight=0.1),
    ]
    neurons = [Neuron(name="x", tau=np.array([1.0, 2.0, 0.5]))]
    if shared:
        neurons.append(Neuron(name="s", tau=3.0, shared=True))
        wires += [
            Connection(source="x", target="s", weight=np.array([1.0, -1.0, 0.5])),
            Connection(source="s", target="s", weight=np.array([0.0, 0.0, -1.0])),
            Connection(source="s", target="x", weight=0.2),
        ]
    return Network(
        cell=Cell(
            neurons=tuple(neurons), inputs=("drive",), blocks=(Sum(name="y"),),
            connections=tuple(wires),
        ),
        stages=3, inputs={"drive": np.array([1.0, 2.0, 3.0])}, left_boundary={"y": "drive"},
        start={"x": 0.3},
    )  # fmt: skip


def oscillator(rest: float = 0.0) -> Network:
    """x'' = -4 x' - 100 (x - rest): nothing comes from outside."""
    wires = [
        Connection(source="v", target="x"),
        Connection(source="x", target="v", weight=-100.0),
        Connection(source="v", target="v", weight=-4.0),
    ]
    wires += [Connection(source="one", target="v", weight=100 * rest)] if rest else []
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="v")), connections=tuple(wires))
    return Network(cell=cell, stages=1, start={"x": 0.8}, title="oscillator")


def bias_of(nodes):
    return getattr(nodes["synapses"], "bias", np.zeros(len(nodes["synapses"].weight)))


def graph_of(files, folder):
    path = folder / "network.nir"
    path.write_bytes(files["network.nir"])
    return nir.read(path)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("case", CASES)
def test_the_graph_that_is_read_has_the_trajectory_of_the_network(case, tmp_path):
    """v' = G v + c in closed form, against the network in continuous time."""
    network = CASES[case]()
    files = nir_files(network, reference_vector(network))
    nodes = graph_of(files, tmp_path).nodes
    given = [network.input_values[name] for name in network.cell.inputs]
    inputs = np.concatenate(given or [np.zeros(1)])
    matrix, bias = nodes["synapses"].weight, bias_of(nodes)
    assert type(nodes["synapses"]) is (nir.Affine if bias.any() else nir.Linear)
    fed = nodes["input_weights"].weight @ inputs + bias
    preconditioner = (
        nodes["preconditioner"].weight if "preconditioner" in nodes else np.eye(len(bias))
    )
    rates = nodes["neurons"].r[:, None]
    whole = rates * np.column_stack([preconditioner @ matrix, preconditioner @ fed])
    square = np.vstack([whole, np.zeros(len(bias) + 1)])

    x = network.start_state
    time = np.array([0.5, 2.0, 8.0])
    run = solve_ivp(
        lambda _, x: evaluator(network).rhs(x), (0, 8), x, t_eval=time, method="DOP853",
        rtol=1e-12, atol=1e-13,
    )  # fmt: skip
    for t, expected in zip(time, run.y.T):
        found = (expm(t * square) @ np.append(x, 1.0))[:-1]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * max(1, np.abs(x).max()))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("case", CASES)
def test_its_check_takes_the_steps_of_the_vector(case):
    network = CASES[case]()
    vector = reference_vector(network)
    found = nir_check(nir_files(network, vector))
    assert "50 steps of the graph within" in found
    assert (f"vector, {vector.steps} within" in found) == vector.settles


def test_another_end_is_refused():
    network = chain()
    files = nir_files(network, reference_vector(network))
    table = json.loads(files["reference_vector.json"])
    for changed in ({"end": (np.array(table["end"]) + 1e-4).tolist()}, {"steps": 3}):
        other = json.dumps(table | changed).encode()
        with pytest.raises(FileFormatError, match="the states differ"):
            nir_check({**files, "reference_vector.json": other})


def test_without_nir_it_says_what_to_install(monkeypatch):
    network = chain()
    files = nir_files(network, reference_vector(network))
    monkeypatch.setitem(sys.modules, "nir", None)
    for ask in (lambda: nir_check(files), lambda: nir_files(network, reference_vector(network))):
        with pytest.raises(ExportPackageMissing, match=r"pip install 'ann-dc\[export\]'"):
            ask()


def test_inputs_stay_inputs(tmp_path):
    """The graph of one target, fed with another, is that of the other."""
    network = CASES["grid"]()
    moved = network.with_inputs({"q_d.x": 3.0})
    graphs = [graph_of(nir_files(n, reference_vector(n)), tmp_path).nodes for n in (network, moved)]
    for name in ("synapses", "input_weights", "preconditioner"):
        np.testing.assert_array_equal(graphs[0][name].weight, graphs[1][name].weight)
    np.testing.assert_array_equal(*map(bias_of, graphs))
    values = np.concatenate([moved.input_values[name] for name in moved.cell.inputs])
    x = moved.start_state
    drive = graphs[0]["synapses"].weight @ x + bias_of(graphs[0])
    drive += graphs[0]["input_weights"].weight @ values
    np.testing.assert_allclose(drive, moved.pack(evaluator(moved).drives(x)), atol=1e-12)


def test_what_is_not_linear_is_refused_by_name():
    network = ann_dc.synthesize(PLANTS.pendulum(N=2))
    names = [b.name for b in network.cell.blocks if not isinstance(b, Sum)]
    with pytest.raises(ExportError, match="linear nodes only") as error:
        nir_files(network, reference_vector(network))
    assert all(name in str(error.value) for name in names[:12])


def test_rails_are_refused_by_name():
    leak = Connection(source="x", target="x", weight=-1.0)
    neuron = Neuron(name="x", limiter=Limiter(low=0.0))
    cell = Cell(neurons=(neuron,), connections=(leak,))
    network = Network(cell=cell, stages=1, start={"x": 1.0})
    with pytest.raises(ExportError, match=r"x \(rails\)"):
        nir_files(network, reference_vector(network))


def test_a_long_row_is_refused():
    leak = Connection(source="x", target="x", weight=-1.0)
    network = Network(cell=Cell(neurons=(Neuron(name="x"),), connections=(leak,)), stages=5001)
    with pytest.raises(ExportError, match=r"5001 neurons.*fewer stages"):
        nir_files(network, reference_vector(network))


def test_what_was_changed_is_refused():
    network = chain()
    files = nir_files(network, reference_vector(network))
    other = nir_files(chain(shared=True), reference_vector(chain(shared=True)))
    content, notes = bytearray(files["network.nir"]), json.loads(files["nir.json"])
    content[len(content) // 2] ^= 1
    for changed in (
        {**files, "network.nir": bytes(content)},
        {**files, "network.nir": other["network.nir"]},
        {**files, "reference_vector.json": other["reference_vector.json"]},
        {**files, "nir.json": json.dumps(notes | {"schema": 2}).encode()},
        {**files, "nir.json": json.dumps(notes | {"places": [[[0, 99]]]}).encode()},
        {**files, "nir.json": json.dumps(notes | {"inputs": {}}).encode()},
        {name: content for name, content in files.items() if name != "network.nir"},
    ):
        with pytest.raises(FileFormatError):
            nir_check(changed)


@pytest.mark.parametrize("damage", ["noise", "another graph", "another size"])
def test_a_graph_that_is_none_of_ours_is_refused_whoever_hashed_it(damage, tmp_path):
    network = chain()
    files = nir_files(network, reference_vector(network))
    path = tmp_path / "other.nir"
    if damage == "noise":
        path.write_bytes(b"\x89HDF\r\n" + bytes(2000))
    else:
        node = nir.Linear(weight=np.eye(2)) if damage == "another graph" else nir.I(r=np.ones(7))
        nodes = graph_of(files, tmp_path).nodes | {"neurons": node}
        nir.write(path, nir.NIRGraph(nodes=nodes, edges=[("neurons", "output")], type_check=False))
    content = path.read_bytes()
    notes = json.loads(files["nir.json"]) | {"sha256": hashlib.sha256(content).hexdigest()}
    with pytest.raises(FileFormatError, match=r"network\.nir"):
        nir_check({**files, "network.nir": content, "nir.json": json.dumps(notes).encode()})


def large_table(file, folder):
    del file["node/nodes/synapses/weight"]
    file.create_dataset("node/nodes/synapses/weight", shape=(15000, 15000), dtype="f8")


def numbers_of_another_file(file, folder):
    (folder / "secret").write_bytes(np.arange(3.0).tobytes())
    outside = [(str(folder / "secret"), 0, 24)]
    del file["node/nodes/synapses/bias"]
    file.create_dataset("node/nodes/synapses/bias", shape=(3,), dtype="f8", external=outside)


def link_to_another_file(file, folder):
    del file["node/nodes/synapses/bias"]
    file["node/nodes/synapses/bias"] = h5py.ExternalLink(str(folder / "other.h5"), "x")


def link_to_itself(file, folder):
    file["node/nodes/synapses/again"] = file["node"]


def virtual_table(file, folder):
    layout = h5py.VirtualLayout(shape=(3,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "x", shape=(3,))
    del file["node/nodes/synapses/bias"]
    file.create_virtual_dataset("node/nodes/synapses/bias", layout)


def long_words(file, folder):
    del file["node/type"]
    file.create_dataset("node/type", shape=(), dtype="S1000000")


def packed_otherwise(file, folder):
    del file["node/nodes/synapses/bias"]
    file.create_dataset("node/nodes/synapses/bias", data=np.zeros(3), compression="lzf")


def chunk_that_grows(file, folder):
    packed = zlib.compress(bytes(20_000_000))
    file["node/nodes/synapses/bias"].id.write_direct_chunk((0,), packed)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (large_table, "does not fit the network"),
        (numbers_of_another_file, "are in another file"),
        (link_to_another_file, "is a link"),
        (link_to_itself, "does not occur in an exported network"),
        (virtual_table, "are in another file"),
        (long_words, "does not fit the network"),
        (packed_otherwise, "an unsupported compression"),
        (chunk_that_grows, "unpacks to more than its size"),
    ],
)
def test_what_is_in_no_graph_of_ours_is_not_read(change, said, tmp_path):
    files = nir_files(chain(), reference_vector(chain()))
    path = tmp_path / "network.nir"
    path.write_bytes(files["network.nir"])
    with h5py.File(path, "r+") as file:
        change(file, tmp_path)
    content = path.read_bytes()
    notes = json.loads(files["nir.json"]) | {"sha256": hashlib.sha256(content).hexdigest()}
    changed = {"network.nir": content, "nir.json": json.dumps(notes).encode()}
    tracemalloc.start()
    with pytest.raises(FileFormatError, match=rf"network\.nir: .*{said}"):
        nir_check(files | changed)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2_000_000
