"""SystemVerilog export: one multiplier executes the operations in sequence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import accumulate

import numpy as np

from ann_dc.export.fixed_point.golden import PREFIX, FixedPoint, Port
from ann_dc.export.fixed_point.machine import Machine
from ann_dc.export.fixed_point.manifest import NAME, as_json, check
from ann_dc.export.fixed_point.printing import plain, written
from ann_dc.export.fixed_point.widths import Bits, fixed_point
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.lowering.program import DRIVE, FUNCTION, PRODUCT, SUM, UPDATE
from ann_dc.network.network import Network
from ann_dc.validation import PositiveFinite, checked

TEXTS = ("ann_dc_network.sv", "testbench.sv", "Makefile", "README.md")
CLOCKS = {PRODUCT: 7, FUNCTION: 9}
"""Clock cycles of an operation; other operations take one more cycle per edge."""
OTHERS = 7
SPARE = 2
"""Additional accumulator bits beyond the largest possible number."""

Field = tuple[np.ndarray, int]
"""Integers, and the number of bits of each in a memory."""


@checked
def hdl_files(
    network: Network,
    vector: ReferenceVector,
    *,
    bits: Bits = 0,
    accuracy: PositiveFinite = 1e-3,
    over: str = "",
    prefix: str = PREFIX,
) -> dict[str, bytes]:
    """Export a network as synthesizable SystemVerilog with a testbench.

    Returns design, testbench, memories, Makefile, README, and the integers as JSON; the names of
    the design file and module begin with ``prefix``. The other options and errors are those of
    `fixed_point`. Raises `ExportError` if the prefix is not an identifier.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> files = hdl_files(network, reference_vector(network), bits=16)
    >>> [name for name in sorted(files) if name.endswith(".sv")]
    ['ann_dc_network.sv', 'testbench.sv']
    """
    found = fixed_point(network, vector, bits=bits, accuracy=accuracy, over=over)
    return {**_written(found.named(prefix)), VECTOR: vector.as_json()}


@checked
def hdl_check(files: Mapping[str, bytes]) -> str:
    """Check SystemVerilog files by their integers, without compiling or running them."""
    return check(files, _written)


def _written(network: FixedPoint) -> dict[str, bytes]:
    """Return all files except the test vector."""
    machine, sizes = network.machine, _sizes(network.machine)
    values = {
        **sizes,
        "accumulator": _accumulator(machine),
        "clocks": sum(CLOCKS.get(kind, OTHERS) for kind in machine.operations[:, 0].tolist())
        + len(machine.edges),
        "input_words": _places(network.inputs),
        "control_words": _places(network.controls),
    }
    texts = written("hdl", network, TEXTS, values)
    return {**texts, **_memories(network, sizes), NAME: as_json(network)}


def _sizes(machine: Machine) -> dict[str, int]:
    """Return the numbers of rows of the memories, and of the bits of their addresses."""
    words, neurons = len(machine.words), len(machine.neurons)
    edges, tables = max(len(machine.edges), 1), max(len(machine.tables), 1)
    entries = max(len(machine.entries), 1)
    at = {
        "word_at": _address_bits(words),
        "edge_at": edges.bit_length(),  # also one beyond the last edge
        "table_at": _address_bits(tables),
    }
    return {
        **at,
        "any_at": max(at.values()),
        "neuron_at": _address_bits(neurons),
        "operation_at": _address_bits(len(machine.operations)),
        "entry_at": _address_bits(entries),
        "edges": edges,
        "tables": tables,
        "entries": entries,
    }


def _address_bits(count: int) -> int:
    return (count - 1).bit_length() or 1


def _accumulator(machine: Machine) -> int:
    """Return the number of bits of the widest intermediate number of any operation."""
    narrow, top = 1 << (machine.bits - 1), 1 << (machine.wide - 1)
    largest = 2 * top
    sizes = np.abs(machine.edges[:, 1]) << machine.edges[:, 2]
    coefficients = [0, *accumulate(sizes.tolist())]
    for kind, _, a, b, shift, _ in machine.operations.tolist():
        number = max(narrow * narrow, top)
        if kind in (SUM, DRIVE, UPDATE):
            number = (coefficients[b] - coefficients[a]) * top
        elif kind == FUNCTION:
            number = 2 * top << int(machine.tables[a, 2])
        largest = max(largest, (number << max(-shift, 0)) + (1 << max(shift, 0)))
    return largest.bit_length() + SPARE


def _memories(network: FixedPoint, sizes: Mapping[str, int]) -> dict[str, bytes]:
    """Return the memories as hexadecimal numbers, one per line."""
    machine = network.machine
    bits, wide, at = machine.bits, machine.wide, sizes["word_at"]
    kind, target, a, b, shift, neuron = machine.operations.T
    source, coefficient, exponent = _padded(machine.edges).T
    low, high, spacing, entry = _padded(machine.tables).T
    word, start, least, most, still, driven, small = machine.neurons.T
    counts = sorted(network.vectors)
    states = np.concatenate([network.vectors[count] for count in counts])
    operation = [(kind, 3), (shift, 7), (np.maximum(neuron, 0), sizes["neuron_at"])]
    operation += [(part, sizes["any_at"]) for part in (target, a, b)]
    memories: dict[str, list[Field]] = {
        "operations": operation,
        "edges": [(coefficient, bits), (exponent, 6), (source, at)],
        "tables": [(low, bits), (high, bits), (spacing, 5), (entry, sizes["entry_at"])],
        "entries": [(_padded(machine.entries), wide)],
        "start": [(machine.words, wide)],
        "neurons": [
            *((word, at), (start, wide), (least, wide), (most, wide)),
            *((still, wide), (driven, at), (small, wide)),
        ],
        "counts": [(np.array(counts), 32)],
        "places": [(word, at)],
        "expected": [(states, wide)],
    }
    return {f"{name}.hex": _hexadecimal(fields).encode() for name, fields in memories.items()}


def _padded(values: np.ndarray) -> np.ndarray:
    """Return the rows of a memory; an empty memory has a zero that is not read."""
    return values if len(values) else np.zeros((1, *values.shape[1:]), np.int64)


def _hexadecimal(fields: list[Field]) -> str:
    """Concatenate fields as hexadecimal two's complement, the first field highest."""
    digits = (sum(width for _, width in fields) + 3) // 4
    lines = []
    for row in zip(*(values.tolist() for values, _ in fields)):
        number = 0
        for value, (_, width) in zip(row, fields):
            number = number << width | value & (1 << width) - 1
        lines.append(f"{number:0{digits}x}\n")
    return "".join(lines)


def _places(ports: Iterable[Port]) -> str:
    return "\n".join(
        f"| {plain(port.name)} | {', '.join(map(str, port.words.tolist()))} |" for port in ports
    )
