"""A netlist: the same bytes, one cell many times, every parameter, and the parts that it takes."""

import re
from dataclasses import replace
from functools import cache

import pytest
from counting import counted
from designs import coordinated, small
from problems import SUITE

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.errors import NetworkError
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, ota_c, switched_capacitor
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.solver import synthesize


@cache
def prepared(name: str):
    network = design(
        synthesize(SUITE[name].problem), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    return SpiceBackend().prepare(network)


def written(name: str = "car", level=BEHAVIOURAL):
    circuit, probe = prepared(name)
    return deck_of(circuit, level, duration=float(probe.time[-1]))


def test_same_input_same_bytes():
    circuit, probe = prepared("car")
    again = deck_of(circuit, BEHAVIOURAL, duration=float(probe.time[-1]))
    assert again.text == written().text


def test_only_models_change_from_level_to_level():
    texts = [written(level=level).text for level in (BEHAVIOURAL, macro())]
    body = [text[text.index("* ---- cells") :] for text in texts]
    assert body[0] == body[1]


def test_one_cell_many_instances():
    text = written().text
    definitions = re.findall(r"^\.subckt (cell_\d+)", text, re.MULTILINE)
    instances = re.findall(r"^X_cell_\d+", text, re.MULTILINE)
    assert len(definitions) <= 3  # the two ends and the middle
    assert len(instances) == 9


def test_the_deck_says_which_node_is_which_neuron():
    text = written().text
    circuit, _ = prepared("car")
    unit = circuit.scaling.unit["q.phi"] * circuit.schematic.network.neuron("q.phi").scale.factor
    per_volt = circuit.schematic.polarity["q.phi"] * unit
    assert f"*   q.phi = {per_volt:.6g} * v(q_phi__<stage>)" in text


@pytest.mark.slow
def test_deck_length_is_linear_in_the_horizon():
    lengths = {}
    for n in (10, 20, 40):
        problem = replace(SUITE["double_integrator"].problem, horizon=n)
        network = design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network
        circuit, probe = SpiceBackend().prepare(network)
        text = deck_of(circuit, BEHAVIOURAL, duration=float(probe.time[-1])).text
        lengths[n] = len(text[text.index("* ---- cell array") :])
    assert (lengths[40] - lengths[20]) / (lengths[20] - lengths[10]) == pytest.approx(2, rel=0.1)


def test_a_name_with_a_line_break_is_refused():
    cell = Cell(
        neurons=(Neuron(name="x\n.control"),),
        connections=(
            Connection(source="x\n.control", target="x\n.control", weight=-1.0),
            Connection(source="one", target="x\n.control"),
        ),
    )
    circuit, _ = SpiceBackend().prepare(Network(cell=cell, stages=2))
    with pytest.raises(NetworkError, match="netlist"):
        deck_of(circuit, BEHAVIOURAL, duration=1.0)


# ---- parameters ----------------------------------------------------------------------------------


@cache
def short(name: str, differential: bool = False):
    """A circuit of a problem of the suite over four stages."""
    network = design(small(name), preconditioner=(PreconditionerKind.DIAGONAL,)).network
    return SpiceBackend(level=macro(differential=differential)).prepare(network)[0]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("differential", [False, True])
@pytest.mark.parametrize("name", ["car", "double_integrator", "cstr"])
def test_the_netlist_has_every_parameter_by_its_name(name, differential):
    level = macro(differential=differential)
    circuit = short(name, differential)
    text = deck_of(circuit, level, duration=1.0).text.replace("\n+ ", " ")
    heads = "".join(re.findall(r"^\.subckt cell_\d+ .*$", text, re.MULTILINE))
    written = set(re.findall(r" (\w+)=", heads))
    names = {p.name for p in circuit.parameters}
    assert names <= written
    assert {n for n in written - names if not n.startswith("v0_")} == set()


def test_an_error_that_cells_do_not_have_is_refused():
    with pytest.raises(NetworkError, match=r"vos_q_x: ota-c cells have no offset of q\.x's"):
        deck_of(
            short("double_integrator", True), ota_c(), duration=1.0, deviations={"vos_q_x": 1e-3}
        )


# ---- parts ---------------------------------------------------------------------------------------

LEVELS = {
    "behavioural": BEHAVIOURAL,
    "macro": macro(),
    "differential": macro(differential=True),
    "ota-c": ota_c(a0=1e4),
    "switched-capacitor": switched_capacitor(a0=1e6, step=0.1),
}


@pytest.mark.parametrize("plant", ["double_integrator", "car"])
@pytest.mark.parametrize("name", LEVELS)
def test_parts_are_those_of_the_netlist(name, plant):
    level = LEVELS[name]
    found = deck_of(short(plant, level.technology.differential), level, duration=1.0)
    assert found.parts == counted(found.text)
    assert all(type(count) is int and count > 0 for count in found.parts.values())


def test_parts_of_coordinators_are_those_of_the_netlist():
    circuit, _ = SpiceBackend(level=macro()).prepare(coordinated("double_integrator"))
    found = deck_of(circuit, macro(), duration=1.0)
    assert "X_coarse_2_x" in found.text
    assert found.parts == counted(found.text)
