"""Cards of op amps with resistors, single-ended and differential."""

from __future__ import annotations

from ann_dc.backends.spice.netlist.cell_text import CellText
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.hardware.circuit.elements import Adder, Amplifier, Integrator, PICell

KINDS = {Integrator: "integ", PICell: "pi_cell", Adder: "sum"}


def feedback(nodes: Nodes, text: CellText, part, *, offset: bool = True) -> dict[str, str]:
    """Parameters of an amplifier's cell: feedback resistor, capacitor, preset, offset."""
    alias, circuit = nodes.alias[part.name], nodes.circuit
    given: dict[str, str] = {}
    if part.name in circuit.feedback:
        given["rf"] = nodes.value(text, f"rf_{alias}", circuit.feedback[part.name])
    if part.name in circuit.capacitors:
        given["c"] = nodes.value(text, f"c_{alias}", circuit.capacitors[part.name][text.stage])
        given["v0"] = text.value(f"v0_{alias}", float(circuit.presets[part.name][text.stage]))
    if offset:
        given["vos"] = nodes.value(text, f"vos_{alias}")
    return given


def op_amp(nodes: Nodes, text: CellText, part: Amplifier) -> None:
    """Resistors into a summing node, and the op amp with its feedback."""
    alias = nodes.alias[part.name]
    summing = f"@s__{alias}"
    for name, source, ohms in nodes.resistors(part, text.stage):
        value = text.value(name, ohms)
        ends = source, summing
        text.card(name.replace("r_", "R_", 1), ends, value, {}, counts_as="resistor")
    out = nodes.own(part.name, text.stage)
    ends = (summing, out) if isinstance(part, Adder) else (summing, out, "rst")
    text.card(f"X_{alias}", ends, KINDS[type(part)], feedback(nodes, text, part))


def differential_pair(nodes: Nodes, text: CellText, part: Amplifier) -> None:
    """Each resistor twice, the second one from the other sign to the other summing node."""
    alias = nodes.alias[part.name]
    grounds = f"@sp__{alias}", f"@sn__{alias}"
    for name, source, ohms in nodes.resistors(part, text.stage):
        value = text.value(name, ohms)
        for half, summing, given in zip("pn", grounds, (source, nodes.opposite(source))):
            ends = given, summing
            text.card(f"R{half}_{name[2:]}", ends, value, {}, counts_as="resistor")
    out = nodes.own(part.name, text.stage)
    ends = (out, nodes.opposite(out), *(() if isinstance(part, Adder) else ("rst",)))
    kind = KINDS[type(part)] + "_fd"
    text.card(f"X_{alias}", (*grounds, *ends), kind, feedback(nodes, text, part))
