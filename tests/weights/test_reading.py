"""Hostile manifests and arrays: every one is refused, and told."""

import gc
import json
import pickle
import time

import numpy as np
import pytest
from designs import coordinated, small, wired_with
from network_files import (
    HUGE,
    OBJECTS,
    STILL,
    Bomb,
    assert_same,
    drop,
    entry,
    put,
    rewritten,
    setting,
    with_manifest,
)

from ann_dc.errors import FileFormatError, OutputError
from ann_dc.network.cell import Cell, Neuron
from ann_dc.network.ends import Omitted
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.weights.network_file import load, save
from ann_dc.weights.reading import MAX_MANIFEST

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
    "fortran order": (put("limits", entry(np.ones((18, 2), order="F"))), "'limits' holds float64"),
    "nan weight": (put("weight/mu.x<-c.x", entry(np.nan)), "mu.x<-c.x' holds a value that is not"),
    "infinite tau": (put(STILL, entry(np.inf)), "'tau/q.x' holds a value that is not finite"),
    "nan rail": (put("limits", entry(np.full((18, 2), np.nan))), "'limits' holds a value"),
    "zero tau": (put(STILL, entry(0.0)), "q.x: time constant 0.0 must be positive"),
    "claims terabytes": (put(STILL, HUGE), r"shape \(99999999999999,\)"),
    "cut short": (
        put("scale_factor", entry(np.ones(18))[:-8]),
        r"'scale_factor' has shape \(18,\)",
    ),
    "empty entry": (put(STILL, b""), "'tau/q.x' is not a NumPy array"),
    "manifest is no text": (put("manifest", entry(np.full(9, 255, np.uint8))), "not UTF-8"),
    "manifest too large": (
        put("manifest", entry(np.zeros(MAX_MANIFEST + 1, np.uint8))),
        "'manifest' is larger than 2000000 bytes",
    ),
    "manifest is not a JSON": (with_manifest(lambda _: b"{"), "manifest: not JSON"),
    "manifest nests deeply": (with_manifest(lambda _: b"[" * 100_000), "manifest: not JSON"),
    "manifest with NaN": (with_manifest(lambda _: b'{"a": NaN}'), "NaN is not a JSON number"),
    "manifest with a huge number": (
        with_manifest(lambda _: b'{"stages": ' + b"9" * 5000 + b"}"),
        "manifest: not JSON",
    ),
    "manifest is a list": (with_manifest(lambda _: b"[]"), "does not contain 'ann_dc network'"),
    "another format": (setting("format", "trackmania"), "does not contain 'ann_dc network'"),
    "another schema": (setting("schema", 4), "schema: expected 3, got 4; load the file with the"),
    "a true schema": (setting("schema", True), "schema: expected 3, got True"),
    "a broken schema": (setting("schema", 3.0), r"schema: expected 3, got 3\.0"),
    "a key twice": (
        with_manifest(lambda t: json.dumps(t).replace("{", '{"stages": 4, ', 1).encode()),
        "manifest: not JSON: key 'stages' occurs twice in a table",
    ),
    "a number changed": (put(STILL, entry(2.0)), "manifest.hashes.content: the file was changed"),
    "another title": (setting("title", "cab"), "manifest.hashes.manifest: the file was changed"),
    "a hash less": (
        with_manifest(lambda t: t["hashes"].pop("wiring") and None),
        "manifest.hashes.wiring: missing",
    ),
    "no hashes": (with_manifest(lambda t: t.pop("hashes") and None), "manifest.hashes: missing"),
    "a word for no array": (setting("tensors", "tau/q.z", {}), "differ in tau/q.z"),
    "an older schema": (
        setting("schema", 2),
        "schema: expected 3, got 2; load the file with the version",
    ),
    "a schema before the first": (setting("schema", 0), "schema: expected 3, got 0"),
    "no schema": (
        with_manifest(lambda t: t.pop("schema") and None),
        "schema: expected 3, got None",
    ),
    "unknown key": (setting("colour", "red"), "manifest: unknown key colour"),
    "missing key": (with_manifest(lambda t: t.pop("fixed") and None), "manifest.fixed: missing"),
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
    "near template": (setting("connections", 0, "template", -1), "template: expected a name"),
    "endless template": (setting("connections", 0, "template", 10**7), "template: 10000000 is not"),
    "true template": (setting("connections", 0, "template", True), "template: expected str"),
    "unknown source": (setting("connections", 0, "source", "q.z"), "entry 'weight/.*<-q.z"),
    "unknown pin": (setting("fixed", 0, "neuron", "q.z"), "no such neuron or stage"),
    "pin in words": (setting("fixed", 0, "stage", "0"), r"fixed\[0\].stage: expected int, got '0'"),
    "absent too far": (setting("omitted", 0, "stage", 4), "no such neuron or stage"),
    "left of nothing": (setting("left_boundary", "t.x", "q_e.x"), "'q_e.x' is not an input"),
    "left of a number": (
        setting("left_boundary", "t.x", 1),
        r"manifest.left_boundary.t.x: expected str, got 1",
    ),
    "lonely chain": (setting("chains", 0, ["q.x"]), r"chains: expected two neuron names, got"),
    "names in a tree": (setting("inputs", [["q_0.x"]]), "manifest.inputs: expected names only"),
    "name twice": (setting("start", ["q.x", "q.x"]), "manifest.start: a name occurs twice"),
    "unknown start": (setting("start", ["q.z"]), "entry 'start/q.z' is missing"),
    "levels of nothing": (setting("preconditioner", "levels", 1), "levels: 1 is not in 0 .. 0"),
    "negative levels": (setting("preconditioner", "levels", -1), "levels: -1 is not in 0 .. 0"),
    "title that is no text": (setting("title", None), "manifest.title: expected str, got None"),
}


@pytest.mark.sampled(24)
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


HEADERS = {
    "open brackets": b"{'descr': '<f8', 'fortran_order': False, 'shape': ((((",
    "an open text": b"{'descr': '''",
    "Python": b"__import__('os').abort()",
    "many brackets": b"(" * 60_000,
    "odd indents": b"  1\n 2\n\t3",
    "an endless number": b"{'descr': '<f8', 'fortran_order': False, 'shape': ("
    + b"9" * 5_000
    + b",), }",
    "a list of fields": b"{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (1,), }\n",
}


@pytest.mark.parametrize("case", HEADERS)
def test_headers_are_not_read_as_python(case, path):
    header = HEADERS[case]
    save(small("car"), path)
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    rewritten(path, put(STILL, content))
    with pytest.raises(
        FileFormatError, match=r"'tau/q.x' is not a NumPy array as `save` writes it"
    ):
        load(path)


def seconds_to_load(path, count: int) -> float:
    """CPU time of loading a network with so many omitted neurons; the smallest of three."""
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")))
    omitted = tuple(Omitted(neuron="y", stage=stage) for stage in range(count))
    save(Network(cell=cell, stages=60_000, omitted=omitted), path)
    times = []
    for _ in range(3):
        start = time.thread_time()
        loaded = load(path)
        times.append(time.thread_time() - start)
        assert loaded.size == 120_000 - count
    return min(times)


def test_loading_time_is_proportional_to_the_omitted_neurons(path):
    """A comparison of all pairs would take 16 times as long for 4 times as many."""
    gc.disable()  # a collection takes as long as the objects of all earlier tests are many
    try:
        assert seconds_to_load(path, 50_000) < 9 * seconds_to_load(path, 12_500)
    finally:
        gc.enable()


def test_a_manifest_that_would_not_be_read_again(path):
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")))
    absent = tuple(Omitted(neuron="y", stage=stage) for stage in range(90_000))
    with pytest.raises(OutputError, match=r"take \d+ bytes, a file may have 2000000; use shorter"):
        save(Network(cell=cell, stages=100_000, omitted=absent), path)
    assert not path.exists()


BAD_GAINS = {
    "not a square": np.ones((3, 4, 3)),
    "of another plant": np.ones((3, 2, 2)),
    "of no grid": np.ones((1, 4, 4)),
    "that are not finite": np.full((3, 4, 4), np.inf),
    "that are negative": -np.ones((3, 4, 4)),
}


@pytest.mark.parametrize("case", BAD_GAINS)
def test_coordinators(case, path):
    save(coordinated("car"), path)
    level = len(coordinated("car").preconditioner.gains) - 1
    rewritten(path, put(f"gain/{level}", entry(BAD_GAINS[case])))
    with pytest.raises(FileFormatError, match=r"gain|coordinators"):
        load(path)


def blocks(rows: int, size: int, value: float = 1.0) -> bytes:
    return entry(np.broadcast_to(np.diag(np.full(size, value)), (rows, size, size)))


BAD_STIFFNESSES = {
    "of no kind": (
        setting("preconditioner", "kind", "lattice"),
        "preconditioner.kind: 'lattice' does not exist.*resistive grid",
    ),
    "that is no table": (setting("preconditioner", 3), "manifest.preconditioner: expected dict"),
    "of another kind": (
        setting("preconditioner", "kind", "diagonal"),
        "unknown entries: stiffness/",
    ),
    "of another realisation": (
        setting("preconditioner", "kind", "cyclic reduction"),
        "manifest.hashes",
    ),
    "with coarse levels": (setting("preconditioner", "levels", 1), "levels: 1 is not in 0 .. 0"),
    "without a kind": (
        with_manifest(lambda t: t["preconditioner"].pop("kind") and None),
        "manifest.preconditioner.kind: missing",
    ),
    "missing": (drop("stiffness/own"), "entry 'stiffness/own' is missing"),
    "without neighbours": (drop("stiffness/following"), "entry 'stiffness/following' is missing"),
    "of another row": (
        put("stiffness/own", blocks(5, 10)),
        r"'stiffness/own' has shape \(5, 10, 10\)",
    ),
    "of another cell": (
        put("stiffness/own", blocks(4, 9)),
        r"'stiffness/own' has shape \(4, 9, 9\)",
    ),
    "of too many neighbours": (
        put("stiffness/following", blocks(4, 10)),
        r"shape \(4, 10, 10\), expected \(3, 10, 10\)",
    ),
    "not a number": (
        put("stiffness/own", blocks(4, 10, np.inf)),
        "'stiffness/own' holds a value that is",
    ),
    "not symmetric": (
        put("stiffness/own", entry(np.eye(10) + 0.1 * np.eye(10, k=1) + np.zeros((4, 1, 1)))),
        "own: the stiffness within a cell must be symmetric",
    ),
    "negative": (
        put("stiffness/own", blocks(4, 10, -1.0)),
        "resistive grid: .*not positive definite",
    ),
    "coupled too strongly": (
        put("stiffness/following", blocks(3, 10, 9.0)),
        "not positive definite",
    ),
}


@pytest.mark.parametrize("case", BAD_STIFFNESSES)
def test_stiffnesses(case, path):
    change, message = BAD_STIFFNESSES[case]
    save(wired_with("car", PreconditionerKind.RESISTIVE_GRID), path)
    rewritten(path, change)
    with pytest.raises(FileFormatError, match=message) as refusal:
        load(path)
    assert str(refusal.value).startswith(f"{path}: ")
