r"""LaTeX equations of a network: the sum of every neuron and block of a cell.

.. math:: \tau\, \frac{dx}{ds} = \sum_e w_e\, s_e .

A neuron ``mu.phi`` of stage k is written :math:`\mu^{\varphi}_k` and a state ``q.phi`` is written
:math:`\varphi_k`, as in the stage equations. Products are numbered. The equations need only the
network, so they are also available for a loaded network.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ann_dc.export.drawings.latex_symbols import (
    INDEX,
    applied,
    at_stage,
    escaped,
    is_inline,
    number,
    range_of,
    symbols_of,
)
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.cell import ONE, Block, Connection, Product, Sum
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.si_prefixes import counted
from ann_dc.validation import checked
from ann_dc.weights.hashes import content_hash, wiring_hash

TEX = "equations.tex"
TERMS = 4
"""Terms of a sum per line."""
PREAMBLE = r"""\documentclass{article}
\usepackage{amsmath}
\usepackage{longtable}
\usepackage[margin=20mm]{geometry}
\allowdisplaybreaks"""
"""Preamble of a document; no other packages are loaded."""


@checked
def latex_files(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    r"""Write the equations of a cell as a document with tables of its numbers.

    The tables list weights, time constants and inputs. The document needs only ``amsmath``,
    ``longtable`` and ``geometry``. Numbers are in network units; a range is given for numbers that
    differ between stages. The files are 'equations.tex' and 'reference_vector.json'.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
    >>> files = latex_files(network, reference_vector(network))
    >>> lines = files["equations.tex"].decode().splitlines()
    >>> print(*(line for line in lines if "d {a}_{k}" in line))
    \tau\,\frac{d {a}_{k}}{ds} &= -{a}_{k} - {m}^{{v}}_{k} \\
    """
    text = "\n".join(_document(network))
    return {TEX: (text + "\n").encode("ascii"), VECTOR: vector.as_json()}


def _document(network: Network) -> Iterator[str]:
    """Yield the lines of the document on a network."""
    names = symbols_of(network)
    yield from (
        f"% wiring: {wiring_hash(network)}",
        f"% content: {content_hash(network)}",
        PREAMBLE,
        r"\begin{document}",
        rf"\section*{{$\mathrm{{{escaped(network.title)}}}$}}",
        rf"A row of {counted(network.stages, 'cells')}; the equations of cell $k$, "
        "in network units.",
        r"\section*{Neurons}",
        r"\begin{align*}",
    )
    for neuron in network.cell.neurons:
        rows = _sum(network, neuron.name, names)
        if neuron.shared:
            rows = rf"\sum_k [ {rows} ]"
        yield rf"\tau\,\frac{{d {at_stage(names[neuron.name])}}}{{ds}} &= {rows} \\"
    yield r"\end{align*}"
    if network.preconditioner.kind is not PreconditionerKind.DIAGONAL:
        kind = network.preconditioner.kind.value
        yield f"These are the net inputs. The {kind} preconditioner couples them along the array:"
        yield "it changes the settling time, not the equilibrium."
    blocks = [block for block in network.cell.blocks if not is_inline(block)]
    if blocks:
        yield r"\section*{Blocks}"
        yield r"\begin{align*}"
        for block in blocks:
            yield rf"{at_stage(names[block.name])} &= {_formula(network, block, names)} \\"
        yield r"\end{align*}"
    yield from _neuron_table(network, names)
    yield from _weight_table(network, names)
    yield from _ends(network, names)
    yield r"\end{document}"


def _formula(network: Network, block: Block, names: Mapping[str, str]) -> str:
    if isinstance(block, Sum):
        return _sum(network, block.name, names)
    if isinstance(block, Product):
        return rf"{at_stage(names[block.a])}\,{at_stage(names[block.b])}"
    return applied(block.function, at_stage(names[block.x]))


def _sum(network: Network, target: str, names: Mapping[str, str]) -> str:
    """Return the net input of a node as LaTeX, with a few terms per line."""
    wires = [
        (place, wire)
        for place, wire in enumerate(network.cell.connections, 1)
        if wire.target == target
    ]
    terms = [_term(*wire, names, not place) for place, wire in enumerate(wires)] or ["0"]
    lines = [" ".join(terms[i : i + TERMS]) for i in range(0, len(terms), TERMS)]
    return " \\\\\n&\\qquad ".join(lines)


def _term(place: int, wire: Connection, names: Mapping[str, str], first: bool) -> str:
    weight = np.atleast_1d(np.asarray(wire.weight, float))
    source = at_stage(names[wire.source], int(wire.template))
    factor, sign = rf"w_{{{place},k}}", "+"
    if not np.ptp(weight):
        factor, sign = number(abs(weight[0])), "-" if weight[0] < 0 else "+"
    lead = f"{sign} " if not first else "-" if sign == "-" else ""
    if wire.source == ONE:
        return f"{lead}{factor}"
    return f"{lead}{source}" if factor == "1" else rf"{lead}{factor}\,{source}"


def _neuron_table(network: Network, names: Mapping[str, str]) -> Iterator[str]:
    yield r"\section*{Neurons: time constants, limits, and the user's values of one and of zero}"
    yield r"\begin{longtable}{lllllll}"
    yield r"neuron & role & $\tau$ & lowest & highest & step of 1 & zero \\ \hline \endhead"
    for neuron in network.cell.neurons:
        limits = [f"${number(end)}$" for end in (neuron.limiter.low, neuron.limiter.high)]
        role = neuron.role.value + (", shared" if neuron.shared else "")
        scale = [f"${number(neuron.scale.factor)}$", f"${number(neuron.scale.offset)}$"]
        name = f"${at_stage(names[neuron.name])}$"
        cells = (name, role, f"${range_of(neuron.tau)}$", *limits, *scale)
        yield " & ".join(cells) + r" \\"
    yield r"\end{longtable}"


def _weight_table(network: Network, names: Mapping[str, str]) -> Iterator[str]:
    yield r"\section*{Weights}"
    yield r"\begin{longtable}{rlll}"
    yield r"number & target & source & weight \\ \hline \endhead"
    for place, wire in enumerate(network.cell.connections, 1):
        source = at_stage(names[wire.source], int(wire.template))
        ends = f"${at_stage(names[wire.target])}$ & ${source}$"
        yield rf"{place} & {ends} & ${range_of(wire.weight)}$ \\"
    yield r"\end{longtable}"


def _ends(network: Network, names: Mapping[str, str]) -> Iterator[str]:
    """Yield the inputs and the boundary values of the cell array."""
    if network.cell.inputs:
        yield r"\section*{Inputs}"
        yield r"\begin{longtable}{ll}"
        yield r"input & value \\ \hline \endhead"
        for name in network.cell.inputs:
            yield rf"${at_stage(names[name])}$ & ${range_of(network.input_values[name])}$ \\"
        yield r"\end{longtable}"
    if network.fixed or network.omitted or network.left_boundary:
        yield r"\section*{Ends of the array}"
        yield r"\begin{longtable}{ll}"
        at = lambda name, stage: names[name].replace(INDEX, str(stage))  # noqa: E731
        for pin in network.fixed:
            yield rf"${at(pin.neuron, pin.stage)}$ & $= {at(pin.input, pin.stage)}$ \\"
        for gone in network.omitted:
            yield rf"${at(gone.neuron, gone.stage)}$ & is omitted \\"
        for node, given in network.left_boundary.items():
            yield rf"${at(node, -1)}$ & $= {at(given, 0)}$ \\"
        yield r"\end{longtable}"
