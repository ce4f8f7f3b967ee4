"""Every number that can be off: the same names in the netlist, and draws that stay put."""

import re
from functools import cache

import numpy as np
import pytest
from designs import small
from hypothesis import given
from hypothesis import strategies as st

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.deck import Writer, deck_of
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.recipe import WITHOUT_COORDINATORS
from ann_dc.hardware.circuit.deviations import checked, draw, parameters
from ann_dc.hardware.parts.datasheet import POSITIVE, Datasheet, Kind, Tolerances
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

PLANTS = ["car", "double_integrator", "cstr"]
FULL = Tolerances(resistor=0.01, capacitor=0.02, offset=1e-3, gain=0.03, product_offset=2e-3)


@cache
def prepared(name: str):
    network = design(small(name), recipe=WITHOUT_COORDINATORS).network
    return SpiceBackend(level=macro()).prepare(network)


@cache
def known(name: str):
    return parameters(prepared(name)[0])


# ---- names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANTS)
def test_names_are_unique_and_belong_to_parts(name):
    names = [p.name for p in known(name)]
    assert len(set(names)) == len(names)
    parts = {part.name for part in prepared(name)[0].schematic.parts}
    assert {p.part for p in known(name)} <= parts
    assert {p.kind for p in known(name)} >= {Kind.RESISTOR, Kind.CAPACITOR, Kind.OFFSET}
    assert all(p.there.shape == (4,) and p.there.any() for p in known(name))


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
    names = [p.name for p in parameters(circuit)]
    assert len(set(names)) == len(names)
    for cell in (Writer(circuit, macro(), {}).cell(stage) for stage in range(2)):
        cards = [line.split()[0].lower() for line in cell.lines if line[0] not in "*+"]
        assert len(set(cards)) == len(cards)


@pytest.mark.parametrize("differential", [False, True])
@pytest.mark.parametrize("name", PLANTS)
def test_the_netlist_has_every_parameter_by_its_name(name, differential):
    level = macro(differential=differential)
    circuit, probe = SpiceBackend(level=level).prepare(prepared(name)[0].schematic.network)
    text = deck_of(circuit, level, duration=float(probe.time[-1])).text.replace("\n+ ", " ")
    heads = "".join(re.findall(r"^\.subckt cell_\d+ .*$", text, re.MULTILINE))
    written = set(re.findall(r" (\w+)=", heads))
    names = {p.name for p in parameters(circuit)}
    assert names <= written
    assert {n for n in written - names if not n.startswith("v0_")} == set()


@pytest.mark.parametrize("name", PLANTS)
def test_a_cell_has_the_parameters_that_are_there(name):
    """A resistor to a neighbour that does not exist counts, but is not written."""
    circuit, _ = prepared(name)
    for stage in range(4):
        written = set(Writer(circuit, macro(), {}).cell(stage).values)
        written = {n for n in written if not n.startswith("v0_")}
        there = {p.name for p in known(name) if p.there[stage]}
        assert written <= there
        assert all(n.startswith("r_") for n in there - written)


@pytest.mark.parametrize("kind", Kind)
def test_a_deviation_changes_its_own_number_in_its_own_cell(kind):
    circuit, _ = prepared(
        "cstr" if kind in (Kind.GAIN, Kind.PRODUCT_OFFSET) else "double_integrator"
    )
    parameter = next(p for p in parameters(circuit) if p.kind is kind)
    stage = int(np.flatnonzero(parameter.there)[-1])
    off = np.zeros(parameter.there.shape)
    off[stage] = 0.125
    for k in range(len(off)):
        plain, moved = (
            Writer(circuit, macro(), d).cell(k).values for d in ({}, {parameter.name: off})
        )
        changed = {name for name in plain if plain[name] != moved[name]}
        assert changed == ({parameter.name} if k == stage else set())
        if k == stage:
            nominal = plain[parameter.name]
            wanted = nominal * 1.125 if kind.value in ("resistor", "capacitor") else 0.125
            assert moved[parameter.name] == pytest.approx(wanted)


# ---- draws ---------------------------------------------------------------------------------------


def same(a, b) -> bool:
    return a.keys() == b.keys() and all((a[name] == b[name]).all() for name in a)


@given(seed=st.integers(0, 2**32))
def test_the_same_seed_gives_the_same_errors_and_another_others(seed):
    first = draw(known("car"), FULL, seed)
    assert same(first, draw(known("car"), FULL, seed))
    other = draw(known("car"), FULL, seed + 1)
    assert not any((first[name] == other[name]).any() for name in first if known_all(name))


def known_all(name: str) -> bool:
    """Whether every cell of the car has that parameter."""
    return next(p for p in known("car") if p.name == name).there.all()


@pytest.mark.parametrize("kind", Kind)
def test_the_size_of_one_kind_leaves_the_other_kinds_as_they_are(kind):
    sizes = {k.value: getattr(FULL, k.value) for k in Kind}
    plain = draw(known("car"), FULL, 3)
    moved = draw(known("car"), Tolerances(**(sizes | {kind.value: 2 * sizes[kind.value]})), 3)
    for p in known("car"):
        factor = 2.0 if p.kind is kind else 1.0
        np.testing.assert_array_equal(moved[p.name], factor * plain[p.name])
    without = draw(known("car"), Tolerances(**(sizes | {kind.value: 0.0})), 3)
    rest = {name for name in plain if next(p for p in known("car") if p.name == name).kind is kind}
    assert without.keys() == plain.keys() - rest
    assert same(without, {name: plain[name] for name in without})


def test_no_spread_draws_nothing():
    assert draw(known("car"), Tolerances(), 1) == {}


def test_errors_are_normal_and_where_the_parts_are():
    drawn = [draw(known("car"), FULL, seed) for seed in range(30)]
    for kind in Kind:
        mine = [p for p in known("car") if p.kind is kind]
        errors = np.concatenate([d[p.name][p.there] for d in drawn for p in mine])
        size = getattr(FULL, kind.value)
        assert errors.std() == pytest.approx(size, rel=4 / np.sqrt(2 * len(errors)))
        assert abs(errors.mean()) < 4 * size / np.sqrt(len(errors))
        assert all((d[p.name][~p.there] == 0).all() for d in drawn for p in mine)


# ---- what is refused -----------------------------------------------------------------------------


def test_one_number_stands_for_all_cells():
    found = checked(known("car"), {"vos_q_x": 1e-3})
    np.testing.assert_array_equal(found["vos_q_x"], np.full(4, 1e-3))


@pytest.mark.parametrize(
    ("given", "error", "meaning"),
    [
        ({"vos_nothing": 0.0}, UnknownNameError, "vos_nothing.*does not exist.*vos_q_x"),
        ({"vos_q_x": np.nan}, NetworkError, "vos_q_x: expected finite"),
        ({"r_q_x_0": np.inf}, NetworkError, "r_q_x_0: expected finite"),
        ({"r_q_x_0": [0, 0, -1.0, 0]}, NetworkError, "r_q_x_0: expected finite numbers above -1"),
        ({"c_q_x": -2.0}, NetworkError, "c_q_x: expected finite numbers above -1"),
    ],
)
def test_a_deviation_that_makes_no_sense_is_named(given, error, meaning):
    with pytest.raises(error, match=meaning):
        checked(known("car"), given)


@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("value", [-1e-3, np.nan, np.inf])
def test_a_spread_out_of_range_is_named(kind, value):
    with pytest.raises(NetworkError, match=f"spread, {kind.value}: expected"):
        Tolerances(**{kind.value: value})


@pytest.mark.parametrize("name", POSITIVE)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_hardware_out_of_range_is_named(name, value):
    with pytest.raises(NetworkError, match=f"^{name}: expected"):
        Datasheet(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"), [("gbw", np.inf), ("gbw", 0.0), ("rout", -1.0), ("rout", np.inf)]
)
def test_hardware_that_sets_the_time_scale_or_a_load_is_finite(name, value):
    with pytest.raises(NetworkError, match=f"^{name}: expected"):
        Datasheet(**{name: value})


def test_network_time_follows_the_op_amps_or_three_times_slower_multipliers():
    assert Datasheet(gbw=5e6).usable_bandwidth == 5e6
    assert Datasheet(gbw=5e6, multiplier_bandwidth=1e6).usable_bandwidth == 3e6
    assert Datasheet(gbw=5e6, function_bandwidth=1e6).usable_bandwidth == 3e6
