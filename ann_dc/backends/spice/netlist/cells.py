"""Cards of one cell, by technology.

**Op amps** with resistors are single-ended or differential. Nodes of a grid are pairs, v and -v. A
resistor between two pairs is drawn twice, straight or crossed, in the cell of one of them. The
missing conductance of a node goes to ground. If the conductance is already too large, a negative
resistance is connected across the pair; a negative resistance to ground would let both nodes drift
together.

**Switched capacitors** have one branch per weight, and an op amp with the unit capacitor across it.
A resistor R into a capacitor C would contribute h T / (R C) in a period of h network time. A branch
with this fraction of the unit capacitor replaces the resistor. The proportional path of a PI cell
is a static capacitor. Adders are those of op amps, since they have no state.
"""

from __future__ import annotations

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.values import NEGATIVE, Nodes, Values
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import CLAMP_OFFSETS, CLAMP_SHARE, HOLD, Circuit, Quantity
from ann_dc.hardware.circuit.scaling import begins, built_range, slopes_of, to_ground
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import (
    DifferentialPairs,
    OpAmps,
    OtaC,
    SwitchedCapacitors,
    paired,
)
from ann_dc.hardware.schematic.elements import (
    Adder,
    Amplifier,
    Generator,
    GridNode,
    Integrator,
    Multiplier,
    Part,
    PICell,
    Wire,
)
from ann_dc.hardware.schematic.preconditioner_wiring import OWN

LIBRARY = {Integrator: "integ", PICell: "pi_cell", Adder: "sum"}
"""Library cell of every part; with suffix ``_fd`` for a differential part."""

CLAMPS = "clamp_low", "clamp_high"
"""Library clamps of an integrator."""


def _op_amp(nodes: Nodes, values: Values, text: CellText, part: Amplifier) -> None:
    """Write resistors into a summing node, and the op amp with its feedback."""
    alias, out = nodes.alias[part.name], nodes.own(part.name, text.stage)
    summing = nodes.summing(part.name)
    _input_resistors(nodes, values, text, part)
    ends, kind = _resettable(part, (summing, out)), LIBRARY[type(part)]
    given = _feedback(values, text, part, alias)
    if isinstance(part, PICell) and part.rectified:
        kind, given["rp"] = "pi_diode", number(HOLD * values.circuit.inverter)
    if isinstance(part, Integrator) and part.with_limits:
        given["c"] = _clamps(values, text, part, alias, (summing, out), given["c"])
    text.card(f"X_{alias}", ends, kind, given)


def _input_resistors(nodes: Nodes, values: Values, text: CellText, part: Amplifier) -> None:
    """Write resistors into a part's summing node from its sources in a cell."""
    for resistor in values.resistors(nodes, part, text.stage):
        value = text.value(resistor.name, resistor.ohms)
        ends = resistor.source, nodes.summing(part.name)
        text.card(f"R_{resistor.label}", ends, value, {}, counts_as="resistor")


def _clamps(
    values: Values, text: CellText, part: Integrator, alias: str, ends: tuple[str, str], c: str
) -> str:
    """Write the clamps of an integrator; return the remainder of its capacitor."""
    built = [
        (name, kind, offset, volts)
        for name, kind, offset, volts in zip(
            ("lo", "hi"), CLAMPS, CLAMP_OFFSETS, values.circuit.limits(part)
        )
        if np.isfinite(volts)
    ]
    for name, kind, offset, volts in built:
        given = {"c": c, name: text.value(f"{name}_{alias}", volts)}
        given["vos"] = values.parameter(text, part.name, offset)
        text.card(f"X{name}_{alias}", ends, kind, given)
    return f"{c[:-1]}*{number(1 - CLAMP_SHARE * len(built))}}}"


def _differential_pair(nodes: Nodes, values: Values, text: CellText, part: Amplifier) -> None:
    """Write each resistor twice, the second from the other sign to the other node."""
    alias, out = nodes.alias[part.name], nodes.own(part.name, text.stage)
    grounds = f"@sp__{alias}", f"@sn__{alias}"
    for resistor in values.resistors(nodes, part, text.stage):
        value = text.value(resistor.name, resistor.ohms)
        both = resistor.source, nodes.opposite(resistor.source)
        for half, summing, source in zip("pn", grounds, both):
            ends = source, summing
            text.card(f"R{half}_{resistor.label}", ends, value, {}, counts_as="resistor")
    ends, kind = (
        _resettable(part, (*grounds, out, nodes.opposite(out))),
        LIBRARY[type(part)] + "_fd",
    )
    text.card(f"X_{alias}", ends, kind, _feedback(values, text, part, alias))


def _resettable(part: Amplifier, ends: tuple[str, ...]) -> tuple[str, ...]:
    """Return the nodes of an amplifier's cell, with reset unless it is an adder."""
    return ends if isinstance(part, Adder) else (*ends, "rst")


def _feedback(
    values: Values, text: CellText, part: Amplifier, alias: str, *, offset: bool = True
) -> dict[str, str]:
    """Return parameters of an amplifier's cell: feedback, capacitor, preset, offset."""
    name, circuit = part.name, values.circuit
    given: dict[str, str] = {}
    if name in circuit.feedback:
        given["rf"] = values.parameter(text, name, Quantity.FEEDBACK, circuit.feedback[name])
    if name in circuit.capacitors:
        farads = circuit.capacitors[name][text.stage]
        given["c"] = values.parameter(text, name, Quantity.CAPACITOR, farads)
        given["v0"] = text.value(f"v0_{alias}", float(circuit.presets[name][text.stage]))
    if offset:
        given["vos"] = values.parameter(text, name, Quantity.OFFSET)
    return given


def _inverter(nodes: Nodes, values: Values, text: CellText, name: str) -> None:
    """Write the other sign of a part's output."""
    alias, own = nodes.alias[name], nodes.own(name, text.stage)
    errors = {
        "r": number(values.circuit.inverter),
        "e": values.parameter(text, name, Quantity.INVERTER),
        "vos": values.parameter(text, name, Quantity.INVERTER_OFFSET),
    }
    text.card(f"Xn_{alias}", (own, nodes.opposite(own)), "inv", errors)


def _grid_node(nodes: Nodes, values: Values, text: CellText, part: GridNode) -> None:
    """Write a pair of nodes, the resistors that begin there, and the follower."""
    circuit, alias, stage = nodes.circuit, nodes.alias[part.name], text.stage
    here = _pair(nodes, part.name, stage)
    ohms, order = circuit.resistors[part.name], list(nodes.schematic.by_name)
    for place, wire in enumerate(part.wires):
        if wire.weight[stage] and begins(part, wire, order):
            there = _ends(nodes, part, wire, stage)
            value = text.value(f"rg_{alias}_{place}", float(ohms[place, stage]))
            for half, (a, b) in enumerate(zip(here, there)):
                name = f"Rg{half}_{alias}_{place}"
                text.card(name, (a, b), value, {}, counts_as="resistor")
    conductance = circuit.conductances[part.name]
    missing = float(to_ground(conductance, ohms)[stage])
    farads = float(conductance[stage]) * circuit.lag * circuit.scaling.time
    capacitor = text.value(f"cg_{alias}", farads)
    for half, node in enumerate(here):
        text.card(f"Cg{half}_{alias}", (node, "0"), capacitor, {}, counts_as="capacitor")
    if missing > 0:
        ground = text.value(f"rg_{alias}", 1.0 / missing)
        for half, node in enumerate(here):
            text.card(f"Rg{half}_{alias}", (node, "0"), ground, {}, counts_as="resistor")
    elif missing < 0:  # zero where nothing but the own integrator leads to the node
        text.card(
            f"Rg_{alias}", here, text.value(f"rg_{alias}", 2.0 / missing), {}, counts_as="negative"
        )
    out = nodes.own(part.name, stage)
    offset = {"vos": values.parameter(text, part.name, Quantity.OFFSET)}
    text.card(f"X_{alias}", (here[0], out, out), "opamp", offset, counts_as="follower")


def _pair(nodes: Nodes, name: str, stage: int) -> tuple[str, str]:
    """Return the top-level nodes of v and -v, that of the part's output sign first."""
    plain = f"grid_{nodes.alias[name]}__{stage}"
    return plain, plain + NEGATIVE


def _ends(nodes: Nodes, part: GridNode, wire: Wire, stage: int) -> tuple[str, str]:
    """Return the ends of the two resistors of a wire: from v and from -v."""
    polarity = nodes.schematic.polarity
    sign = 1 if wire.weight[stage] > 0 else -1
    if wire.source.startswith(OWN):
        wanted = sign * polarity[part.name]
        ends = [nodes.node(wire.source, stage + wire.offset, s * wanted) for s in (1, -1)]
        return ends[0], ends[1]
    there = _pair(nodes, wire.source, stage + wire.offset)
    same = sign * polarity[part.name] * polarity[wire.source] > 0
    return there if same else (there[1], there[0])


OTA_KINDS = {Integrator: "ota_node", PICell: "ota_pi", Adder: "ota_sum"}
"""The library's cell of every part's node."""


def _transconductors(
    nodes: Nodes, values: Values, text: CellText, part: Amplifier, built: OtaC, a0: float
) -> None:
    """Write the transconductors into the part's node, and its load.

    ``a0`` is the voltage gain of a transconductor into its output resistance; infinite without such
    a resistance.
    """
    alias, out = nodes.alias[part.name], nodes.own(part.name, text.stage)
    weights = [
        (resistor.label, nodes.plain(resistor.source), -nodes.sign(resistor.source) / resistor.ohms)
        for resistor in values.resistors(nodes, part, text.stage)
    ]
    linear = number(built.linear_range * nodes.scaling.full_scale)
    for label, between, gm in paired(weights):
        given = {"gm": text.value(f"gm_{label}", gm), "vl": linear}
        kind = "ota" if len(between) == 1 else "ota_diff"
        text.card(f"Xw_{label}", (*between, out), kind, given)
    loads = _feedback(values, text, part, alias, offset=False)
    if np.isfinite(a0):
        total = sum(abs(gm) for _, _, gm in weights)
        loads["ro"] = text.value(f"ro_{alias}", a0 / max(total, 1e-300))
    text.card(f"X_{alias}", _resettable(part, (out,)), OTA_KINDS[type(part)], loads)


def _switched_capacitors(
    nodes: Nodes, values: Values, text: CellText, part: Amplifier, built: SwitchedCapacitors
) -> None:
    """Write branches into a summing node and the op amp that integrates them."""
    if isinstance(part, Adder):
        _op_amp(nodes, values, text, part)
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

    ``nodes`` records the constant sources that the cell reads.
    """
    text, schematic = CellText(stage), nodes.schematic
    for part in schematic.parts:
        if not schematic.alive(part.name, stage):
            if isinstance(part, Integrator) and schematic.collects(part.name):
                text.comment(f"{part.name}, shared by all cells, in the last cell")
                _input_resistors(nodes, values, text, part)
            continue
        text.comment(f"{part.name}: {_described(part)}")
        if isinstance(part, Multiplier):
            _multiplier(nodes, values, level, text, part)
        elif isinstance(part, Generator):
            _generator(nodes, values, level, text, part)
        elif isinstance(part, GridNode):
            _grid_node(nodes, values, text, part)
        else:
            _amplifier(nodes, values, level, text, part)
        if part.name in schematic.inverted:
            _inverter(nodes, values, text, part.name)
    return text


def _amplifier(nodes: Nodes, values: Values, level: Level, text: CellText, part: Amplifier) -> None:
    built = level.technology
    if isinstance(built, OpAmps):
        _op_amp(nodes, values, text, part)
    elif isinstance(built, DifferentialPairs):
        _differential_pair(nodes, values, text, part)
    elif isinstance(built, OtaC):
        _transconductors(nodes, values, text, part, built, level.datasheet.a0)
    else:
        _switched_capacitors(nodes, values, text, part, built)


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
