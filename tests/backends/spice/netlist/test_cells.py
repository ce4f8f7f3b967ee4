"""Cards and values of one cell: every parameter by its name, every card with one of its own."""

from functools import cache

import numpy as np
import pytest
from designs import small

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.cell_text import CellText
from ann_dc.backends.spice.netlist.cells import cell_of
from ann_dc.backends.spice.netlist.values import Nodes, Values
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.levels import macro, ota_c, switched_capacitor
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

TECHNOLOGIES = {
    "op amps": macro(),
    "differential": macro(differential=True),
    "transconductors": ota_c(a0=1e4),
    "switched capacitors": switched_capacitor(step=0.1),
}


@cache
def prepared(name: str):
    """A problem of the suite over four stages."""
    network = design(small(name), gain_rule=DIAGONAL_RULE).network
    return SpiceBackend(level=macro()).prepare(network)


def cells_of(circuit, level, deviations=None) -> list[CellText]:
    """The text of every cell."""
    values = Values(circuit=circuit, deviations=deviations or {})
    return [
        cell_of(Nodes(circuit), values, level, stage)
        for stage in range(circuit.schematic.network.stages)
    ]


@pytest.mark.parametrize("name", ["car", "double_integrator", "cstr"])
def test_a_cell_has_the_parameters_that_are_there(name):
    """A resistor to a neighbour that does not exist counts, but is not written."""
    circuit, _ = prepared(name)
    for stage, cell in enumerate(cells_of(circuit, macro())):
        written = {n for n in cell.values if not n.startswith("v0_")}
        present = {p.name for p in circuit.parameters if p.present[stage]}
        assert written <= present
        assert all(n.startswith("r_") for n in present - written)


@pytest.mark.parametrize("kind", Kind)
def test_a_deviation_changes_its_own_number_in_its_own_cell(kind):
    circuit, _ = prepared(
        "cstr" if kind in (Kind.GAIN, Kind.PRODUCT_OFFSET) else "double_integrator"
    )
    parameter = next(p for p in circuit.parameters if p.kind is kind)
    stage = int(np.flatnonzero(parameter.present)[-1])
    off = np.zeros(parameter.present.shape)
    off[stage] = 0.125
    plain_cells, moved_cells = (cells_of(circuit, macro(), d) for d in ({}, {parameter.name: off}))
    for k in range(len(off)):
        plain, moved = plain_cells[k].values, moved_cells[k].values
        changed = {name for name in plain if plain[name] != moved[name]}
        assert changed == ({parameter.name} if k == stage else set())
        if k == stage:
            nominal = plain[parameter.name]
            wanted = nominal * 1.125 if kind.value in ("resistor", "capacitor") else 0.125
            assert moved[parameter.name] == pytest.approx(wanted)


def pair(a: str, b: str) -> Network:
    """a' = b and b' = -a - b: one of both is inverted."""
    wires = ((a, b, -1.0), (b, a, 1.0), (b, b, -1.0), ("one", b, 0.5))
    cell = Cell(
        neurons=(Neuron(name=a), Neuron(name=b)),
        connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in wires),
    )
    return Network(cell=cell, stages=2)


NAMES = [
    *(("x", "y"), ("x", "n_x"), ("n_x", "x"), ("x", "x_0"), ("x_1", "x")),
    *(("f_x", "x"), ("x", "p_x"), ("p_x", "x"), ("X", "x b")),
]
"""Names of two neurons that look like each other, or like those of a card."""


@pytest.mark.sampled(19)
@pytest.mark.parametrize("level", TECHNOLOGIES.values(), ids=TECHNOLOGIES.keys())
@pytest.mark.parametrize(("a", "b"), NAMES)
def test_cards_of_a_cell_have_names_of_their_own(level, a, b):
    circuit, _ = SpiceBackend(level=level).prepare(pair(a, b))
    for cell in cells_of(circuit, level):
        cards = [line.split()[0].lower() for line in cell.lines if line[0] not in "*+"]
        assert len(set(cards)) == len(cards)
