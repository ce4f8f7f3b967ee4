"""C99 export of a network: integer arithmetic, tables as data, and a self-test.

The step consists of the same few lines for every network. Only the tables depend on the network.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import chain, count
from typing import Any

import numpy as np

from ann_dc.export.fixed_point.c99_text import HEADER, MAKEFILE, SELFTEST, SOURCE
from ann_dc.export.fixed_point.golden import LEAST, PREFIX, WRONG, FixedPoint, Port
from ann_dc.export.fixed_point.machine import WORD
from ann_dc.export.fixed_point.manifest import NAME, VECTOR, as_json, check
from ann_dc.export.fixed_point.readme_text import BEYOND_C99, C99
from ann_dc.export.fixed_point.widths import Bits, fixed_point
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import PositiveFinite, checked

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

    Returns header, source, a self-test program, Makefile, README, and the integers as JSON. Raises
    `ExportError` if words of ``bits`` bits cannot represent the network or do not reach the
    accuracy. Other causes are a preconditioner that couples neurons with saturation limits, and a
    prefix that is not an identifier.

    Parameters
    ----------
    bits : int
        Bits of a number, 4 to 32; 0 selects the number of bits that the accuracy needs.
    accuracy : float
        Largest error of a control relative to the largest control.
    over : str
        Ranges of inputs for which words are chosen, ``q_d.x=3:7,q_d.y=3:7``; the ranges of the
        design by default.
    prefix : str
        Prefix of all file names and C names.

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
    """Check C99 files with a strict reader, without compiling or running them.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing or does not
    match the integers in the JSON file.
    """
    return check(files, _written)


def _written(network: FixedPoint) -> dict[str, bytes]:
    """Return all files except the test vector."""
    machine = network.machine
    numbers = {
        **facts(network),
        "words": len(machine.words),
        "neurons": len(machine.neurons),
        "operations": len(machine.operations),
        "inputs": len(network.inputs),
        "controls": len(network.controls),
        "stages": max((len(port.words) for port in network.inputs), default=1),
    }
    header = HEADER.format(
        **numbers,
        input_names=_names("INPUT", network.inputs, map(network.held, network.inputs)),
        control_names=_names("CONTROL", network.controls),
    )
    texts = {
        "ann_dc_network.h": header,
        "ann_dc_network.c": SOURCE.format(**numbers, **_tables(network)),
        "selftest.c": SELFTEST.format(**numbers, **_expected(network)),
        "Makefile": MAKEFILE,
        "README.md": C99.format(**numbers, beyond=BEYOND_C99),
    }
    return {**prefixed(texts, network.prefix), NAME: as_json(network)}


def prefixed(texts: Mapping[str, str], prefix: str) -> dict[str, bytes]:
    """Return files in which file names and identifiers begin with a prefix."""

    def own(text: str) -> str:
        named = re.sub(r"\bann_dc_", f"{prefix}_", text)
        return re.sub(r"\bANN_DC_", f"{prefix.upper()}_", named)

    return {own(name): own(text).encode() for name, text in texts.items()}


def facts(network: FixedPoint) -> dict[str, Any]:
    """Return the network data that the texts of both languages contain."""
    machine = network.machine
    own = "Inputs without a range were held at the values that the network was exported with."
    return {
        "title": plain(network.title),
        "wiring": plain(network.wiring),
        "content": plain(network.content),
        "covers": plain(network.covers),
        "worth": plain(network.worth.removeprefix("words chosen for "), "%;"),
        "own": own if network.ranges else "Give ranges with `over=`, or design with `--over`.",
        "wrong": WRONG * network.accuracy,
        "least": LEAST,
        "bits": machine.bits,
        "guard": machine.guard,
        "wide": machine.wide,
        "period": machine.period,
        "steps": network.steps,
        "limit": network.limit,
        "error": f"{network.error:.1e}",
        "input_rows": _port_rows(network, network.inputs),
        "control_rows": _port_rows(network, network.controls),
        "held_rows": "\n".join(
            f"| {index} | {plain(port.name)} | {low:.12g} | {high:.12g} |"
            for index, port in enumerate(network.inputs)
            for low, high in [network.held(port)]
        ),
    }


def _tables(network: FixedPoint) -> dict[str, str]:
    machine, stages = network.machine, max((len(p.words) for p in network.inputs), default=1)
    inputs = np.array([port.words for port in network.inputs], np.int64).reshape(-1, stages)
    tables = {
        "operation": ("int32_t", machine.operations),
        "edge": ("int32_t", machine.edges),
        "table": ("int32_t", machine.tables),
        "entry": ("int32_t", machine.entries),
        "start": ("int32_t", machine.words),
        "neuron": ("int32_t", machine.neurons),
        "input": ("int32_t", inputs),
        "control": ("int32_t", [int(port.words[0]) for port in network.controls]),
    }
    return {
        f"{name}_table": _array(kind, f"{name}_table", np.asarray(values))
        for name, (kind, values) in tables.items()
    }


def _expected(network: FixedPoint) -> dict[str, str]:
    counts = sorted(network.vectors)
    states = np.array([network.vectors[count] for count in counts])
    return {
        "counts": _array("uint32_t", "counts", np.array(counts)),
        "places": _array("int32_t", "places", network.machine.neurons[:, WORD]),
        "expected": _array("int32_t", "expected", states),
        "vectors": str(len(counts)),
    }


def _array(kind: str, name: str, values: np.ndarray) -> str:
    """Format a constant array in C; an empty array has two zeros that are not read."""
    values = values if values.size else np.zeros((2, *values.shape[1:]), np.int64)
    sizes = "".join(f"[{size}]" for size in values.shape)
    rows = values.tolist() if values.ndim == 1 else [_row(row) for row in values.tolist()]
    return f"static const {kind} {name}{sizes} = {{\n{lines(map(str, rows))}\n}};"


def _row(numbers: list[int]) -> str:
    if len(numbers) <= 8:
        return "{" + ", ".join(map(str, numbers)) + "}"
    return "{\n" + lines(map(str, numbers)) + "\n    }"


def lines(words: Iterable[str]) -> str:
    """Join items with commas, in lines of limited width."""
    found, line = [], "   "
    for word in words:
        if len(line) + len(word) > WIDTH:
            found.append(line)
            line = "   "
        line += f" {word},"
    return "\n".join([*found, line]).rstrip(",")


def _names(
    kind: str, ports: tuple[Port, ...], held: Iterable[tuple[float, float]] | None = None
) -> str:
    """Format an enumeration of port numbers, with the port values if given."""
    if not ports:
        return f"enum {{ ANN_DC_NO_{kind} = 0 }};"
    names = identifiers(port.name for port in ports)
    commas = [","] * (len(names) - 1) + [""]
    rows = [
        f"    ANN_DC_{kind}_{name} = {index}{comma}"
        for index, (name, comma) in enumerate(zip(names, commas))
    ]
    if held is not None:
        rows = [f"{row}  /* {low:.12g} to {high:.12g} */" for row, (low, high) in zip(rows, held)]
    return "\n".join(["enum {", *rows, "};"])


def identifiers(names: Iterable[str]) -> list[str]:
    """Convert names to unique capital identifiers for C and Verilog.

    A name without permitted letters becomes a number.
    """
    found: list[str] = []
    for name in names:
        word = re.sub(r"[^A-Z0-9]+", "_", plain(name).upper()).strip("_")
        numbered = (f"{word}_{number}".lstrip("_") for number in count(len(found)))
        found.append(next(free for free in chain([word], numbered) if free and free not in found))
    return found


def plain(text: str, more: str = "") -> str:
    """Return text that cannot end a comment: letters, digits and a few marks.

    The marks in ``more`` are also preserved.
    """
    return re.sub(rf"[^A-Za-z0-9_.,:()\[\] =+{more}-]", " ", text)


def _port_rows(network: FixedPoint, ports: tuple[Port, ...]) -> str:
    """Return Markdown rows of ports: number, name, fraction bits, factor and offset."""
    return "\n".join(
        f"| {index} | {plain(port.name)} | {network.fraction[port.words[0]]} "
        f"| {port.scale.factor!r} | {port.scale.offset!r} |"
        for index, port in enumerate(ports)
    )
