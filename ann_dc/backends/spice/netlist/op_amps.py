"""TODO: the idea."""

from __future__ import annotations

from ann_dc.backends.spice.netlist.cell_text import CellText
from ann_dc.backends.spice.netlist.deck import Writer
from ann_dc.hardware.circuit.elements import Adder, Integrator, PICell

KINDS = {Integrator: "integ", PICell: "pi_cell", Adder: "sum"}


def feedback(
    writer: Writer, text: CellText, part, stage: int, *, offset: bool = True
) -> dict[str, str]:
    """Parameters of an amplifier's cell: feedback resistor, capacitor, preset, offset."""
    alias, made = writer.alias[part.name], writer.made
    given: dict[str, str] = {}
    if part.name in made.feedback:
        given["rf"] = writer.value(text, f"rf_{alias}", stage, made.feedback[part.name])
    if part.name in made.capacitors:
        given["c"] = writer.value(text, f"c_{alias}", stage, made.capacitors[part.name][stage])
        given["v0"] = text.value(f"v0_{alias}", float(made.presets[part.name][stage]))
    if offset:
        given["vos"] = writer.value(text, f"vos_{alias}", stage)
    return given
