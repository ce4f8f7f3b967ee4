"""Cards of transconductors: one a weight, or one for two weights that only differ in sign."""

from __future__ import annotations

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.backends.spice.netlist.op_amps import feedback, resettable
from ann_dc.backends.spice.netlist.values import Values
from ann_dc.hardware.parts.technologies import OtaC, paired
from ann_dc.hardware.schematic.elements import Adder, Amplifier, Integrator, PICell

OTA_KINDS = {Integrator: "ota_node", PICell: "ota_pi", Adder: "ota_sum"}
"""The library's cell of every part's node."""


def transconductors(
    nodes: Nodes, values: Values, text: CellText, part: Amplifier, built: OtaC, a0: float
) -> None:
    """Transconductors into the part's own node, and what loads it.

    Parameters
    ----------
    nodes, values, text, part
        As `op_amp` takes them.
    built : OtaC
        How linear they are.
    a0 : float
        Voltage gain of one into its own output resistance; infinite without one.
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
    loads = feedback(values, text, part, alias, offset=False)
    if np.isfinite(a0):
        total = sum(abs(gm) for _, _, gm in weights)
        loads["ro"] = text.value(f"ro_{alias}", a0 / max(total, 1e-300))
    text.card(f"X_{alias}", resettable(part, (out,)), OTA_KINDS[type(part)], loads)
