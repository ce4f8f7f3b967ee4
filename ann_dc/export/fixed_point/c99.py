"""A network in C99: integers alone, tables as data, and a test of itself.

The step is the same few lines for every network; all that is the network's own are tables.
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
from ann_dc.validation.checked import checked
from ann_dc.validation.values import PositiveFinite

WIDTH = 96
"""Characters of a line of numbers."""


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
    """A network as C99 without floating point.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
        Of the network.
    bits : int
        Of a number, 4 to 32; 0 is as many as the accuracy takes.
    accuracy : float
        Largest error of a control over the largest control.
    over : str
        Ranges of inputs that words are chosen for, ``q_d.x=3:7,q_d.y=3:7``; by default those that
        the network was designed for.
    prefix : str
        Beginning of all names of files and of C.

    Returns
    -------
    dict of str to bytes
        Header, source, a program that tests itself, Makefile, README, and the integers as JSON.

    Raises
    ------
    ExportError
        If words of so many bits cannot carry the network, or not as accurately, its metric couples
        neurons that have rails, or the prefix is no identifier.

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
    """Return files whose names, and the names in them, begin with a prefix.

    Parameters
    ----------
    texts : mapping of file name to str
    prefix : str
    """

    def own(text: str) -> str:
        named = re.sub(r"\bann_dc_", f"{prefix}_", text)
        return re.sub(r"\bANN_DC_", f"{prefix.upper()}_", named)

    return {own(name): own(text).encode() for name, text in texts.items()}


def facts(network: FixedPoint) -> dict[str, Any]:
    """Return what the texts of both languages say of a network.

    Parameters
    ----------
    network : FixedPoint
    """
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
    """A constant array in C; one without a number holds two zeros, which nobody reads."""
    values = values if values.size else np.zeros((2, *values.shape[1:]), np.int64)
    sizes = "".join(f"[{size}]" for size in values.shape)
    rows = values.tolist() if values.ndim == 1 else [_row(row) for row in values.tolist()]
    return f"static const {kind} {name}{sizes} = {{\n{lines(map(str, rows))}\n}};"


def _row(numbers: list[int]) -> str:
    if len(numbers) <= 8:
        return "{" + ", ".join(map(str, numbers)) + "}"
    return "{\n" + lines(map(str, numbers)) + "\n    }"


def lines(words: Iterable[str]) -> str:
    """Words with commas between them, in lines.

    Parameters
    ----------
    words : iterable of str
    """
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
    """Return an enumeration of the numbers of ports, with the values that they hold if given."""
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
    """Names in capitals that C and Verilog take, each once; one without such letters is a number.

    Parameters
    ----------
    names : iterable of str
    """
    found: list[str] = []
    for name in names:
        word = re.sub(r"[^A-Z0-9]+", "_", plain(name).upper()).strip("_")
        numbered = (f"{word}_{number}".lstrip("_") for number in count(len(found)))
        found.append(next(free for free in chain([word], numbered) if free and free not in found))
    return found


def plain(text: str, more: str = "") -> str:
    """Text that ends no comment: letters, digits and a few marks.

    Parameters
    ----------
    text : str
    more : str
        Further marks that are kept.
    """
    return re.sub(rf"[^A-Za-z0-9_.,:()\[\] =+{more}-]", " ", text)


def _port_rows(network: FixedPoint, ports: tuple[Port, ...]) -> str:
    """Return Markdown rows: number, name, fraction bits, factor and offset of every port."""
    return "\n".join(
        f"| {index} | {plain(port.name)} | {network.fraction[port.words[0]]} "
        f"| {port.scale.factor!r} | {port.scale.offset!r} |"
        for index, port in enumerate(ports)
    )
