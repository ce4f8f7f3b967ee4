"""Cards of switched capacitors: one branch per weight, and the op amp.

The op amp has the unit capacitor across it. A resistor R into a capacitor C would contribute h T /
(R C) in a period of h network time. A branch with this fraction of the unit capacitor replaces the
resistor. The proportional path of a PI cell is a static capacitor. Adders are those of op amps,
since they have no state.
"""

from __future__ import annotations

from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.op_amps import (
    differential_pair,
    grid_node,
    input_resistors,
    inverter,
    op_amp,
    transconductors,
)
from ann_dc.backends.spice.netlist.values import Nodes, Values
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import Circuit, Quantity
from ann_dc.hardware.circuit.scaling import built_range, slopes_of
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import DifferentialPairs, OpAmps, OtaC, SwitchedCapacitors
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


def switched_capacitors(
    nodes: Nodes, values: Values, text: CellText, part: Amplifier, built: SwitchedCapacitors
) -> None:
    """Write branches into a summing node and the op amp that integrates them.

    The first arguments are those of `op_amp`; ``built`` gives clock and step.
    """
    if isinstance(part, Adder):
        op_amp(nodes, values, text, part)
        return
    alias, name = nodes.alias[part.name], part.name
    summing = f"@s__{alias}"
    _branches(nodes, values, text, part, built)
    given = {
        "c": values.parameter(text, name, Quantity.CAPACITOR, built.unit_capacitor),
        "v0": text.value(f"v0_{alias}", _start(nodes.circuit, part, text.stage)),
        "vos": values.parameter(text, name, Quantity.OFFSET),
    }
    text.card(f"X_{alias}", (summing, nodes.own(name, text.stage), "rst"), "sc_integ", given)


def _branches(
    nodes: Nodes,
    values: Values,
    text: CellText,
    part: Integrator | PICell,
    built: SwitchedCapacitors,
) -> None:
    summing, unit = f"@s__{nodes.alias[part.name]}", built.unit_capacitor
    per_period = built.step * nodes.scaling.time
    farads = nodes.circuit.capacitors[part.name][text.stage]
    for resistor in values.resistors(nodes, part, text.stage):
        label, source = resistor.label, resistor.source
        plain = nodes.opposite(source)  # a branch does not invert, a static capacitor does
        ratio = per_period / (resistor.ohms * farads)
        sampled = {
            "c": text.value(f"cs_{label}", ratio * unit),
            "ron": number(built.on_resistance),
            "cov": number(built.overlap),
        }
        text.card(f"Xw_{label}", (plain, summing, "p1", "p2"), "sc_branch", sampled)
        if isinstance(part, PICell):
            static = unit * values.feedback(part.name, text.stage) / resistor.ohms
            given = {"c": text.value(f"cp_{label}", static)}
            text.card(f"Xp_{label}", (source, summing), "sc_static", given)


def _start(circuit: Circuit, part: Integrator | PICell, stage: int) -> float:
    """Return the start voltage of the unit capacitor; for a PI cell, the full output."""
    if not isinstance(part, PICell):
        return float(circuit.presets[part.name][stage])
    network = circuit.schematic.network
    value = evaluator(network).node(network.start_state, part.name)[stage]
    volts = float(circuit.scaling.volts(part.name, value))
    return circuit.schematic.polarity[part.name] * volts


def cell_of(nodes: Nodes, values: Values, level: Level, stage: int) -> CellText:
    """Return the cards and values of one cell, by its index from 0.

    ``nodes`` records the constant sources that the cell reads. ``values`` contains the part values
    with their deviations.
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
"""Errors supported by the library's cells, named by the prefixes of the parameters."""


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
