"""Multipliers that bend and let their inputs through, by the formula of their netlist."""

from functools import cache
from itertools import product

import numpy as np
import pytest
from simulator import needs_ngspice

from ann_dc.backends.spice import SpiceBackend, simulate
from ann_dc.backends.spice.netlist import Simulation
from ann_dc.evaluation import evaluator
from ann_dc.fidelity import predict
from ann_dc.gain_design import design
from ann_dc.hardware.circuit import ProbeRun, circuit_of, scale
from ann_dc.hardware.emulation import emulate
from ann_dc.hardware.parts import Datasheet, Parasitics, macro
from ann_dc.hardware.schematic import schematic_of
from ann_dc.network import Cell, Connection, Network, Neuron, Product
from ann_dc.network.metrics import Kind
from ann_dc.problem import plants
from ann_dc.solver import synthesize

BENT, THROUGH = 0.02, 0.01
OFF = {"ge_ab": 0.1, "ox_ab": 0.02, "oy_ab": -0.03, "oz_ab": 0.04}


def multiplied(signs: tuple[int, int, int]) -> Network:
    """z' = +- a b - z, of constants a and b of any sign that are neurons."""
    to_a, to_b, to_z = signs
    wires = (
        ("a", "a", -1.0),
        ("one", "a", to_a * 1.0),
        ("b", "b", -1.0),
        ("one", "b", to_b * 1.0),
        ("ab", "z", to_z * 1.0),
        ("z", "z", -1.0),
    )
    cell = Cell(
        neurons=tuple(Neuron(name=name) for name in "abz"),
        blocks=(Product(name="ab", a="a", b="b"),),
        connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in wires),
    )
    return Network(cell=cell, stages=1)


def built(network: Network, parasitics: Parasitics, **parts: float):
    """(Circuit, emulation) with 1.5 of a, 0.7 of b as full scale."""
    states = np.linspace(0, 1, 5)[:, None] * np.array([1.5, 0.7, 1.1])
    scaling = scale(network, ProbeRun(states=states, times=np.arange(5.0), radius=1.0))
    circuit = circuit_of(schematic_of(network), scaling)
    parts = Datasheet(a0=1e6, parasitics=parasitics, **parts)
    return circuit, emulate(circuit, macro(parts), OFF)


def product_of(circuit, a: float, b: float) -> float:
    """v(out) of ``circuits/models/board/mul4q.lib`` as the deck wires it, in network units."""
    sign, unit, vm = circuit.schematic.sign, circuit.scaling.unit, circuit.scaling.full_scale
    volts = {n: sign(n) * vm * v / unit[n] for n, v in (("a", a), ("b", b))}
    swapped = sign("a") * sign("b") * sign("ab") < 0
    x = (-volts["a"] if swapped else volts["a"]) + OFF["ox_ab"]
    y = volts["b"] + OFF["oy_ab"]
    t = x / vm
    X = x + BENT * vm * (4 * t**3 - 3 * t)
    out = (1 + OFF["ge_ab"]) * X * y / vm + OFF["oz_ab"] + THROUGH * (x + y)
    return sign("ab") * unit["ab"] / vm * out


@pytest.mark.parametrize("signs", list(product((1, -1), repeat=3)))
@pytest.mark.parametrize("parts", [{}, {"multiplier_rails": 10.0}, {"multiplier_bandwidth": 1e6}])
def test_a_product_is_that_of_the_netlist(signs, parts):
    worn = Parasitics(multiplier_nonlinearity=BENT, multiplier_feedthrough=THROUGH)
    circuit, emulation = built(multiplied(signs), worn, **parts)
    network = emulation.network
    a, b = signs[0] * 1.3, signs[1] * 0.6
    values = {"a": a, "b": b, "ab": product_of(circuit, a, b)}
    x = network.pack(
        np.array([[values.get(name, 0.0)] for name in network.neuron_index]) * np.ones((1, 1))
    )
    if "ab" in network.neuron_index:  # at rest behind its pole
        found = evaluator(network).rhs(x)[network.neuron_index["ab"]]
        assert found == pytest.approx(0.0, abs=1e-9)
    else:
        found = evaluator(network).node(x, "ab")[0]
        assert found == pytest.approx(values["ab"], rel=1e-12)


def test_no_straight_line_is_closer_than_the_one_that_was_left():
    """The best line through an input that is bent by d has slope 1, and is off by d."""
    t = np.linspace(-1.0, 1.0, 2001)
    bent = t + BENT * (4 * t**3 - 3 * t)
    off = [np.abs(bent - slope * t).max() for slope in np.linspace(0.97, 1.03, 61)]
    assert min(off) == pytest.approx(BENT, rel=1e-9)
    assert int(np.argmin(off)) == 30


# ---- in ngspice ----------------------------------------------------------------------------------


@cache
def network(name: str) -> Network:
    problem = {"car of 3": plants.car(N=3), "car": plants.car(N=9)}[name]
    return design(synthesize(problem), kinds=(Kind.TIME_CONSTANTS,)).network


EFFECTS = {
    "bent by 0.4 %": Parasitics(multiplier_nonlinearity=4e-3),
    "0.3 % of feedthrough": Parasitics(multiplier_feedthrough=3e-3),
    "all": Parasitics(
        multiplier_nonlinearity=4e-3, multiplier_feedthrough=3e-3, multiplier_capacitance=5e-12
    ),
}


CASES = [
    case if case == ("all", "car of 3", True) else pytest.param(*case, marks=pytest.mark.slow)
    for case in product(EFFECTS, ("car of 3", "car"), (False, True))
]


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(("effect", "name", "differential"), CASES)
def test_ngspice_finds_what_multipliers_were_to_do(effect, name, differential):
    parts = Datasheet(a0=1e6, multiplier_bandwidth=30e6, parasitics=EFFECTS[effect])
    level = macro(parts, differential=differential)
    backend = SpiceBackend(level=level, simulation=Simulation(points=1500))
    circuit, probe = backend.prepare(network(name))
    found = predict(circuit, level, probe)
    run = simulate(backend, circuit, probe)
    assert found.control_error == pytest.approx(run.control_error, rel=0.02)
    assert found.settling_time == pytest.approx(run.settling_time(), rel=0.05)
