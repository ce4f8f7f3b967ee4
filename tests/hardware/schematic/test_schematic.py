"""A schematic is the network again, as parts: which and how many."""

from functools import cache

import pytest
from designs import designed
from problems import SUITE

from ann_dc.errors import NetworkError
from ann_dc.gain_design import design
from ann_dc.hardware.schematic import Adder, Generator, Integrator, Multiplier, PICell, schematic_of
from ann_dc.network import Cell, Connection, Limiter, Network, Neuron
from ann_dc.network.metrics import Kind
from ann_dc.solver import synthesize


@cache
def car() -> Network:
    return design(synthesize(SUITE["car"].problem), kinds=(Kind.TIME_CONSTANTS,)).network


def test_parts_of_the_papers_cell():
    schematic = schematic_of(car())
    of_a_cell = {kind: schematic.count(kind) // 9 for kind in (Integrator, PICell, Adder)}
    assert of_a_cell == {Integrator: 10, PICell: 8, Adder: 0}  # 8 op amps are duals, sums and all
    assert schematic.count(Multiplier) == 90
    assert schematic.count(Generator) == 27
    assert len(schematic.inverted) <= 8  # inverters a cell


@pytest.mark.parametrize("name", ["double_integrator", "cstr", "lq_stable", "unicycle_obstacle"])
def test_any_network_of_the_suite_has_a_schematic(name):
    network = designed(name).network
    schematic = schematic_of(network)
    assert schematic.count(PICell) == len(network.cell.duals) * network.stages
    assert set(schematic.polarity.values()) <= {-1, 1}


def test_rails_are_refused():
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(high=1.0)),),
        connections=(Connection(source="one", target="x"),),
    )
    with pytest.raises(NetworkError, match="rails of x"):
        schematic_of(Network(cell=cell, stages=1))
