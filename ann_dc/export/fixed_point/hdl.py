"""A network in SystemVerilog: one multiplier that takes the operations of a step one by one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ann_dc.export.fixed_point.arithmetic.machine import Machine
from ann_dc.export.fixed_point.arithmetic.program import DRIVE, FUNCTION, PRODUCT, SUM, UPDATE
from ann_dc.export.fixed_point.c99 import plain, port_rows
from ann_dc.export.fixed_point.golden import Bits, FixedPoint, Port, fixed_point
from ann_dc.export.fixed_point.hdl_bench_text import BENCH, MAKEFILE, README
from ann_dc.export.fixed_point.hdl_text import DESIGN, MACHINE
from ann_dc.export.fixed_point.manifest import NAME, VECTOR, as_json, check
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.hints.checked import checked
from ann_dc.hints.values import PositiveFinite
from ann_dc.network.network import Network

CLOCKS = {PRODUCT: 7, FUNCTION: 9}
"""Clocks of an operation; others take these, and one an edge."""
OTHERS = 7
SPARE = 2
"""Bits of the accumulator beyond the largest number that it can come to."""

Field = tuple[np.ndarray, int]
"""Integers, and the bits that each has in a memory."""


@checked
def hdl_files(
    network: Network, vector: ReferenceVector, *, bits: Bits = 0, accuracy: PositiveFinite = 1e-3
) -> dict[str, bytes]:
    """A network as synthesizable SystemVerilog, with a testbench.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
        Of the network.
    bits : int
        Of a word, 4 to 32; 0 is as many as the accuracy takes.
    accuracy : float
        Largest error of a control over the largest control.

    Returns
    -------
    dict of str to bytes
        Design, testbench, memories, Makefile, README, and the integers as JSON.

    Raises
    ------
    ExportError
        If words of so many bits cannot carry the network, or not as accurately.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> files = hdl_files(network, reference_vector(network), bits=16)
    >>> [name for name in sorted(files) if name.endswith(".sv")]
    ['ann_dc_network.sv', 'testbench.sv']
    """
    found = fixed_point(network, vector, bits=bits, accuracy=accuracy)
    return {**_written(found), VECTOR: vector.as_json()}


@checked
def hdl_check(files: Mapping[str, bytes]) -> str:
    """Read such files with distrust; nothing of them is compiled or run.

    Parameters
    ----------
    files : mapping of file name to bytes

    Returns
    -------
    str
        What was found.

    Raises
    ------
    FileFormatError
        If a file is missing, or is not what the integers beside it say.
    """
    return check(files, _written)


def _written(network: FixedPoint) -> dict[str, bytes]:
    """All files but the reference vector."""
    words = _words(network)
    texts = {
        "ann_dc_network.sv": _filled(DESIGN + MACHINE, words),
        "testbench.sv": _filled(BENCH, words),
        "Makefile": MAKEFILE,
        "README.md": _readme(network),
        **_memories(network, words),
    }
    return {**{name: text.encode() for name, text in texts.items()}, NAME: as_json(network)}


def _words(network: FixedPoint) -> dict[str, int | str]:
    """What stands between the @ of the texts."""
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
        "STATE": machine.bits + machine.guard,
        "WIDE": _accumulator(machine),
        "VECTORS": len(network.vectors),
        "TITLE": plain(network.title),
        "WIRING": plain(network.wiring),
        "CONTENT": plain(network.content),
    }


def _accumulator(machine: Machine) -> int:
    """Bits of the widest number that any operation can come to."""
    top = 1 << (machine.bits - 1)
    largest = top << (machine.guard + 1)
    coefficients = np.concatenate([[0], np.cumsum(np.abs(machine.edges[:, 1]))])
    for kind, _, a, b, shift, _ in machine.operations.tolist():
        number = top * top
        if kind in (SUM, DRIVE, UPDATE):
            number = int(coefficients[b] - coefficients[a]) * top
        elif kind == FUNCTION:
            number = 2 * top << int(machine.tables[a, 2])
        largest = max(largest, (number << max(-shift, 0)) + (1 << max(shift, 0)))
    return largest.bit_length() + SPARE


def _memories(network: FixedPoint, words: Mapping[str, int | str]) -> dict[str, str]:
    """The memories as hexadecimal numbers, one a line."""
    machine = network.machine
    sizes = {name: value for name, value in words.items() if isinstance(value, int)}
    bits, state, at = sizes["BITS"], sizes["STATE"], sizes["WORD_AT"]
    kind, target, a, b, shift, neuron = machine.operations.T
    source, coefficient = _padded(machine.edges).T
    low, high, spacing, entry = _padded(machine.tables).T
    word, start, least, most, threshold = machine.neurons.T
    counts = sorted(network.vectors)
    states = np.concatenate([network.vectors[count] for count in counts])
    operation = [(kind, 3), (shift, 7), (np.maximum(neuron, 0), sizes["NEURON_AT"])]
    operation += [(part, sizes["ANY_AT"]) for part in (target, a, b)]
    memories: dict[str, list[Field]] = {
        "operations": operation,
        "edges": [(coefficient, bits), (source, at)],
        "tables": [(low, bits), (high, bits), (spacing, 5), (entry, sizes["ENTRY_AT"])],
        "entries": [(_padded(machine.entries), bits)],
        "start": [(machine.words, bits)],
        "neurons": [(word, at), (start, state), (least, state), (most, state), (threshold, bits)],
        "counts": [(np.array(counts), 32)],
        "expected": [(states, state)],
    }
    return {f"{name}.hex": _hexadecimal(fields) for name, fields in memories.items()}


def _padded(values: np.ndarray) -> np.ndarray:
    """Rows of a memory; of one without any, a zero that nobody reads."""
    return values if len(values) else np.zeros((1, *values.shape[1:]), np.int64)


def _hexadecimal(fields: list[Field]) -> str:
    """Numbers of several fields side by side, two's complement, the first in the highest bits."""
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
        title=plain(network.title),
        wiring=plain(network.wiring),
        content=plain(network.content),
        clocks=sum(CLOCKS.get(kind, OTHERS) for kind in kinds) + len(machine.edges),
        input_words=_places(network.inputs),
        control_words=_places(network.controls),
        input_rows=port_rows(network, network.inputs),
        control_rows=port_rows(network, network.controls),
        bits=machine.bits,
        guard=machine.guard,
        period=machine.period,
        steps=network.steps,
        error=f"{network.error:.1e}",
    )


def _places(ports: Iterable[Port]) -> str:
    return "\n".join(
        f"| {plain(port.name)} | {', '.join(map(str, port.words.tolist()))} |" for port in ports
    )
