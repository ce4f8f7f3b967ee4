"""Cards of switched capacitors: a branch a weight, into an op amp with the unit capacitor across.

Where a resistor R into a capacitor C would bring h T / (R C) in a period of h network time, a
branch of that share of the unit capacitor does. The proportional path of a PI cell is a static
capacitor. Adders are those of op amps: they have nothing to hold.
"""

from __future__ import annotations

from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.backends.spice.netlist.op_amps import op_amp
from ann_dc.backends.spice.netlist.values import Values
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.parameters import Quantity
from ann_dc.hardware.parts.technologies import SwitchedCapacitors
from ann_dc.hardware.schematic.elements import Adder, Amplifier, Integrator, PICell


def switched_capacitors(
    nodes: Nodes, values: Values, text: CellText, part: Amplifier, built: SwitchedCapacitors
) -> None:
    """Branches into a summing node, and the op amp that holds what they bring.

    Parameters
    ----------
    nodes, values, text, part
        As `op_amp` takes them.
    built : SwitchedCapacitors
        Clock and step.
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
    """Volts across the unit capacitor at the start: of a PI cell, those of its whole output."""
    if not isinstance(part, PICell):
        return float(circuit.presets[part.name][stage])
    network = circuit.schematic.network
    value = evaluator(network).node(network.start_state, part.name)[stage]
    volts = float(circuit.scaling.volts(part.name, value))
    return circuit.schematic.polarity[part.name] * volts
