"""Integers of a network as JSON, from which a check recreates all other files.

The content of a file is never compiled or run. The golden model must reach the states in the file
with its integers, and the source text is recreated from them and compared byte for byte.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.export.fixed_point.golden import FixedPoint, Measured, Port
from ann_dc.export.fixed_point.machine import DRIVEN, WORD, Machine
from ann_dc.export.reference.sidecar import notes_of, vector_of
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.lowering.program import DRIVE, FUNCTION, PRODUCT, RECTIFY, SUMS, UPDATE
from ann_dc.scale import Scale

NAME = "fixed_point.json"
FORMAT = "ann_dc fixed point"
SCHEMA = 3
IDENTITY = ("title", "wiring", "content", "vector", "step", "prefix")
RESULTS = ("accuracy", "error", "reach", "limit")
"""Fields of a fixed-point network that are stored as they are."""
ARRAYS = {
    "operations": (-1, 6), "edges": (-1, 3), "tables": (-1, 4),
    "entries": (-1,), "words": (-1,), "neurons": (-1, 7),
}  # fmt: skip
"""Shapes of the arrays of a machine."""


def as_json(network: FixedPoint) -> bytes:
    """Serialise a fixed-point network; numbers are preserved exactly."""
    machine = network.machine
    table = {
        "format": FORMAT,
        "schema": SCHEMA,
        **{name: getattr(network, name) for name in IDENTITY},
        "ranges": {name: list(ends) for name, ends in network.ranges.items()},
        "measured": network.measured._asdict(),
        **{name: getattr(network, name) for name in RESULTS},
        "bits": machine.bits,
        "guard": machine.guard,
        "period": machine.period,
        "labels": list(network.labels),
        "inputs": [_port(port) for port in network.inputs],
        "controls": [_port(port) for port in network.controls],
        **{name: getattr(machine, name).tolist() for name in ARRAYS},
        "fraction": network.fraction.tolist(),
        "places": network.places.tolist(),
        "vectors": {str(count): states.tolist() for count, states in network.vectors.items()},
    }
    lines = [*_lines(table), f'"sha256": "{_digest(table)}"']
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in table.items()]


def _digest(table: Mapping[str, Any]) -> str:
    return hashlib.sha256("\n".join(_lines(table)).encode()).hexdigest()


def _port(port: Port) -> dict[str, Any]:
    return {
        "name": port.name,
        "words": port.words.tolist(),
        "factor": float(port.scale.factor),
        "offset": float(port.scale.offset),
    }


def _read(files: Mapping[str, bytes]) -> FixedPoint:
    """Parse the output of `as_json`, unless it was changed."""
    table = notes_of(files, NAME, FORMAT, SCHEMA).given
    given = {key: value for key, value in table.items() if key != "sha256"}
    whole = table.get("sha256") == _digest(given)
    _require(whole, NAME, "the file was changed; export the network again")
    arrays = {n: np.array(given[n], np.int64).reshape(shape) for n, shape in ARRAYS.items()}
    machine = Machine(given["bits"], given["guard"], given["period"], **arrays)
    _check_indices(machine)
    return FixedPoint(
        **{name: given[name] for name in IDENTITY + RESULTS},
        machine=machine,
        fraction=np.array(given["fraction"]),
        labels=tuple(given["labels"]),
        places=np.array(given["places"]),
        inputs=tuple(map(_read_port, given["inputs"])),
        controls=tuple(map(_read_port, given["controls"])),
        ranges={name: (low, high) for name, (low, high) in given["ranges"].items()},
        measured=Measured(**given["measured"]),
        vectors={int(count): np.array(states) for count, states in given["vectors"].items()},
    )


def _read_port(given: Mapping[str, Any]) -> Port:
    scale = Scale(factor=given["factor"], offset=given["offset"])
    return Port(name=given["name"], words=np.array(given["words"]), scale=scale)


def _check_indices(machine: Machine) -> None:
    """Check that a machine reads and writes only its arrays; its compiled code does not check."""
    kind, target, a, b, _, neuron = machine.operations.T
    low, high, shift, entry = machine.tables.T
    words, neurons = len(machine.words), len(machine.neurons)
    summed = np.isin(kind, SUMS)
    indices = (
        ("operations", target[kind != UPDATE], words),
        ("operations", target[kind == UPDATE], neurons),
        ("operations", neuron[(kind == DRIVE) | (kind == UPDATE)], neurons),
        ("operations", np.append(a[summed], b[summed]), len(machine.edges) + 1),
        ("operations", a[kind == PRODUCT], words),
        ("operations", a[kind == FUNCTION], len(machine.tables)),
        ("operations", b[np.isin(kind, (PRODUCT, FUNCTION, RECTIFY))], words),
        ("operations", kind, UPDATE + 1),
        ("edges", machine.edges[:, 0], words),
        ("tables", shift, 64),
        ("tables", np.append(entry, entry + ((high - low) >> shift) + 1), len(machine.entries)),
        ("neurons", machine.neurons[:, [WORD, DRIVEN]], words),
    )
    for place, found, count in indices:
        inside = bool(((found >= 0) & (found < count)).all())
        _require(inside, place, f"an index is not in 0 .. {count - 1}")


def _require(holds: bool, place: str, why: str) -> None:
    if not holds:
        raise FileFormatError(f"{place}: {why}")


def check(files: Mapping[str, bytes], written: Callable[[FixedPoint], Mapping[str, bytes]]) -> str:
    """Check exported files: execute their integers and compare with rewritten files.

    The function ``written`` returns all files except the test vector. Raises `FileFormatError` if
    a file is missing or differs, or the integers do not reach their vectors.
    """
    network, vector = _read(files), vector_of(files)
    same = hashlib.sha256(files[VECTOR]).hexdigest() == network.vector
    _require(same, VECTOR, f"differs from the network of {NAME}; export the network again")
    _check_controls(network, vector)
    for count, states in network.vectors.items():
        why = f"the states after {count} integer steps differ from the stored ones"
        _require(np.array_equal(network.states_after(count), states), NAME, why)
    anew = {**written(network), VECTOR: files[VECTOR]}
    for name in sorted({*files, *anew}):
        _require(name in anew, name, "is not part of this export")
        _require(name in files, name, "missing")
        _require(files[name] == anew[name], name, f"differs from {NAME}; export the network again")
    return (
        f"{network.steps} steps of the golden model in words of {network.bits} bits, equal to the "
        f"last bit; controls within {network.error:.1e} of the largest; {network.worth}"
    )


def _check_controls(network: FixedPoint, vector: ReferenceVector) -> None:
    """Check that the control error at the end of the vector is not above that in the file."""
    found = network.control_error(network.vectors[network.steps], vector)
    says = f"the controls are {found:.1e} of the largest away from the reference vector"
    _require(found <= network.error, NAME, f"{says}, not {network.error:.1e}")
