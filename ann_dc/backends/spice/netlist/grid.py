"""Cards of a grid: resistors between pairs of nodes, a capacitor at each, and its follower.

The nodes of a pair carry v and -v. A resistor between two pairs is drawn twice, straight or across,
in the cell of one of them; what is missing to the conductance of a node goes to ground. Where it is
too much already, a negative resistance lies across the pair.
"""

from __future__ import annotations

from ann_dc.backends.spice.netlist.cell_text import CellText
from ann_dc.backends.spice.netlist.nodes import NEGATIVE, Nodes
from ann_dc.backends.spice.netlist.values import Values
from ann_dc.hardware.circuit.grid_values import begins, to_ground
from ann_dc.hardware.circuit.parameters import Quantity
from ann_dc.hardware.schematic.elements import GridNode, Wire
from ann_dc.hardware.schematic.metric_wiring import OWN


def grid_node(nodes: Nodes, values: Values, text: CellText, part: GridNode) -> None:
    """A pair of nodes, the resistors that it begins, and the follower.

    Parameters
    ----------
    nodes : Nodes
        Of the circuit.
    values : Values
        Of its parts, with their deviations.
    text : CellText
        The cell; cards are added to it.
    part : GridNode
        The part that they make up.
    """
    circuit, alias, stage = nodes.circuit, nodes.alias[part.name], text.stage
    here = _pair(nodes, part.name, stage)
    ohms, order = circuit.resistors[part.name], list(nodes.schematic.by_name)
    for number, wire in enumerate(part.wires):
        if wire.weight[stage] and begins(part, wire, order):
            there = _ends(nodes, part, wire, stage)
            value = text.value(f"rg_{alias}_{number}", float(ohms[number, stage]))
            for half, (a, b) in enumerate(zip(here, there)):
                name = f"Rg{half}_{alias}_{number}"
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
    else:  # across the pair: to ground it would let both nodes run away together
        text.card(
            f"Rg_{alias}", here, text.value(f"rg_{alias}", 2.0 / missing), {}, counts_as="negative"
        )
    out = nodes.own(part.name, stage)
    offset = {"vos": values.parameter(text, part.name, Quantity.OFFSET)}
    text.card(f"X_{alias}", (here[0], out, out), "opamp", offset, counts_as="follower")


def _pair(nodes: Nodes, name: str, stage: int) -> tuple[str, str]:
    """Top-level nodes of v and -v, with the sign of the part's output first."""
    plain = f"grid_{nodes.alias[name]}__{stage}"
    return plain, plain + NEGATIVE


def _ends(nodes: Nodes, part: GridNode, wire: Wire, stage: int) -> tuple[str, str]:
    """Where the two resistors of a wire lead to: from the node of v, and from that of -v."""
    polarity = nodes.schematic.polarity
    sign = 1 if wire.weight[stage] > 0 else -1
    if wire.source.startswith(OWN):
        wanted = sign * polarity[part.name]
        ends = [nodes.node(wire.source, stage + wire.offset, s * wanted) for s in (1, -1)]
        return ends[0], ends[1]
    there = _pair(nodes, wire.source, stage + wire.offset)
    same = sign * polarity[part.name] * polarity[wire.source] > 0
    return there if same else (there[1], there[0])
