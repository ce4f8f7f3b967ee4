"""Cards of transconductors: what pairs share is what single ones would bring."""

import re

import pytest
from designs import small

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.cells import cell_of
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.backends.spice.netlist.values import Values
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.recipe import WITHOUT_COORDINATORS
from ann_dc.hardware.parts.levels import ota_c


def test_pairs_and_single_ones_add_up_to_the_weights():
    """Whatever shares a pair, every source weighs -1 / R with the sign of its node."""
    network = design(small("car"), recipe=WITHOUT_COORDINATORS).network
    circuit, _ = SpiceBackend(level=ota_c()).prepare(network)
    nodes, values = Nodes(circuit), Values(circuit=circuit, deviations={})
    cell = cell_of(nodes, values, ota_c(), 2)
    cards = " \n".join(cell.lines).replace("\n+ ", "").splitlines()
    for part in circuit.schematic.parts:
        if part.name not in circuit.resistors:
            continue
        alias, found = circuit.alias[part.name], {}
        for card in cards:
            match = re.match(rf"X\w*?_{alias}_\d+ (.*) (ota|ota_diff) gm={{(\w+)}}", card)
            if match and match[1].split()[-1] == alias:
                gm, ends = cell.values[match[3]], match[1].split()[:-1]
                for node, sign in zip(ends, (1, -1)):
                    found[node] = found.get(node, 0.0) + sign * gm
        wanted: dict[str, float] = {}
        for resistor in values.resistors(nodes, part, 2):
            node = cell.ports[nodes.plain(resistor.source)]
            wanted[node] = wanted.get(node, 0.0) - nodes.sign(resistor.source) / resistor.ohms
        assert found == pytest.approx(wanted), part.name
