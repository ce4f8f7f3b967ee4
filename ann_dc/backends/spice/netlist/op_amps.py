"""Cards of op amps with resistors: single-ended and differential."""

from __future__ import annotations

from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.backends.spice.netlist.values import Values
from ann_dc.hardware.circuit.parameters import Quantity
from ann_dc.hardware.schematic.elements import Adder, Amplifier, Integrator, PICell

KINDS = {Integrator: "integ", PICell: "pi_cell", Adder: "sum"}
"""The library's cell of every part; ``_fd`` after it for a differential one."""


def op_amp(nodes: Nodes, values: Values, text: CellText, part: Amplifier) -> None:
    """Resistors into a summing node, and the op amp with its feedback.

    Parameters
    ----------
    nodes : Nodes
        Of the circuit.
    values : Values
        Of its parts, with their deviations.
    text : CellText
        The cell; cards are added to it.
    part : Amplifier
        The part that they make up.
    """
    alias = nodes.alias[part.name]
    summing = f"@s__{alias}"
    for resistor in values.resistors(nodes, part, text.stage):
        value = text.value(resistor.name, resistor.ohms)
        ends = resistor.source, summing
        text.card(f"R_{resistor.label}", ends, value, {}, counts_as="resistor")
    out = nodes.own(part.name, text.stage)
    ends = (summing, out) if isinstance(part, Adder) else (summing, out, "rst")
    text.card(f"X_{alias}", ends, KINDS[type(part)], feedback(values, text, part, alias))


def differential_pair(nodes: Nodes, values: Values, text: CellText, part: Amplifier) -> None:
    """Each resistor twice, the second one from the other sign to the other summing node.

    Parameters
    ----------
    nodes : Nodes
        Of the circuit.
    values : Values
        Of its parts, with their deviations.
    text : CellText
        The cell; cards are added to it.
    part : Amplifier
        The part that they make up.
    """
    alias = nodes.alias[part.name]
    grounds = f"@sp__{alias}", f"@sn__{alias}"
    for resistor in values.resistors(nodes, part, text.stage):
        value = text.value(resistor.name, resistor.ohms)
        both = resistor.source, nodes.opposite(resistor.source)
        for half, summing, source in zip("pn", grounds, both):
            ends = source, summing
            text.card(f"R{half}_{resistor.label}", ends, value, {}, counts_as="resistor")
    out = nodes.own(part.name, text.stage)
    ends = (out, nodes.opposite(out), *(() if isinstance(part, Adder) else ("rst",)))
    kind = KINDS[type(part)] + "_fd"
    text.card(f"X_{alias}", (*grounds, *ends), kind, feedback(values, text, part, alias))


def feedback(
    values: Values, text: CellText, part: Amplifier, alias: str, *, offset: bool = True
) -> dict[str, str]:
    """Parameters of an amplifier's cell: feedback resistor, capacitor, preset, offset."""
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


def inverter(nodes: Nodes, values: Values, text: CellText, name: str) -> None:
    """The other sign of a part's output."""
    alias, own = nodes.alias[name], nodes.own(name, text.stage)
    errors = {
        "r": number(values.circuit.inverter),
        "e": values.parameter(text, name, Quantity.INVERTER),
        "vos": values.parameter(text, name, Quantity.INVERTER_OFFSET),
    }
    text.card(f"Xn_{alias}", (own, nodes.opposite(own)), "inv", errors)
