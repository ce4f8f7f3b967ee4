"""Every number that can be off has one name, and names stay apart."""

from functools import cache

import pytest
from designs import small

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import NetworkError
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.circuit import RESERVED, Quantity, aliases
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

PLANTS = ["car", "double_integrator", "cstr"]


@cache
def prepared(name: str):
    network = design(small(name), gain_rule=DIAGONAL_RULE).network
    return SpiceBackend(level=macro()).prepare(network)


@cache
def known(name: str):
    return prepared(name)[0].parameters


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", PLANTS)
def test_names_are_unique_and_belong_to_parts(name):
    names = [p.name for p in known(name)]
    assert len(set(names)) == len(names)
    parts = {part.name for part in prepared(name)[0].schematic.parts}
    assert {p.part for p in known(name)} <= parts
    assert {p.kind for p in known(name)} >= {Kind.RESISTOR, Kind.CAPACITOR, Kind.OFFSET}
    assert all(p.present.shape == (4,) and p.present.any() for p in known(name))


def test_a_name_is_that_of_a_quantity_of_a_part():
    circuit, _ = prepared("car")
    for parameter in circuit.parameters:
        part, quantity, wire = parameter.part, parameter.quantity, parameter.wire
        assert parameter.name == circuit.parameter_name(part, quantity, wire)
        assert (wire is not None) == (quantity is Quantity.INPUT)
    by_name = {parameter.name: parameter for parameter in circuit.parameters}
    assert by_name["r_q_x_0"].meaning.endswith("to q.x")
    assert by_name["vos_q_x"].owner == "q.x's op amp"


def hostile(a: str, b: str) -> Network:
    """a' = b and b' = -a - b: one of both is inverted."""
    wires = ((a, b, -1.0), (b, a, 1.0), (b, b, -1.0), ("one", b, 0.5))
    cell = Cell(
        neurons=(Neuron(name=a), Neuron(name=b)),
        connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in wires),
    )
    return Network(cell=cell, stages=2)


@pytest.mark.parametrize(
    ("a", "b"), [("x", "n_x"), ("n_x", "x"), ("x", "x_0"), ("f_x", "x"), ("x", "p_x"), ("X", "x b")]
)
def test_names_that_look_like_each_other_stay_apart(a, b):
    circuit, _ = SpiceBackend(level=macro()).prepare(hostile(a, b))
    names = [p.name for p in circuit.parameters]
    assert len(set(names)) == len(names)


def test_an_alias_is_no_name_that_a_netlist_needs():
    found = aliases([*RESERVED, "q.x", "Q x"])
    assert set(RESERVED).isdisjoint(found.values())
    assert len(set(found.values())) == len(found)


@pytest.mark.parametrize("name", ["x\n.control", "x" * 201])
def test_a_name_that_no_netlist_can_carry_is_refused(name):
    with pytest.raises(NetworkError, match="cannot be written into a netlist"):
        aliases([name])
