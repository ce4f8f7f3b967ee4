"""Integers of a network as JSON, from which a check recreates all other files.

The content of a file is never compiled or run. The integers are read strictly, the golden model
must reach the states in the file with them, and the source text is recreated from them and compared
byte for byte.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping

import numpy as np

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.fixed_point.formats import WIDEST
from ann_dc.export.fixed_point.golden import FEWEST, MOST, FixedPoint, Measured, Port
from ann_dc.export.fixed_point.integer_entries import NAME, integers, require, within
from ann_dc.export.fixed_point.machine import DRIVEN, HIGH, LOW, WORD, Machine
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.lowering.program import DRIVE, FUNCTION, PRODUCT, RECTIFY, SUM, UPDATE
from ann_dc.scale import Scale
from ann_dc.weights.manifest import Table, read_manifest

FORMAT = "ann_dc fixed point"
SCHEMA = 2
VECTOR = "reference_vector.json"
WORK = 2_000_000_000
"""Maximum number of operations and edges in all steps of a check."""
LONGEST = 50_000
"""Maximum number of steps."""
MOST_VECTORS = 3


def as_json(network: FixedPoint) -> bytes:
    """Serialise a fixed-point network; numbers are preserved exactly."""
    machine = network.machine
    arrays = {
        "operations": machine.operations,
        "edges": machine.edges,
        "tables": machine.tables,
        "entries": machine.entries,
        "words": machine.words,
        "neurons": machine.neurons,
        "fraction": network.fraction,
        "places": network.places,
    }
    table = {
        "format": FORMAT,
        "schema": SCHEMA,
        "title": network.title,
        "wiring": network.wiring,
        "content": network.content,
        "vector": network.vector,
        "step": network.step,
        "prefix": network.prefix,
        "ranges": {name: list(ends) for name, ends in network.ranges.items()},
        "measured": network.measured._asdict(),
        "accuracy": network.accuracy,
        "error": network.error,
        "limit": network.limit,
        "bits": machine.bits,
        "guard": machine.guard,
        "period": machine.period,
        "labels": list(network.labels),
        "inputs": [_port(port) for port in network.inputs],
        "controls": [_port(port) for port in network.controls],
        **{name: array.tolist() for name, array in arrays.items()},
        "vectors": {str(count): states.tolist() for count, states in network.vectors.items()},
    }
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in table.items()]
    digest = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    lines.append(f'"sha256": "{digest}"')
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def _port(port: Port) -> dict:
    return {
        "name": port.name,
        "words": port.words.tolist(),
        "factor": float(port.scale.factor),
        "offset": float(port.scale.offset),
    }


def from_json(text: bytes) -> FixedPoint:
    """Parse the output of `as_json` as an executable machine.

    Raises `FileFormatError` that names the invalid entry.
    """
    try:
        table = read_manifest(text.decode("utf-8"), FORMAT, SCHEMA)
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{NAME}: not UTF-8 text: {error}") from error
    machine = _machine(table)
    vectors = Table(f"{NAME}: vectors", table.get("vectors", dict))
    counts = {_steps(name): name for name in table.get("vectors", dict)}
    require(0 < len(counts) <= MOST_VECTORS, "vectors", f"expected 1 to {MOST_VECTORS}")
    require(
        max(counts) * (len(machine.operations) + len(machine.edges)) <= WORK,
        "vectors",
        "that many steps take too long to be walked again",
    )
    words, neurons = len(machine.words), len(machine.neurons)
    inputs = tuple(_read_port(row, words) for row in table.rows("inputs"))
    require(len({len(port.words) for port in inputs}) <= 1, "inputs", "expected as many words each")
    fraction = integers(table, "fraction", 0, (-1100, 1100))
    require(len(fraction) == words, "fraction", f"expected one a word, {words}")
    found = FixedPoint(
        title=table.get("title", str),
        wiring=table.get("wiring", str),
        content=table.get("content", str),
        vector=table.get("vector", str),
        step=table.get("step", float),
        machine=machine,
        fraction=fraction,
        labels=_names(table, "labels", neurons),
        places=integers(table, "places", 2, (0, 2**31)),
        inputs=inputs,
        controls=tuple(_control(row, machine) for row in table.rows("controls")),
        ranges=_ranges(table, [port.name for port in inputs]),
        measured=_measured(table),
        accuracy=table.get("accuracy", float),
        error=table.get("error", float),
        limit=table.whole("limit", 1, 2**31 - 1),
        vectors={count: _states(vectors, name, neurons) for count, name in counts.items()},
    )
    try:
        return found.named(table.get("prefix", str))
    except ExportError as error:
        raise FileFormatError(f"{NAME}: {error}") from error


def _ranges(table: Table, inputs: list[str]) -> dict[str, tuple[float, float]]:
    """Read the ranges of the machine's inputs."""
    given = Table(f"{NAME}: ranges", table.get("ranges", dict))
    found = {}
    for name in given.given:
        require(name in inputs, given.place, f"there is no input {name!r:.40}")
        ends = given.get(name, list)
        numbers = len(ends) == 2 and all(type(end) in (int, float) for end in ends)
        require(
            numbers and abs(ends[0]) < np.inf and abs(ends[1]) < np.inf,
            given.place,
            "expected two finite numbers",
        )
        found[name] = float(ends[0]), float(ends[1])
    return found


def _measured(table: Table) -> Measured:
    """Read counts; right, wrong and unconfirmed answers add up to the settled answers."""
    given = Table(f"{NAME}: measured", table.get("measured", dict))
    require(set(given.given) == set(Measured._fields), given.place, "expected its counts alone")
    found = Measured(*(given.whole(name, 0, 10**6) for name in Measured._fields))
    counted = found.right + found.wrong + found.unconfirmed
    fits = counted == found.settled <= found.inputs - found.saturated
    require(fits and found.floats <= found.inputs, given.place, "counts contradict each other")
    return found


def check(files: Mapping[str, bytes], written: Callable[[FixedPoint], Mapping[str, bytes]]) -> str:
    """Check exported files: execute their integers and compare with rewritten files.

    The function ``written`` returns all files except the test vector. Returns the result as a
    sentence. Raises `FileFormatError` if a file is missing, differs from its integers, or the
    integers do not reach their vectors.
    """
    for name in (NAME, VECTOR):
        require(name in files, name, "missing")
    network, vector = from_json(files[NAME]), ReferenceVector.from_json(files[VECTOR])
    same = hashlib.sha256(files[VECTOR]).hexdigest() == network.vector
    same &= (network.wiring, network.content) == (vector.wiring, vector.content)
    same &= network.step > 0 and vector.step / network.step in (1.0, 2.0, 4.0, 8.0)
    require(same, VECTOR, f"is another one than {NAME} was made with; export it again")
    _check_controls(network, vector)
    for count, states in network.vectors.items():
        walked = np.array_equal(network.states_after(count), states)
        require(walked, NAME, f"its integers walk to other states after {count} steps than it says")
    anew = {**written(network), VECTOR: files[VECTOR]}
    for name in sorted({*files, *anew}):
        require(name in anew, name, "is no part of this export")
        require(name in files, name, "missing")
        require(files[name] == anew[name], name, f"is not what {NAME} says; export it again")
    return (
        f"{network.steps} steps of the golden model in words of {network.bits} bits, equal to the "
        f"last bit; controls within {network.error:.1e} of the largest; {network.worth}"
    )


def _check_controls(network: FixedPoint, vector: ReferenceVector) -> None:
    """Check that the final control error does not exceed the error in the file.

    The reference is the end of the test vector.
    """
    inside = (network.places < vector.end.shape).all() and len(network.places) == len(
        network.labels
    )
    require(bool(inside), VECTOR, f"has no place for the neurons of {NAME}")
    found = network.control_error(network.vectors[network.steps], vector)
    says = f"the controls are {found:.1e} of the largest away from the reference vector"
    require(found <= network.error, NAME, f"{says}, not {network.error:.1e}")


# ---- what integers have to be --------------------------------------------------------------------


def _machine(table: Table) -> Machine:
    bits = table.whole("bits", FEWEST, MOST)
    guard = table.whole("guard", 0, WIDEST - bits)
    top = 2 ** (bits + guard - 1)
    word, state = (-top, top - 1), (-(2**62), 2**62)
    machine = Machine(
        bits=bits,
        guard=guard,
        period=table.whole("period", 1, LONGEST),
        operations=integers(table, "operations", 6, state),
        edges=integers(table, "edges", 3, (min(word[0], 0), 2**31)),
        tables=integers(table, "tables", 4, (-(2**31), 2**31)),
        entries=integers(table, "entries", 0, word),
        words=integers(table, "words", 0, word),
        neurons=integers(table, "neurons", 7, (-(2**31), 2**31)),
    )
    words = len(machine.words)
    within("neurons", machine.neurons[:, WORD], words)
    within("neurons", machine.neurons[:, DRIVEN], words)
    require(
        bool((np.abs(machine.neurons[:, [LOW, HIGH]]) <= top).all()), "neurons", "a rail is no word"
    )
    exponents = (machine.edges[:, 2] >= 0) & (machine.edges[:, 2] < 62 - bits)
    require(bool(exponents.all()), "edges", "an exponent is not in its range")
    require(
        bool((np.abs(machine.edges[:, 1]) <= 2 ** (bits - 1)).all()),
        "edges",
        "a coefficient has too many bits",
    )
    within("edges", machine.edges[:, 0], words)
    _check_tables(machine)
    _check_operations(machine)
    return machine


def _check_tables(machine: Machine) -> None:
    low, high, shift, first = machine.tables.T
    require(bool((low < high).all()), "tables", "a domain is empty")
    require(bool(((shift >= 0) & (shift <= 28)).all()), "tables", "a shift is not in 0 .. 28")
    last = first + ((high - low) >> np.clip(shift, 0, 28)) + 1
    within("tables", first, len(machine.entries))
    within("tables", last, len(machine.entries))


def _check_operations(machine: Machine) -> None:
    kind, target, a, b, shift, neuron = machine.operations.T
    words, neurons = len(machine.words), len(machine.neurons)
    within("operations", kind, UPDATE + 1)
    within("operations", target[kind != UPDATE], words)
    within("operations", target[kind == UPDATE], neurons)
    within("operations", neuron[(kind == DRIVE) | (kind == UPDATE)], neurons)
    require(bool((np.abs(shift) < 62).all()), "operations", "a shift is not in -61 .. 61")
    sums = np.isin(kind, (SUM, DRIVE, UPDATE))
    spans = np.concatenate([[0], b[sums]])
    require(np.array_equal(spans[:-1], a[sums]), "operations", "sums do not follow each other")
    forward = bool((np.diff(spans) >= 0).all()) and spans[-1] == len(machine.edges)
    require(forward, "operations", "sums do not read all edges in turn")
    within("operations", a[kind == PRODUCT], words)
    within("operations", a[kind == FUNCTION], len(machine.tables))
    within("operations", b[np.isin(kind, (PRODUCT, FUNCTION, RECTIFY))], words)


def _states(vectors: Table, name: str, neurons: int) -> np.ndarray:
    states = integers(vectors, name, 0, (-(2**62), 2**62))
    require(len(states) == neurons, f"{NAME}: vectors", f"expected {neurons} states")
    return states


def _steps(text: str) -> int:
    digits = text.isascii() and text.isdigit() and len(text) <= 6 and str(int(text)) == text
    require(digits and int(text) <= LONGEST, f"{NAME}: vectors", f"{text!r:.40} is no step count")
    return int(text)


def _names(table: Table, key: str, count: int) -> tuple[str, ...]:
    names = table.names(key)
    require(len(names) == count, f"{NAME}: {key}", f"expected {count} names")
    return names


def _control(row: Table, machine: Machine) -> Port:
    port = _read_port(row, len(machine.words))
    require(int(port.words[0]) in machine.neurons[:, WORD], row.place, "is no neuron")
    return port


def _read_port(row: Table, words: int) -> Port:
    own = integers(row, "words", 0, (0, words - 1))
    require(len(own) > 0, row.place, "expected a word at least")
    scale = Scale(factor=row.get("factor", float), offset=row.get("offset", float))
    return Port(name=row.get("name", str), words=own, scale=scale)
