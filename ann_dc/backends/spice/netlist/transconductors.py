"""Cards of transconductors: one a weight, or one for two weights that only differ in sign."""

from __future__ import annotations

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.backends.spice.netlist.op_amps import feedback
from ann_dc.hardware.circuit.elements import Adder, Amplifier, Integrator, PICell
from ann_dc.hardware.parts.technologies import OtaC, paired


def transconductors(nodes: Nodes, built: OtaC, a0: float, text: CellText, part: Amplifier) -> None:
    """One transconductor a weight, or one for two that only differ in sign; ``a0`` is their gain."""
    alias, circuit = nodes.alias[part.name], nodes.circuit
    out = nodes.own(part.name, text.stage)
    range_ = number(built.linear_range * nodes.scaling.full_scale)
    weights = [
        (name, nodes.plain(source), -nodes.sign(source) / ohms)
        for name, source, ohms in nodes.resistors(part, text.stage)
    ]
    for name, between, gm in paired(weights):
        given = {"gm": text.value(name.replace("r_", "gm_", 1), gm), "vl": range_}
        kind = "ota" if len(between) == 1 else "ota_diff"
        text.card(f"Xw_{name[2:]}", (*between, out), kind, given)
    total = sum(abs(gm) for _, _, gm in weights)
    loads = feedback(nodes, text, part, offset=False)
    if np.isfinite(a0):
        ohms = a0 / max(total, 1e-300)
        loads["ro"] = text.value(f"ro_{alias}", ohms)
    kind = {Integrator: "ota_node", PICell: "ota_pi", Adder: "ota_sum"}[type(part)]
    ends = (out,) if part.name not in circuit.capacitors else (out, "rst")
    text.card(f"X_{alias}", ends, kind, loads)
