"""C99 export of a network: integer arithmetic, tables as data, and a self-test.

The step consists of the same few lines for every network. Only the tables depend on the network.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, count

import numpy as np

from ann_dc.export.fixed_point.golden import PREFIX, FixedPoint, Port
from ann_dc.export.fixed_point.machine import WORD
from ann_dc.export.fixed_point.manifest import NAME, as_json, check
from ann_dc.export.fixed_point.printing import plain, written
from ann_dc.export.fixed_point.widths import Bits, fixed_point
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import PositiveFinite, checked

TEXTS = ("ann_dc_network.h", "ann_dc_network.c", "selftest.c", "Makefile", "README.md")
WIDTH = 96
"""Characters per line of numbers."""


@checked
def c99_files(
    network: Network,
    vector: ReferenceVector,
    *,
    bits: Bits = 0,
    accuracy: PositiveFinite = 1e-3,
    over: str = "",
    prefix: str = PREFIX,
) -> dict[str, bytes]:
    """Export a network as C99 without floating point.

    Returns header, source, a self-test program, Makefile, README, and the integers as JSON; the
    names of files and of C begin with ``prefix``. The other options and errors are those of
    `fixed_point`. Raises `ExportError` if the prefix is not an identifier.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> sorted(c99_files(network, reference_vector(network), bits=16))[:3]
    ['Makefile', 'README.md', 'ann_dc_network.c']
    """
    found = fixed_point(network, vector, bits=bits, accuracy=accuracy, over=over)
    return {**_written(found.named(prefix)), VECTOR: vector.as_json()}


@checked
def c99_check(files: Mapping[str, bytes]) -> str:
    """Check C99 files by their integers, without compiling or running them."""
    return check(files, _written)


def _written(network: FixedPoint) -> dict[str, bytes]:
    """Return all files except the test vector."""
    machine, inputs = network.machine, network.inputs
    stages = max((len(port.words) for port in inputs), default=1)
    counts = sorted(network.vectors)
    tables = {
        "operation_table": machine.operations,
        "edge_table": machine.edges,
        "table_table": machine.tables,
        "entry_table": machine.entries,
        "start_table": machine.words,
        "neuron_table": machine.neurons,
        "input_table": np.array([port.words for port in inputs], np.int64).reshape(-1, stages),
        "control_table": np.array([port.words[0] for port in network.controls], np.int64),
        "places": machine.neurons[:, WORD],
        "expected": np.array([network.vectors[count] for count in counts]),
    }
    values = {
        "inputs": len(inputs),
        "controls": len(network.controls),
        "stages": stages,
        "input_names": _names("INPUT", inputs, [network.held(port) for port in inputs]),
        "control_names": _names("CONTROL", network.controls),
        "counts": _array("uint32_t", "counts", np.array(counts)),
        **{name: _array("int32_t", name, table) for name, table in tables.items()},
    }
    return {**written("c99", network, TEXTS, values), NAME: as_json(network)}


def _array(kind: str, name: str, values: np.ndarray) -> str:
    """Format a constant array in C; an empty array has two zeros that are not read."""
    values = values if values.size else np.zeros((2, *values.shape[1:]), np.int64)
    sizes = "".join(f"[{size}]" for size in values.shape)
    rows = values.tolist() if values.ndim == 1 else [_row(row) for row in values.tolist()]
    return f"static const {kind} {name}{sizes} = {{\n{_lines(map(str, rows))}\n}};"


def _row(numbers: list[int]) -> str:
    if len(numbers) <= 8:
        return "{" + ", ".join(map(str, numbers)) + "}"
    return "{\n" + _lines(map(str, numbers)) + "\n    }"


def _lines(words: Iterable[str]) -> str:
    """Join items with commas, in lines of limited width."""
    found, line = [], "   "
    for word in words:
        if len(line) + len(word) > WIDTH:
            found.append(line)
            line = "   "
        line += f" {word},"
    return "\n".join([*found, line]).rstrip(",")


def _names(kind: str, ports: Sequence[Port], held: Sequence[tuple[float, float]] = ()) -> str:
    """Format an enumeration of port numbers, with the values that the ports hold if given."""
    if not ports:
        return f"enum {{ ANN_DC_NO_{kind} = 0 }};"
    names = _identifiers(port.name for port in ports)
    rows = [f"    ANN_DC_{kind}_{name} = {index}," for index, name in enumerate(names)]
    rows[-1] = rows[-1].removesuffix(",")
    if held:
        rows = [f"{row}  /* {low:.12g} to {high:.12g} */" for row, (low, high) in zip(rows, held)]
    return "\n".join(["enum {", *rows, "};"])


def _identifiers(names: Iterable[str]) -> list[str]:
    """Convert names to unique capital identifiers, or to a number if no letter is permitted."""
    found: list[str] = []
    for name in names:
        word = re.sub(r"[^A-Z0-9]+", "_", plain(name).upper()).strip("_")
        numbered = (f"{word}_{number}".lstrip("_") for number in count(len(found)))
        found.append(next(free for free in chain([word], numbered) if free and free not in found))
    return found
