"""Saved networks: what comes back is what went in, and nothing else is let in."""

import io
import json
import os
import pickle
import re
import zipfile
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from designs import coordinated, designed, near_start, small, wired_with
from hypothesis import given, settings, strategies as st
from problems import SUITE
from random_metrics import random_blocks

from ann_dc.backends import OdeBackend
from ann_dc.decomposition import SWITCHES
from ann_dc.errors import FileFormatError, OutputError
from ann_dc.evaluation import evaluator
from ann_dc.export.weights import MAX_MANIFEST, load, save
from ann_dc.network import (
    Absent,
    Cell,
    Connection,
    Limiter,
    Network,
    Neuron,
    Pin,
    Role,
    Sum,
    Template,
)
from ann_dc.network.metrics import Grid, Kind, Metric, Pyramid, TimeConstants, Tree
from ann_dc.solution import certificate_of


def parts(thing) -> dict | None:
    """What a record, a tuple or a mapping is made of; None of anything else."""
    if is_dataclass(thing):
        return {f".{f.name}": getattr(thing, f.name) for f in fields(thing)}
    if isinstance(thing, tuple):
        return {f"[{i}]": part for i, part in enumerate(thing)}
    return thing if isinstance(thing, dict) else None


def assert_same(a, b, place: str = "network") -> None:
    """Equal field by field, floats bit by bit, types included."""
    assert type(a) is type(b), place
    inside = parts(a)
    if inside is not None:
        others = parts(b) or {}
        assert inside.keys() == others.keys(), place
        for key, part in inside.items():
            assert_same(part, others[key], f"{place}{key}")
    elif isinstance(a, (float, np.ndarray)):
        p, q = np.asarray(a), np.asarray(b)
        assert (p.shape, p.dtype, p.tobytes()) == (q.shape, q.dtype, q.tobytes()), place
    else:
        assert a == b, place


@pytest.fixture
def path(tmp_path):
    return tmp_path / "network.npz"


def round_trip(network: Network, path) -> Network:
    save(network, path)
    return load(path)


NETWORKS = {
    "car": lambda: small("car"),
    "designed car": lambda: designed("car").network,
    "coordinated arm": lambda: coordinated("two_link_arm"),
    "closed chain": lambda: small("car", SWITCHES["S14"]),
    "car with a grid": lambda: wired_with("car", Kind.GRID),
    "car with a tree": lambda: wired_with("car", Kind.TREE),
    "coupled arm": lambda: wired_with("two_link_arm", Kind.COUPLED_PYRAMID),
    "terminal free": lambda: small("cstr", SWITCHES["S13"]),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_round_trip(name, path):
    network = NETWORKS[name]()
    loaded = round_trip(network, path)
    assert_same(network, loaded)
    x = near_start(network, 0, count=3)
    np.testing.assert_array_equal(evaluator(network).rhs(x), evaluator(loaded).rhs(x))
    np.testing.assert_array_equal(
        evaluator(network).jacobian(x[0]), evaluator(loaded).jacobian(x[0])
    )
    np.testing.assert_array_equal(network.start_state, loaded.start_state)
    assert str(network) == str(loaded)


PRINTABLE = st.characters(exclude_categories=["C", "Z"])
FINITE = st.floats(allow_nan=False, allow_infinity=False)
POSITIVE = st.floats(min_value=5e-324, max_value=1e300)


@st.composite
def metrics(draw, stages: int, primal: int) -> Metric:
    """Every kind; stiffnesses only where there is a primal neuron, and positive definite."""
    kinds = [TimeConstants, Pyramid, *([Grid, Tree] if primal else [])]
    kind = draw(st.sampled_from(kinds))
    if kind is TimeConstants:
        return TimeConstants()
    if kind is Pyramid:
        gain = draw(st.lists(FINITE, min_size=3, max_size=3))
        return Pyramid(gains=(np.reshape(gain, (3, 1, 1)),))
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
            unit=draw(POSITIVE),
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
        pins=(Pin(neuron=a, stage=0, input=drive),) if draw(st.booleans()) else (),
        absent=(Absent(neuron=b, stage=stages - 1),) if draw(st.booleans()) else (),
        left={b: drive, a: other} if draw(st.booleans()) else {},
        start={b: draw(each(FINITE))} if draw(st.booleans()) else {},
        metric=draw(metrics(stages, sum(neuron.role is Role.PRIMAL for neuron in neurons))),
        title=draw(st.text(st.characters(exclude_categories=["Cs"]))),
    )


@settings(max_examples=60, deadline=None)
@given(networks())
def test_round_trip_of_any_network(tmp_path_factory, network):
    path = tmp_path_factory.getbasetemp() / "any.npz"
    loaded = round_trip(network, path)
    assert_same(network, loaded)
    first = path.read_bytes()
    save(loaded, path)
    assert path.read_bytes() == first


OLD = Path(__file__).parent / "double_integrator.npz"
"""The double integrator, designed and saved by the first version that wrote schema 1."""


def test_a_file_of_an_earlier_version(path):
    """Files outlive the code: one from before loads, runs, and is the same when saved again."""
    network = load(OLD)
    problem = SUITE["double_integrator"].problem
    run = OdeBackend(verify=False).run(network)
    assert run.status.settled
    certificate = certificate_of(problem, network, run.trajectory.final)
    assert certificate.certified
    np.testing.assert_allclose(certificate.objective, 7.5188, rtol=1e-4)
    save(network, path)
    assert path.read_bytes() == OLD.read_bytes()


def test_arrays_are_named_and_never_pickled(path):
    network = designed("car").network
    save(network, path)
    with np.load(path, allow_pickle=False) as arrays:
        for connection in network.cell.connections:
            np.testing.assert_array_equal(arrays[f"weight/{connection.name}"], connection.weight)
        np.testing.assert_array_equal(arrays["tau/mu.phi"], network.neuron("mu.phi").tau)
        np.testing.assert_array_equal(arrays["input/q_d.x"], np.full(9, 5.0))
        np.testing.assert_array_equal(arrays["grid/own"], network.metric.own)
        manifest = json.loads(arrays["manifest"].tobytes())
        assert {arrays[name].dtype for name in arrays.files if name != "manifest"} == {
            np.dtype("<f8")
        }
    assert (manifest["schema"], manifest["stages"], manifest["title"]) == (1, 9, "car")


def test_same_network_same_bytes(path, monkeypatch):
    save(small("car"), path)
    first = path.read_bytes()
    monkeypatch.setattr("time.time", lambda: 2e9)
    again = replace(small("car"), start=dict(reversed(small("car").start.items())))
    save(again, path)
    assert path.read_bytes() == first


# ---- writing -----------------------------------------------------------------------------------


@pytest.mark.parametrize("place", ["missing/network.npz", "", "\0", "."])
def test_places_that_cannot_be_written(tmp_path, place, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match=r"cannot be written.*give a path in a folder"):
        save(small("car"), place)
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_no_file_can_hold(path):
    cell = Cell(neurons=(Neuron(name="x\0"),))
    with pytest.raises(OutputError, match="printable names only; rename the node"):
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


def entry(array, **options) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asarray(array), **options)
    return stream.getvalue()


def rewritten(path, change) -> None:
    """The file with its entries (name -> bytes) changed in place by ``change``."""
    with zipfile.ZipFile(path) as archive:
        entries = {
            info.filename.removesuffix(".npy"): archive.read(info) for info in archive.infolist()
        }
    change(entries)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in entries.items():
            archive.writestr(f"{name}.npy", data)


def with_manifest(change):
    """A change of entries from a change of the JSON table."""

    def changed(entries) -> None:
        table = json.loads(entries["manifest"][128:])
        table = change(table) or table
        text = table if isinstance(table, bytes) else json.dumps(table).encode()
        entries["manifest"] = entry(np.frombuffer(text, np.uint8))

    return changed


def setting(*keys_and_value):
    """Set one value deep inside the manifest."""
    *keys, last, value = keys_and_value

    def change(table) -> None:
        for key in keys:
            table = table[key]
        table[last] = value

    return with_manifest(change)


def put(name, data):
    return lambda entries: entries.__setitem__(name, data)


def drop(name):
    return lambda entries: entries.pop(name)


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was executed",))


STILL = "tau/q.x"
OBJECTS = entry(np.array([Bomb()], object), allow_pickle=True)
HUGE = entry(np.zeros(1)).replace(b"(1,), }             ", b"(99999999999999,), }")

HOSTILE = {
    "no manifest": (drop("manifest"), "entry 'manifest' is missing"),
    "missing weight": (drop("weight/mu.x<-c.x"), "entry 'weight/mu.x<-c.x' is missing"),
    "missing tau": (drop(STILL), "entry 'tau/q.x' is missing"),
    "missing input": (drop("input/q_d.x"), "entry 'input/q_d.x' is missing"),
    "extra entry": (put("tau/q.z", entry(1.0)), "unknown entries: tau/q.z"),
    "pickle": (put(STILL, OBJECTS), "entry 'tau/q.x' holds object values.*never unpickled"),
    "pickle beside": (put("evil", OBJECTS), "unknown entries: evil"),
    "bare pickle": (put(STILL, pickle.dumps(Bomb())), "'tau/q.x' is not a NumPy array"),
    "pickled manifest": (put("manifest", OBJECTS), "entry 'manifest' holds object values"),
    "wrong length": (put(STILL, entry(np.ones(3))), r"shape \(3,\), expected \(\) or \(4,\)"),
    "wrong rank": (put(STILL, entry(np.ones((4, 1)))), r"'tau/q.x' has shape \(4, 1\)"),
    "input of one number": (put("input/q_d.x", entry(1.0)), r"shape \(\), expected \(4,\)"),
    "integers": (put(STILL, entry(1)), "holds int64 values where float64 is expected"),
    "single precision": (put(STILL, entry(np.float32(1))), "holds float32 values"),
    "fortran order": (put("rails", entry(np.ones((18, 2), order="F"))), "'rails' holds float64"),
    "nan weight": (put("weight/mu.x<-c.x", entry(np.nan)), "mu.x<-c.x' holds a value that is not"),
    "infinite tau": (put(STILL, entry(np.inf)), "'tau/q.x' holds a value that is not finite"),
    "nan rail": (put("rails", entry(np.full((18, 2), np.nan))), "'rails' holds a value"),
    "zero tau": (put(STILL, entry(0.0)), "q.x: time constant 0.0 must be positive"),
    "claims terabytes": (put(STILL, HUGE), r"shape \(99999999999999,\)"),
    "cut short": (put("unit", entry(np.ones(18))[:-8]), r"'unit' has shape \(18,\)"),
    "empty entry": (put(STILL, b""), "'tau/q.x' is not a NumPy array"),
    "manifest is no text": (put("manifest", entry(np.full(9, 255, np.uint8))), "not UTF-8"),
    "manifest too large": (
        put("manifest", entry(np.zeros(MAX_MANIFEST + 1, np.uint8))),
        "'manifest' is larger than 10000000 bytes",
    ),
    "manifest is no JSON": (with_manifest(lambda _: b"{"), "manifest: not JSON"),
    "manifest nests deeply": (with_manifest(lambda _: b"[" * 100_000), "manifest: not JSON"),
    "manifest with NaN": (with_manifest(lambda _: b'{"a": NaN}'), "NaN is no JSON number"),
    "manifest with a huge number": (
        with_manifest(lambda _: b'{"stages": ' + b"9" * 5000 + b"}"),
        "manifest: not JSON",
    ),
    "manifest is a list": (with_manifest(lambda _: b"[]"), "does not say 'ann_dc network'"),
    "another format": (setting("format", "trackmania"), "does not say 'ann_dc network'"),
    "another schema": (setting("schema", 2), "schema: 2, but this ann_dc reads 1; load the file"),
    "no schema": (with_manifest(lambda t: t.pop("schema") and None), "schema: None, but"),
    "unknown key": (setting("colour", "red"), "manifest: unknown key colour"),
    "missing key": (with_manifest(lambda t: t.pop("pins") and None), "manifest.pins: missing"),
    "no stages": (setting("stages", 0), "manifest.stages: 0 is not in 1 .. 1000000"),
    "true stages": (setting("stages", True), "manifest.stages: expected int, got True"),
    "fractional stages": (setting("stages", 4.0), "manifest.stages: expected int, got 4.0"),
    "endless row": (setting("stages", 10**12), "manifest.stages: 1000000000000 is not in"),
    "other stages": (setting("stages", 5), "entry 'input/q_0.x' has shape|entry 'tau|entry 'input"),
    "unknown role": (setting("neurons", 0, "role", "king"), r"role: 'king' does not.*primal, dual"),
    "nameless neuron": (
        setting("neurons", 0, "name", 3),
        r"neurons\[0\].name: expected str, got 3",
    ),
    "neuron is a list": (setting("neurons", 0, []), r"neurons\[0\]: expected a table, got \[\]"),
    "neurons are no list": (setting("neurons", "all"), "manifest.neurons: expected list"),
    "two equal neurons": (setting("neurons", 1, "name", "q.x"), "entry 'tau/q.x' is missing"),
    "unknown block": (setting("blocks", 0, "kind", "laser"), "kind: 'laser' does not exist.*sum"),
    "block with a key": (setting("blocks", 0, "gain", "1"), r"blocks\[0\]: unknown key gain"),
    "unknown template": (setting("connections", 0, "template", "up"), "template: 'up' does not"),
    "unknown source": (setting("connections", 0, "source", "q.z"), "entry 'weight/.*<-q.z"),
    "unknown pin": (setting("pins", 0, "neuron", "q.z"), "no such neuron or stage"),
    "pin in words": (setting("pins", 0, "stage", "0"), r"pins\[0\].stage: expected int, got '0'"),
    "absent too far": (setting("absent", 0, "stage", 4), "no such neuron or stage"),
    "left of nothing": (setting("left", "t.x", "q_e.x"), "'q_e.x' is not an input"),
    "left of a number": (setting("left", "t.x", 1), r"manifest.left.t.x: expected str, got 1"),
    "lonely chain": (setting("chains", 0, ["q.x"]), r"chains: expected two neuron names, got"),
    "names in a tree": (setting("inputs", [["q_0.x"]]), "manifest.inputs: expected names only"),
    "name twice": (setting("start", ["q.x", "q.x"]), "manifest.start: a name occurs twice"),
    "unknown start": (setting("start", ["q.z"]), "entry 'start/q.z' is missing"),
    "levels of nothing": (setting("levels", 1), "entry 'gain/0' is missing"),
    "negative levels": (setting("levels", -1), "manifest.levels: -1 is not in 0 .. 64"),
    "title that is no text": (setting("title", None), "manifest.title: expected str, got None"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_content(case, path):
    change, message = HOSTILE[case]
    save(small("car"), path)
    rewritten(path, change)
    with pytest.raises(FileFormatError, match=message) as refusal:
        load(path)
    assert str(refusal.value).startswith(f"{path}: ")


def test_rewriting_alone_changes_nothing(path):
    save(small("car"), path)
    rewritten(path, lambda entries: None)
    assert_same(small("car"), load(path))


BAD_GAINS = {
    "not a square": np.ones((3, 4, 3)),
    "of another plant": np.ones((3, 2, 2)),
    "of no grid": np.ones((1, 4, 4)),
    "that are not finite": np.full((3, 4, 4), np.inf),
}


@pytest.mark.parametrize("case", BAD_GAINS)
def test_coordinators(case, path):
    save(coordinated("car"), path)
    level = len(coordinated("car").metric.gains) - 1
    rewritten(path, put(f"gain/{level}", entry(BAD_GAINS[case])))
    with pytest.raises(FileFormatError, match=r"gain|coordinators"):
        load(path)


def blocks(rows: int, size: int, value: float = 1.0) -> bytes:
    return entry(np.broadcast_to(np.diag(np.full(size, value)), (rows, size, size)))


BAD_STIFFNESSES = {
    "of no kind": (setting("metric", "lattice"), "metric: 'lattice' does not exist.*grid, tree"),
    "that is no name": (setting("metric", 3), "manifest.metric: expected str, got 3"),
    "of another kind": (setting("metric", "tree"), "entry 'tree/own' is missing"),
    "beside levels": (setting("levels", 1), "manifest.levels: 1 is not in 0 .. 0"),
    "without a name": (with_manifest(lambda t: t.pop("metric") and None), "unknown entries: grid/"),
    "missing": (drop("grid/own"), "entry 'grid/own' is missing"),
    "without neighbours": (drop("grid/following"), "entry 'grid/following' is missing"),
    "of another row": (put("grid/own", blocks(5, 10)), r"'grid/own' has shape \(5, 10, 10\)"),
    "of another cell": (put("grid/own", blocks(4, 9)), r"'grid/own' has shape \(4, 9, 9\)"),
    "of too many neighbours": (
        put("grid/following", blocks(4, 10)),
        r"shape \(4, 10, 10\), expected \(3, 10, 10\)",
    ),
    "not a number": (put("grid/own", blocks(4, 10, np.inf)), "'grid/own' holds a value that is"),
    "not symmetric": (
        put("grid/own", entry(np.eye(10) + 0.1 * np.eye(10, k=1) + np.zeros((4, 1, 1)))),
        "own: the stiffness within a cell must be symmetric",
    ),
    "negative": (put("grid/own", blocks(4, 10, -1.0)), "neighbour grid: .*not positive definite"),
    "coupled too strongly": (put("grid/following", blocks(3, 10, 9.0)), "not positive definite"),
}


@pytest.mark.parametrize("case", BAD_STIFFNESSES)
def test_stiffnesses(case, path):
    change, message = BAD_STIFFNESSES[case]
    save(wired_with("car", Kind.GRID), path)
    rewritten(path, change)
    with pytest.raises(FileFormatError, match=message) as refusal:
        load(path)
    assert str(refusal.value).startswith(f"{path}: ")


@pytest.mark.parametrize("place", ["missing.npz", "", "\0", "/dev/zero", "."])
def test_no_file(place):
    with pytest.raises(FileFormatError, match=r"give the path of a saved network \(.npz\)"):
        load(place)


@pytest.mark.parametrize("data", [b"", b"hello", b"PK\x03\x04", pickle.dumps(Bomb())])
def test_no_zip(path, data):
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match=re.escape(f"{path}: not a complete .npz file")):
        load(path)


def test_an_npz_of_something_else(path):
    np.savez(path, weights=np.ones(3))
    with pytest.raises(FileFormatError, match="entry 'manifest' is missing"):
        load(path)


def test_an_entry_twice(path):
    save(small("car"), path)
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr(f"{STILL}.npy", entry(2.0))
    with pytest.raises(FileFormatError, match="an entry occurs twice"):
        load(path)


def test_a_zip_bomb(path):
    save(small("car"), path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("evil.npy", bytes(10_000_000))
    with pytest.raises(FileFormatError, match="claim to be larger than the file"):
        load(path)


@pytest.fixture(scope="module")
def good_bytes(tmp_path_factory):
    path = tmp_path_factory.mktemp("good") / "car.npz"
    save(small("double_integrator"), path)
    return path.read_bytes()


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 0.9999))
def test_truncated_anywhere(tmp_path_factory, good_bytes, share):
    path = tmp_path_factory.getbasetemp() / "short.npz"
    path.write_bytes(good_bytes[: int(share * len(good_bytes))])
    with pytest.raises(FileFormatError, match=re.escape(str(path))):
        load(path)


@settings(max_examples=150, deadline=None)
@given(place=st.integers(0, 2**31), value=st.integers(1, 255))
def test_one_wrong_byte_anywhere(tmp_path_factory, good_bytes, place, value):
    path = tmp_path_factory.getbasetemp() / "wrong.npz"
    data = bytearray(good_bytes)
    data[place % len(data)] ^= value
    path.write_bytes(data)
    try:
        loaded = load(path)
    except FileFormatError:
        return
    # a byte that says nothing, such as the date of an entry
    assert_same(small("double_integrator"), loaded)


def test_manifest_holds_every_field():
    """A new field of a record must be saved too: this test fails until it is."""
    assert {f.name for f in fields(Network)} == {
        "cell", "stages", "inputs", "pins", "absent", "left", "start", "metric", "title",
    }  # fmt: skip
    assert {f.name for f in fields(Cell)} == {
        "neurons", "inputs", "blocks", "connections", "duals", "chains",
    }  # fmt: skip
    assert set(asdict(Neuron(name="x"))) == {"name", "tau", "role", "limiter", "unit"}
    assert set(asdict(Limiter())) == {"low", "high"}
    assert {f.name for f in fields(Connection)} == {"source", "target", "weight", "template"}
    assert {f.name for f in fields(Pyramid)} == {"gains"}
    assert {f.name for f in fields(Grid)} == {f.name for f in fields(Tree)} == {"own", "following"}
    assert not fields(TimeConstants)
