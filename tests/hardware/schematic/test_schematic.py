"""A schematic is the network again, as parts: which and how many."""

from dataclasses import replace
from functools import cache

import clamped_runs
import numpy as np
import pytest
from constrained import integrator, v
from designs import designed, wired_with
from problems import SUITE

from ann_dc import levels, presets
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import NetworkError
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.schematic.elements import Adder, Generator, Integrator, Multiplier, PICell
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.solver import synthesize


@cache
def car() -> Network:
    return design(
        synthesize(SUITE["car"].problem), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network


def test_parts_of_the_papers_cell():
    schematic = schematic_of(car())
    of_a_cell = {kind: schematic.count(kind) // 9 for kind in (Integrator, PICell, Adder)}
    assert of_a_cell == {Integrator: 10, PICell: 8, Adder: 0}  # 8 op amps are duals, sums and all
    assert schematic.count(Multiplier) == 90
    assert schematic.count(Generator) == 27
    assert len(schematic.inverted) <= 8  # inverters a cell


@pytest.mark.parametrize(
    "name",
    [
        *("double_integrator", "cstr"),
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("lq_stable", "unicycle_obstacle")
        ),
    ],
)
def test_any_network_of_the_suite_has_a_schematic(name):
    network = designed(name).network
    schematic = schematic_of(network)
    assert schematic.count(PICell) == len(network.cell.duals) * network.stages
    assert set(schematic.polarity.values()) <= {-1, 1}


def with_limits() -> Network:
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(high=1.0)),),
        connections=(Connection(source="one", target="x"),),
    )
    return Network(cell=cell, stages=1)


def test_an_integrator_has_the_rails_of_its_neuron():
    (part,) = schematic_of(with_limits()).parts
    assert part.with_limits
    assert (part.limiter.low, part.limiter.high) == (-np.inf, 1.0)


@pytest.mark.parametrize(
    ("level", "reported"),
    [
        (levels.macro(differential=True), "use a level of single-ended op amps.*'macro'"),
        (
            presets.get("opa192_ad734"),
            "level opa192_ad734 has 10 V; .* or parts with that full scale: macro",
        ),
    ],
)
def test_levels_without_rails_say_which_has_them(level, reported):
    with pytest.raises(NetworkError, match=reported):
        SpiceBackend(level=level).prepare(with_limits())


def test_rails_that_no_part_has_are_refused():
    with pytest.raises(NetworkError, match="saturation limits of x cannot be built: differential"):
        schematic_of(with_limits(), differential=True)
    network = synthesize(SUITE["double_integrator"].problem)
    dual = network.cell.duals[0].neuron
    neurons = [
        replace(n, limiter=Limiter(low=-1.0)) if n.name == dual else n for n in network.cell.neurons
    ]
    with pytest.raises(
        NetworkError,
        match=f"saturation limits of {dual} cannot be built: only a separate integrator",
    ):
        schematic_of(replace(network, cell=replace(network.cell, neurons=tuple(neurons))))


@pytest.mark.parametrize(
    "kind", [PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION]
)
def test_rails_of_coupled_neurons_without_rows_are_refused(kind):
    network = clamped_runs.with_limits(wired_with("double_integrator", kind), 0.15, "u")
    reported = (
        rf"saturation limits of u\.a cannot be built: .* the {kind.value} couples u\.a to others; "
        ".*inequalities"
    )
    with pytest.raises(NetworkError, match=reported):
        schematic_of(network)


def limited_speed() -> Network:
    return synthesize(integrator(N=6, dt=0.3, bounds={v: (None, 0.7)}))


def test_a_diode_neuron_is_one_op_amp():
    """Residual, sum, rectifier and integrator; its diodes say with which sign it is carried."""
    network = limited_speed()
    schematic = schematic_of(network)
    (diode,) = network.cell.inequality_duals
    part = schematic.by_name[diode.multiplier]
    assert isinstance(part, PICell)
    assert part.rectified
    assert {wire.source for wire in part.wires} == {"q.v", "one"}
    assert not {diode.neuron, diode.residual, diode.sum} & schematic.by_name.keys()
    assert schematic.polarity[diode.multiplier] == -1
    np.testing.assert_allclose(part.tau[1:], part.rho[1:] / part.rate[1:])


def test_a_diode_neuron_of_which_something_else_reads_stays_apart():
    network = limited_speed()
    (diode,) = network.cell.inequality_duals
    more = Connection(source=diode.residual, target="q.x", weight=0.1)
    cell = replace(network.cell, connections=(*network.cell.connections, more))
    schematic = schematic_of(replace(network, cell=cell))
    assert isinstance(schematic.by_name[diode.multiplier], Generator)
    assert isinstance(schematic.by_name[diode.neuron], Integrator)
