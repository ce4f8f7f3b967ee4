"""Cards of switched capacitors: a branch a weight, into an op amp with the unit capacitor across it."""

from __future__ import annotations

from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.backends.spice.netlist.op_amps import op_amp
from ann_dc.hardware.circuit.elements import Adder, Amplifier, PICell
from ann_dc.hardware.parts.technologies import SwitchedCapacitors


def switched_capacitors(
    nodes: Nodes, built: SwitchedCapacitors, text: CellText, part: Amplifier
) -> None:
    """A branch a weight, into an op amp with the unit capacitor across it."""
    alias, circuit = nodes.alias[part.name], nodes.circuit
    if isinstance(part, Adder):
        op_amp(nodes, text, part)
        return
    summing, out = f"@s__{alias}", nodes.own(part.name, text.stage)
    unit = built.unit_capacitor
    per_period = built.step * nodes.scaling.time
    for name, source, ohms in nodes.resistors(part, text.stage):
        plain = nodes.opposite(source)  # a branch does not invert, a static capacitor does
        ratio = per_period / (ohms * circuit.capacitors[part.name][text.stage])
        sampled = {
            "c": text.value(name.replace("r_", "cs_", 1), ratio * unit),
            "ron": number(built.on_resistance),
            "cov": number(built.overlap),
        }
        ends = (plain, summing, "p1", "p2")
        text.card(f"Xw_{name[2:]}", ends, "sc_branch", sampled)
        if isinstance(part, PICell):
            static = unit * nodes.off(f"rf_{alias}", text.stage, circuit.feedback[part.name]) / ohms
            given = {"c": text.value(name.replace("r_", "cp_", 1), static)}
            text.card(f"Xp_{name[2:]}", (source, summing), "sc_static", given)
    start = float(circuit.presets[part.name][text.stage])
    if isinstance(part, PICell):
        start = nodes.start_volts(part.name, text.stage)
    given = {
        "c": nodes.value(text, f"c_{alias}", unit),
        "v0": text.value(f"v0_{alias}", start),
        "vos": nodes.value(text, f"vos_{alias}"),
    }
    text.card(f"X_{alias}", (summing, out, "rst"), "sc_integ", given)
