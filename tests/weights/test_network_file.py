"""Saved networks: what comes back is what went in, and nothing else is let in."""

import hashlib
import json
import os
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from constrained import CONSTRAINED
from designs import coordinated, designed, near_start, small, wired_with
from hypothesis import given, settings, strategies as st
from minimax import CASES, car
from network_files import assert_same
from problems import SUITE
from random_preconditioners import random_blocks

from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.decomposition.form import SWITCHES
from ann_dc.errors import OutputError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron, Role, Sum, Template
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner, PreconditionerKind
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid
from ann_dc.scale import Scale
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize
from ann_dc.weights.hashes import content_hash, wiring_hash
from ann_dc.weights.network_file import load, save


def round_trip(network: Network, path) -> Network:
    save(network, path)
    return load(path)


def far_wired() -> Network:
    car = small("car")
    far = (Connection(source="q.x", target="t.y", weight=0.1, template=k) for k in (-2, 3))
    return replace(car, cell=replace(car.cell, connections=(*car.cell.connections, *far)))


NETWORKS = {
    "far wires": lambda: far_wired(),
    "car": lambda: small("car"),
    "designed car": lambda: designed("car").network,
    "coordinated arm": lambda: coordinated("two_link_arm"),
    "closed chain": lambda: small("car", SWITCHES["S14"]),
    "car with a grid": lambda: wired_with("car", PreconditionerKind.RESISTIVE_GRID),
    "car with a tree": lambda: wired_with("car", PreconditionerKind.CYCLIC_REDUCTION),
    "coupled arm": lambda: wired_with("two_link_arm", PreconditionerKind.COUPLED_MULTILEVEL),
    "inequalities": lambda: synthesize(CONSTRAINED["lander"].problem),
    "objectives": lambda: synthesize(car(CASES["two by range"][0])),
    "a temperature": lambda: synthesize(car(CASES["two by range"][0], temperature=0.1)),
    "terminal free": lambda: small("cstr", SWITCHES["S13"]),
}


FORMS = (".npz", ".safetensors")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.sampled
def test_round_trip(name, form, path):
    network, path = NETWORKS[name](), path.with_suffix(form)
    loaded = round_trip(network, path)
    assert_same(network, loaded)
    x = near_start(network, 0, count=3)
    np.testing.assert_array_equal(evaluator(network).rhs(x), evaluator(loaded).rhs(x))
    np.testing.assert_array_equal(
        evaluator(network).jacobian(x[0]), evaluator(loaded).jacobian(x[0])
    )
    np.testing.assert_array_equal(network.start_state, loaded.start_state)
    assert str(network) == str(loaded)
    assert content_hash(network) == content_hash(loaded)
    fast, again = fast_evaluator(network), fast_evaluator(loaded)
    np.testing.assert_array_equal(fast.rhs(x[0]), again.rhs(x[0]))
    cell, other = CellLayer(network), CellLayer(loaded)
    assert torch.equal(cell(torch.as_tensor(x), step=0.1), other(torch.as_tensor(x), step=0.1))


@pytest.mark.parametrize("form", FORMS)
def test_a_run_is_the_same_to_the_last_bit(form, path):
    network, path = designed("double_integrator").network, path.with_suffix(form)
    loaded = round_trip(network, path)
    for backend in (OdeBackend(), RecurrentBackend()):
        one, other = (backend.run(given).trajectory for given in (network, loaded))
        np.testing.assert_array_equal(one.time, other.time)
        np.testing.assert_array_equal(one.states, other.states)


PRINTABLE = st.characters(exclude_categories=["C", "Z"])


FINITE = st.floats(allow_nan=False, allow_infinity=False)


POSITIVE = st.floats(min_value=5e-324, max_value=1e300)


@st.composite
def preconditioners(draw, stages: int, primal: int) -> Preconditioner:
    """Every kind; stiffnesses only where there is a primal neuron, and positive definite."""
    kinds = [Diagonal, Multilevel, *([ResistiveGrid, CyclicReduction] if primal else [])]
    kind = draw(st.sampled_from(kinds))
    if kind is Diagonal:
        return Diagonal()
    if kind is Multilevel:
        gain = draw(st.lists(st.floats(min_value=0, allow_infinity=False), min_size=3, max_size=3))
        return Multilevel(gains=(np.reshape(gain, (3, 1, 1)),))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    own, following = random_blocks(rng, stages, primal)
    return kind(own=own, following=following)


@st.composite
def networks(draw) -> Network:
    """Hand-wired networks with every kind of field."""
    stages = draw(st.integers(1, 4))

    def each(number):
        return st.one_of(number, st.lists(number, min_size=stages, max_size=stages).map(np.array))

    text = st.text(PRINTABLE, min_size=1, max_size=8)
    names = draw(st.lists(text, min_size=5, max_size=5, unique_by=lambda n: n.lower()))
    names = [f"{i}{name}" for i, name in enumerate(names)]
    a, b, drive, total, other = names
    neurons = tuple(
        Neuron(
            name=name,
            tau=draw(each(POSITIVE)),
            role=draw(st.sampled_from(Role)),
            limiter=Limiter(low=draw(st.sampled_from([-np.inf, -1.5])), high=draw(POSITIVE)),
            scale=Scale(draw(POSITIVE), draw(st.floats(-3, 3))),
        )
        for name in (a, b)
    )
    sources = st.sampled_from(["one", a, b, drive])
    wire = st.builds(
        Connection,
        source=sources,
        target=st.sampled_from([a, b, total]),
        weight=each(FINITE),
        template=st.sampled_from(Template),
    )
    wires = tuple(draw(st.lists(wire, max_size=6, unique_by=lambda w: w.name)))
    return Network(
        cell=Cell(
            neurons=neurons,
            inputs=(drive, other),
            blocks=(Sum(name=total),),
            connections=wires,
            chains=((a, b),),
        ),
        stages=stages,
        inputs={drive: draw(each(FINITE)), other: 0.0},
        fixed=(FixedNeuron(neuron=a, stage=0, input=drive),) if draw(st.booleans()) else (),
        omitted=(Omitted(neuron=b, stage=stages - 1),) if draw(st.booleans()) else (),
        left_boundary={b: drive, a: other} if draw(st.booleans()) else {},
        start={b: draw(each(FINITE))} if draw(st.booleans()) else {},
        preconditioner=draw(
            preconditioners(stages, sum(neuron.role is Role.PRIMAL for neuron in neurons))
        ),
        title=draw(st.text(st.characters(exclude_categories=["Cs"]))),
    )


@settings(max_examples=60, deadline=None)
@given(networks())
def test_round_trip_of_any_network(tmp_path_factory, network):
    for form in FORMS:
        path = tmp_path_factory.getbasetemp() / f"any{form}"
        loaded = round_trip(network, path)
        assert_same(network, loaded)
        first = path.read_bytes()
        save(loaded, path)
        assert path.read_bytes() == first


STORED = Path(__file__).parent / "double_integrator.npz"
"""The double integrator as the first version designed it; converted once to schema 3."""


def test_a_stored_file_runs_and_is_written_again_byte_for_byte(path):
    network = load(STORED)
    problem = SUITE["double_integrator"].problem
    run = OdeBackend(verify=False).run(network)
    assert run.status.settled
    certificate = certificate_of(problem, network, run.trajectory.final)
    assert certificate.certified
    np.testing.assert_allclose(certificate.objective, 7.5188, rtol=1e-4)
    save(network, path)
    assert path.read_bytes() == STORED.read_bytes()
    assert_same(network, load(path))


def test_arrays_are_named_and_never_pickled(path):
    network = designed("car").network
    save(network, path)
    with np.load(path, allow_pickle=False) as arrays:
        for connection in network.cell.connections:
            np.testing.assert_array_equal(arrays[f"weight/{connection.name}"], connection.weight)
        np.testing.assert_array_equal(arrays["tau/mu.phi"], network.neuron("mu.phi").tau)
        np.testing.assert_array_equal(arrays["input/q_d.x"], np.full(9, 5.0))
        np.testing.assert_array_equal(arrays["stiffness/own"], network.preconditioner.own)
        manifest = json.loads(arrays["manifest"].tobytes())
        assert {arrays[name].dtype for name in arrays.files if name != "manifest"} == {
            np.dtype("<f8")
        }
        assert manifest["tensors"].keys() == set(arrays.files) - {"manifest"}
    assert (manifest["schema"], manifest["stages"], manifest["title"]) == (3, 9, "car")


@pytest.mark.parametrize("form", FORMS)
def test_same_network_same_bytes(form, path, monkeypatch):
    path = path.with_suffix(form)
    save(small("car"), path)
    first = path.read_bytes()
    monkeypatch.setattr("time.time", lambda: 2e9)
    again = replace(small("car"), start=dict(reversed(small("car").start.items())))
    save(again, path)
    assert path.read_bytes() == first


def test_hashes_as_any_program_forms_them(path):
    """By the words of the module's docstring, and with nothing of ours."""
    network = designed("car").network
    save(network, path)
    with np.load(path, allow_pickle=False) as file:
        table = json.loads(file["manifest"].tobytes())
        arrays = {name: file[name] for name in sorted(file.files) if name != "manifest"}
    hashes = table.pop("hashes")
    whole = hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()
    for word in ("schema", "title", "about", "tensors"):
        del table[word]
    wiring = json.dumps(table, sort_keys=True).encode()
    content = hashlib.sha256(wiring)
    for name, values in arrays.items():
        content.update(json.dumps([name, values.shape]).encode() + values.tobytes())
    assert hashes == {
        "wiring": hashlib.sha256(wiring).hexdigest(),
        "content": content.hexdigest(),
        "manifest": whole,
    }
    assert hashes["wiring"] == wiring_hash(network)
    assert hashes["content"] == content_hash(network)


def test_the_manifest_tells_what_every_array_is(path):
    """To people who have no more than the file."""
    save(designed("car").network, path)
    with np.load(path, allow_pickle=False) as file:
        table = json.loads(file["manifest"].tobytes())
        for name, words in table["tensors"].items():
            assert len(words["axes"]) == file[name].ndim, name
            assert words["description"], name
            assert words["unit"], name
    assert table["tensors"]["tau/mu.x"]["description"] == "time constant of neuron mu.x"
    assert table["tensors"]["weight/m.x<-c.x"]["description"].endswith("rho of mu.x")
    assert table["tensors"]["input/q_d.x"] == {
        "description": "value of input q_d.x", "unit": "the user's", "axes": ["stage"],
    }  # fmt: skip
    assert "value of the source" in table["about"]


# ---- writing -----------------------------------------------------------------------------------


@pytest.mark.parametrize("place", ["missing/network.npz", "", "\0", "."])
def test_places_that_cannot_be_written(tmp_path, place, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        OutputError, match=r"cannot be written.*use a path in an existing, writable folder"
    ):
        save(small("car"), place)
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_no_file_can_hold(path):
    cell = Cell(neurons=(Neuron(name="x\0"),))
    with pytest.raises(OutputError, match="printable name; rename the node"):
        save(Network(cell=cell, stages=1), path)
    assert not path.exists()


def test_a_folder_in_the_way(tmp_path):
    (tmp_path / "network.npz").mkdir()
    with pytest.raises(OutputError):
        save(small("car"), tmp_path / "network.npz")
    assert [p.name for p in tmp_path.iterdir()] == ["network.npz"]


def test_a_good_file_survives_a_failed_write(path, monkeypatch):
    save(small("car"), path)
    good = path.read_bytes()

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left on device"):
        save(small("van_der_pol"), path)
    assert path.read_bytes() == good
    assert [p.name for p in path.parent.iterdir()] == [path.name]


# ---- hostile files -----------------------------------------------------------------------------


def test_manifest_holds_every_field():
    """A new field of a record must be saved too: this test fails until it is."""
    assert {f.name for f in fields(Network)} == {
        "cell", "stages", "inputs", "input_scales", "ranges", "fixed", "omitted", "left_boundary",
        "start", "preconditioner", "title", "waveforms",
    }  # fmt: skip
    assert {f.name for f in fields(Cell)} == {
        "neurons", "inputs", "blocks", "connections", "duals", "inequality_duals", "objectives",
        "chains",
    }  # fmt: skip
    assert set(asdict(Neuron(name="x"))) == {
        "name", "tau", "role", "limiter", "scale", "shared",
    }  # fmt: skip
    assert set(asdict(Limiter())) == {"low", "high"}
    assert {f.name for f in fields(Connection)} == {"source", "target", "weight", "template"}
    assert {f.name for f in fields(Multilevel)} == {"gains"}
    assert (
        {f.name for f in fields(ResistiveGrid)}
        == {f.name for f in fields(CyclicReduction)}
        == {"own", "following"}
    )
    assert not fields(Diagonal)


@pytest.mark.parametrize("form", FORMS)
def test_scale_with_negative_zero_is_written_as_zero(form, path):
    """Equal scales give equal bytes, of neurons and of inputs."""
    one, other = path.with_suffix(form), path.with_name(f"other{form}")
    for place, zero in ((one, 0.0), (other, -0.0)):
        scale = Scale(2.0, zero)
        network = Network(
            stages=1,
            cell=Cell(neurons=(Neuron(name="a", scale=scale),), inputs=("drive",)),
            inputs={"drive": 1.0},
            input_scales={"drive": scale},
        )
        assert_same(network, round_trip(network, place))
    assert one.read_bytes() == other.read_bytes()
