"""The area of a chip, against a sum by hand."""

import re
from dataclasses import replace

import pytest
from constrained import integrator, v

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.pdk.area import Area, area_of
from ann_dc.errors import FileFormatError
from ann_dc.gain_design.procedure import design
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize

LIBRARY = {
    "opamp": """.subckt opamp inp inn out params: c=10f vos=0
X1 d g s b sky130_fd_pr__nfet_g5v0d10v5 w=10 l=2 m=3
X2 c b e s sky130_fd_pr__npn_05v5_W1p00L1p00
R1 a b 4k
C1 a b 1.5p
C2 a b {2*c}
C3 a b 0.5u
.ends opamp""",
    "switch": """.subckt reset_gate a b
X1 a g b s sky130_fd_pr__nfet_g5v0d10v5 w=2 l=1
.ends reset_gate""",
}


DIODES = """.subckt pi_diode s out rst
X1 out out o sub sky130_fd_pr__npn_05v5_W1p00L1p00
X2 o o s sub sky130_fd_pr__npn_05v5_W1p00L1p00
.ends pi_diode"""


@pytest.fixture(scope="module")
def circuit():
    problem = synthesize(plants.double_integrator(N=2))
    network = design(problem, preconditioner=(PreconditionerKind.DIAGONAL,)).network
    return SpiceBackend().prepare(network)[0]


def test_areas_add_up():
    assert Area(transistors=1.0, resistors=2.0, capacitors=4.0).total == 7.0


def test_devices_are_counted_with_their_cells(circuit):
    found = area_of(circuit, {"op amps": 5}, LIBRARY)
    values = [value for row in circuit.capacitors.values() for value in row if value]
    assert found.transistors == pytest.approx(5 * (3 * 10 * 2 * 3 + 49) + len(values) * 2 * 3)
    assert found.capacitors == pytest.approx(
        (5 * (1.5e-12 + 20e-15 + 0.5e-6) + sum(values)) / 2e-15
    )


@pytest.mark.parametrize("value", ["{d}", "1.2.3", "some", "{1 +}"])
def test_a_value_that_is_no_number_is_refused_with_its_cell(circuit, value):
    broken = {"opamp": LIBRARY["opamp"].replace("4k", value), "switch": LIBRARY["switch"]}
    with pytest.raises(FileFormatError, match="subcircuit opamp: netlist: "):
        area_of(circuit, {"op amps": 5}, broken)


def test_diode_neurons_have_two_transistors_more():
    problem = synthesize(integrator(N=8, dt=0.25, bounds={v: (None, 0.65)}))
    network = design(problem, preconditioner=(PreconditionerKind.DIAGONAL,)).network
    circuit = SpiceBackend().prepare(network)[0]
    bare = re.sub("^X.*\n", "", DIODES, flags=re.MULTILINE)
    without, found = (
        area_of(circuit, {"op amps": 5}, library)
        for library in (LIBRARY | {"diodes": bare}, LIBRARY | {"diodes": DIODES})
    )
    drawn = [part for part in circuit.schematic.parts if getattr(part, "rectified", False)]
    diodes = sum(int(circuit.schematic.alive_at(part.name).sum()) for part in drawn)
    assert diodes >= 6, "one a stage where the speed is free"
    assert found.transistors - without.transistors == pytest.approx(diodes * 2 * 49)


def test_resistors_are_strips_of_poly(circuit):
    """100 kohm are 50 squares of 2 um by 2 um, each with 0.5 um to the next strip."""
    found = area_of(circuit, {"op amps": 5}, LIBRARY).resistors - 5 * 4e3 / 2e3 * 5.0
    larger = replace(
        circuit,
        resistors={name: 2 * ohms for name, ohms in circuit.resistors.items()},
        feedback={name: 2 * ohms for name, ohms in circuit.feedback.items()},
        inverter=2 * circuit.inverter,
    )
    twice = area_of(larger, {"op amps": 5}, LIBRARY).resistors - 5 * 4e3 / 2e3 * 5.0
    assert twice == pytest.approx(2 * found)
    one = replace(circuit, inverter=circuit.inverter + 1e5)
    added = area_of(one, {"op amps": 0}, LIBRARY).resistors
    inverters = sum(
        int(circuit.schematic.alive_at(name).sum()) for name in circuit.schematic.inverted
    )
    assert added - area_of(circuit, {"op amps": 0}, LIBRARY).resistors == pytest.approx(
        2 * inverters * 50 * 5.0
    )
