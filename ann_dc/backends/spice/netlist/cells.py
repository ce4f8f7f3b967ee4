"""The cards of one cell: every part of it, written by what its technology is."""

from __future__ import annotations

from ann_dc.backends.spice.netlist.capacitors import switched_capacitors
from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.backends.spice.netlist.op_amps import (
    differential_pair,
    grid_node,
    input_resistors,
    inverter,
    op_amp,
)
from ann_dc.backends.spice.netlist.transconductors import transconductors
from ann_dc.backends.spice.netlist.values import Values
from ann_dc.hardware.circuit.generators import built_range, slopes_of
from ann_dc.hardware.circuit.parameters import Quantity
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import DifferentialPairs, OpAmps, OtaC
from ann_dc.hardware.schematic.elements import (
    Adder,
    Amplifier,
    Generator,
    GridNode,
    Integrator,
    Multiplier,
    Part,
    PICell,
)


def cell_of(nodes: Nodes, values: Values, level: Level, stage: int) -> CellText:
    """Cards and values of one cell.

    Parameters
    ----------
    nodes : Nodes
        Of the circuit; takes note of the constant sources that the cell reads.
    values : Values
        Of its parts, with their deviations.
    level : Level
    stage : int
        Which cell, from 0.
    """
    text, schematic = CellText(stage), nodes.schematic
    for part in schematic.parts:
        if not schematic.alive(part.name, stage):
            if isinstance(part, Integrator) and schematic.collects(part.name):
                text.comment(f"{part.name}, in the last cell, of all cells")
                input_resistors(nodes, values, text, part)
            continue
        text.comment(f"{part.name}: {_described(part)}")
        if isinstance(part, Multiplier):
            _multiplier(nodes, values, level, text, part)
        elif isinstance(part, Generator):
            _generator(nodes, values, level, text, part)
        elif isinstance(part, GridNode):
            grid_node(nodes, values, text, part)
        else:
            _amplifier(nodes, values, level, text, part)
        if part.name in schematic.inverted:
            inverter(nodes, values, text, part.name)
    return text


def _amplifier(nodes: Nodes, values: Values, level: Level, text: CellText, part: Amplifier) -> None:
    built = level.technology
    if isinstance(built, OpAmps):
        op_amp(nodes, values, text, part)
    elif isinstance(built, DifferentialPairs):
        differential_pair(nodes, values, text, part)
    elif isinstance(built, OtaC):
        transconductors(nodes, values, text, part, built, level.datasheet.a0)
    else:
        switched_capacitors(nodes, values, text, part, built)


def _multiplier(
    nodes: Nodes, values: Values, level: Level, text: CellText, part: Multiplier
) -> None:
    sign_of, alias = nodes.schematic.sign, nodes.alias[part.name]
    signs = [sign_of(name) for name in (part.a, part.b)]
    a, b = (nodes.node(n, text.stage, s) for n, s in zip((part.a, part.b), signs))
    swap = signs[0] * signs[1] * sign_of(part.name) < 0
    inputs = (*(("0", a) if swap else (a, "0")), b, "0")
    errors = _errors(values, text, part.name, MULTIPLIER_ERRORS)
    given = {"vm": number(nodes.scaling.full_scale)} | errors
    out = nodes.own(part.name, text.stage)
    if isinstance(level.technology, DifferentialPairs):
        text.card(f"X_{alias}", (*inputs, out, nodes.opposite(out)), "mul4q_fd", given)
    else:
        text.card(f"X_{alias}", (*inputs, "0", out), "mul4q", given)
    if level.transistors:
        for pin, name, node in (("x", part.a, a), ("y", part.b, b)):
            if nodes.schematic.carrier(name) in nodes.schematic.diode_neurons:
                text.card(f"X{pin}_{alias}", (node,), "mul4q_base", {})


def _generator(nodes: Nodes, values: Values, level: Level, text: CellText, part: Generator) -> None:
    alias = nodes.alias[part.name]
    errors = _errors(values, text, part.name, GENERATOR_ERRORS)
    ends = (
        nodes.node(part.x, text.stage, nodes.schematic.sign(part.x)),
        nodes.own(part.name, text.stage),
    )
    if level.functions is not None:
        text.card(f"X_{alias}", ends, f"curve_{alias}", errors, counts_as="function")
        return
    low, high = built_range(part, nodes.scaling)
    sx, sy = slopes_of(nodes.schematic, nodes.scaling, part)
    given = {"sx": number(sx), "sy": number(sy), "lo": number(low), "hi": number(high)}
    text.card(f"X_{alias}", ends, f"func_{part.function}", given | errors, counts_as="function")


MULTIPLIER_ERRORS = (Quantity.GAIN, Quantity.OFFSET_X, Quantity.OFFSET_Y, Quantity.OFFSET_Z)
GENERATOR_ERRORS = (Quantity.GAIN, Quantity.OFFSET_Y)
"""Errors that the library's cells have, called as the parameters' names begin."""


def _errors(
    values: Values, text: CellText, name: str, quantities: tuple[Quantity, ...]
) -> dict[str, str]:
    return {q.letters: values.parameter(text, name, q) for q in quantities}


KINDS = {Integrator: "integrator", PICell: "PI dual", Adder: "adder", GridNode: "node of a grid"}


def _described(part: Part) -> str:
    if isinstance(part, Multiplier):
        return f"{part.a} times {part.b}"
    if isinstance(part, Generator):
        return f"{part.function} of {part.x}"
    kind = KINDS[type(part)]
    return f"{kind} of " + ", ".join(wire.source + _whose(wire.offset) for wire in part.wires)


def _whose(offset: int) -> str:
    if abs(offset) > 1:
        return f" ({offset:+d} cells)"
    return {-1: " (previous)", 0: "", 1: " (next)"}[offset]
