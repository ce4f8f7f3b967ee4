"""SystemVerilog export: one multiplier executes the operations in sequence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import accumulate

import numpy as np

from ann_dc.export.fixed_point.c99 import facts, plain, prefixed
from ann_dc.export.fixed_point.golden import PREFIX, FixedPoint, Port
from ann_dc.export.fixed_point.hdl_bench_text import BENCH, MAKEFILE, README
from ann_dc.export.fixed_point.hdl_text import DESIGN, MACHINE
from ann_dc.export.fixed_point.machine import Machine
from ann_dc.export.fixed_point.manifest import NAME, VECTOR, as_json, check
from ann_dc.export.fixed_point.readme_text import BEYOND_HDL
from ann_dc.export.fixed_point.widths import Bits, fixed_point
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.lowering.program import DRIVE, FUNCTION, PRODUCT, SUM, UPDATE
from ann_dc.network.network import Network
from ann_dc.validation import PositiveFinite, checked

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

    Returns design, testbench, memories, Makefile, README, and the integers as JSON. The options
    ``bits``, ``accuracy`` and ``over`` are those of `c99_files`; ``prefix`` begins the names of the
    design file and module.

    Raises `ExportError` if words of ``bits`` bits cannot represent the network or do not reach the
    accuracy. Other causes are a preconditioner that couples neurons with saturation limits, and a
    prefix that is not an identifier.

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
    """Check SystemVerilog files with a strict reader; no file is compiled or run.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing or does not
    match the integers in the JSON file.
    """
    return check(files, _written)


def _written(network: FixedPoint) -> dict[str, bytes]:
    """Return all files except the test vector."""
    words = _words(network)
    texts = {
        "ann_dc_network.sv": _filled(DESIGN + MACHINE, words),
        "testbench.sv": _filled(BENCH, words),
        "Makefile": MAKEFILE,
        "README.md": _readme(network),
        **_memories(network, words),
    }
    return {**prefixed(texts, network.prefix), NAME: as_json(network)}


def _words(network: FixedPoint) -> dict[str, int | str]:
    """Return the values of the @ placeholders in the texts."""
    machine = network.machine
    counts = {
        "WORDS": len(machine.words),
        "NEURONS": len(machine.neurons),
        "OPERATIONS": len(machine.operations),
        "EDGES": max(len(machine.edges), 1),
        "TABLES": max(len(machine.tables), 1),
        "ENTRIES": max(len(machine.entries), 1),
    }
    at = {f"{name[:-1]}_AT": (count - 1).bit_length() or 1 for name, count in counts.items()}
    at["ENTRY_AT"] = at.pop("ENTRIE_AT")
    at["EDGE_AT"] = counts["EDGES"].bit_length()
    return {
        **counts,
        **at,
        "ANY_AT": max(at["WORD_AT"], at["EDGE_AT"], at["TABLE_AT"]),
        "BITS": machine.bits,
        "GUARD": machine.guard,
        "PERIOD": machine.period,
        "WORD": machine.wide,
        "LIMIT": network.limit,
        "COVERS": plain(network.covers),
        "WIDE": _accumulator(machine),
        "VECTORS": len(network.vectors),
        "TITLE": plain(network.title),
        "WIRING": plain(network.wiring),
        "CONTENT": plain(network.content),
    }


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


def _memories(network: FixedPoint, words: Mapping[str, int | str]) -> dict[str, str]:
    """Return the memories as hexadecimal numbers, one per line."""
    machine = network.machine
    sizes = {name: value for name, value in words.items() if isinstance(value, int)}
    bits, wide, at = sizes["BITS"], sizes["WORD"], sizes["WORD_AT"]
    kind, target, a, b, shift, neuron = machine.operations.T
    source, coefficient, exponent = _padded(machine.edges).T
    low, high, spacing, entry = _padded(machine.tables).T
    word, start, least, most, still, driven, small = machine.neurons.T
    counts = sorted(network.vectors)
    states = np.concatenate([network.vectors[count] for count in counts])
    operation = [(kind, 3), (shift, 7), (np.maximum(neuron, 0), sizes["NEURON_AT"])]
    operation += [(part, sizes["ANY_AT"]) for part in (target, a, b)]
    memories: dict[str, list[Field]] = {
        "operations": operation,
        "edges": [(coefficient, bits), (exponent, 6), (source, at)],
        "tables": [(low, bits), (high, bits), (spacing, 5), (entry, sizes["ENTRY_AT"])],
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
    return {f"{name}.hex": _hexadecimal(fields) for name, fields in memories.items()}


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


def _filled(text: str, words: Mapping[str, int | str]) -> str:
    for name, value in words.items():
        text = text.replace(f"@{name}@", str(value))
    return text


def _readme(network: FixedPoint) -> str:
    machine = network.machine
    kinds = machine.operations[:, 0].tolist()
    return README.format(
        **facts(network),
        beyond=BEYOND_HDL.format(bits=machine.bits),
        clocks=sum(CLOCKS.get(kind, OTHERS) for kind in kinds) + len(machine.edges),
        input_words=_places(network.inputs),
        control_words=_places(network.controls),
    )


def _places(ports: Iterable[Port]) -> str:
    return "\n".join(
        f"| {plain(port.name)} | {', '.join(map(str, port.words.tolist()))} |" for port in ports
    )
