"""Multipliers that bend and let their inputs through, by the formula of their netlist."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval
from simulator import needs_ngspice

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.netlist.curves import Subcircuit, subcircuit_of
from ann_dc.backends.spice.netlist.timing import Simulation
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.evaluation.reference import evaluator
from ann_dc.fidelity.prediction import predict
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.circuit import Circuit, circuit_of
from ann_dc.hardware.circuit.loads import loads_of
from ann_dc.hardware.circuit.scaling import ProbeRun, built_range, scale, slopes_of
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.generator_curves import FittedQuotient, Polynomial, cascade_of
from ann_dc.hardware.parts.levels import TRANSISTOR, Level, macro
from ann_dc.hardware.parts.parasitics import MultiplierLaw, Parasitics
from ann_dc.hardware.schematic.elements import Generator
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.network.cell import Cell, Connection, Function, Neuron, Product
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.resources import circuits_path
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
@pytest.mark.parametrize(
    "parts", [{}, {"multiplier_output_swing": 10.0}, {"multiplier_bandwidth": 1e6}]
)
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


# ---- the law of transistors ----------------------------------------------------------------------

POLYNOMIAL = replace(macro(), functions=Polynomial(most_terms=10))
LAW = MultiplierLaw(
    gain=(0.01, 0.02, 0.0), gain_y=(0.0, 0.015, 0.01), gain_o=(0.0, 0.012, 0.02),
    bend_x=(-0.03, 0.0, 0.0), bend_y=(0.0, 0.04, 0.0), tilt_x=0.05,
    tilt_y=-0.06, bow=(0.07, 0.01, 0.02), offset=(0.02, 0.0, 0.01),
    input_current=1e-3, output_resistance=50.0,
)  # fmt: skip


@pytest.mark.parametrize("signs", list(product((1, -1), repeat=3)))
def test_a_product_follows_the_law_of_its_multiplier(signs):
    circuit, emulation = built(multiplied(signs), Parasitics(), multiplier_law=LAW)
    network, vm = emulation.network, circuit.scaling.full_scale
    a, b = signs[0] * 1.3, signs[1] * 0.6
    values = {"a": a, "b": b}
    x = network.pack(np.array([[values.get(name, 0.0)] for name in network.neuron_index]))
    sign, unit = circuit.schematic.sign, circuit.scaling.unit
    volts = {n: sign(n) * vm * v / unit[n] for n, v in values.items()}
    swapped = sign("a") * sign("b") * sign("ab") < 0
    X = (-volts["a"] if swapped else volts["a"]) + OFF["ox_ab"]
    Y = volts["b"] + OFF["oy_ab"]
    common = -X if swapped else X, Y
    law, t = LAW.at(vm), X * Y / vm
    slope = law.gain[0] + law.gain_y[0] + law.gain_o[0]
    slope += law.bend_x[0] * (X / vm) ** 2 + law.bend_y[0] * (Y / vm) ** 2
    slope += law.tilt_x * common[0] + law.tilt_y * common[1] + law.bow[0] * t
    share = 1 / (1 + 50.0 * loads_of(circuit)["ab", False][0])
    out = share * (1 + OFF["ge_ab"]) * t * (1 + slope) + OFF["oz_ab"] + law.offset[0]
    wanted = sign("ab") * unit["ab"] / vm * out
    assert evaluator(network).node(x, "ab")[0] == pytest.approx(wanted, rel=1e-12)


def test_what_multipliers_draw_lowers_what_drives_them():
    """Two inputs, 1 mA each, at outputs of 1 kohm over a gain of 1e6, are as 2 uV of offset."""
    parts = {"multiplier_law": MultiplierLaw(input_current=1e-3), "stage_resistance": 1e3}
    circuit, drawn = built(multiplied((1, 1, 1)), Parasitics(), **parts)
    moved = {name: OFF.get(name, 0.0) for name in OFF} | {"vos_a": -1e-6, "vos_b": -1e-6}
    level = macro(Datasheet(a0=1e6, stage_resistance=1e3))
    known = emulate(circuit, level, moved).network
    states = np.linspace(0.1, 1.0, known.size)
    found = evaluator(drawn.network).rhs(states)
    np.testing.assert_allclose(found, evaluator(known).rhs(states), rtol=1e-12)


def generated(
    function: str, signs: tuple[int, int], low: float = -0.2
) -> tuple[Circuit, Generator]:
    """z' = +- f(x) - z, x a constant of either sign that is a neuron; and its generator."""
    to_x, to_z = signs
    wires = (("x", "x", -1.0), ("one", "x", to_x), ("f", "z", to_z), ("z", "z", -1.0))
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="z")),
        blocks=(Function(name="f", function=function, x="x"),),
        connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in wires),
    )
    network = Network(cell=cell, stages=1, start={"x": float(to_x)})
    states = np.linspace(low, 1.0, 9)[:, None] * np.array([to_x, 0.8])
    scaling = scale(network, ProbeRun(states=states, times=np.arange(9.0), radius=1.0))
    circuit = circuit_of(schematic_of(network), scaling)
    (part,) = (part for part in circuit.schematic.parts if isinstance(part, Generator))
    return circuit, part


def curve_of(circuit: Circuit, level: Level, u: float) -> float:
    """What the emulation makes of u, in network units."""
    network = emulate(circuit, level).network
    state = [[u if name == "x" else 0.0] for name in network.neuron_index]
    return evaluator(network).node(network.pack(np.array(state)), "curve.f")[0]


@pytest.mark.parametrize("function", ["sin", "cos", "tan", "exp"])
@pytest.mark.parametrize("signs", list(product((1, -1), repeat=2)))
def test_a_generator_of_multipliers_is_their_polynomial(function, signs):
    circuit, part = generated(function, signs)
    low, high = built_range(part, circuit.scaling)
    fit = POLYNOMIAL.functions.fit(function, low, high)
    for u in np.linspace(low, high, 7):
        U = (u - fit.centre) / fit.half
        W = 2 * U**2 - 1 if fit.parity else U
        wanted = polyval(W, fit.powers) * (U if fit.parity < 0 else 1.0)
        assert curve_of(circuit, POLYNOMIAL, u) == pytest.approx(wanted, abs=1e-12)


def drawing(**law: float) -> Level:
    """Transistors without defects, but for those of a law of their multipliers."""
    return replace(TRANSISTOR, datasheet=Datasheet(a0=1e12, multiplier_law=MultiplierLaw(**law)))


def test_inner_nodes_of_a_cascade_drop_by_the_current_of_their_reader():
    """By 10 mV each, which the steps behind them multiply."""
    circuit, part = generated("exp", (1, 1))
    sx, sy = slopes_of(circuit.schematic, circuit.scaling, part)
    fit = TRANSISTOR.functions.fit("exp", *built_range(part, circuit.scaling))
    gains = [float(step.gain) for step in cascade_of(fit, sx, sy).steps]
    assert len(gains) > 2
    for u in (0.0, 0.7):
        off, share = 0.0, (u - fit.centre) / fit.half
        for gain in gains:
            off = gain * share * off - 10e-3
        reported = curve_of(circuit, drawing(input_current=1e-3, output_resistance=10.0), u)
        assert reported - curve_of(circuit, drawing(), u) == pytest.approx(
            (off + 10e-3) * sy, rel=1e-6
        )


def test_multiplier_of_a_divider_loses_what_its_load_takes():
    circuit, _ = generated("reciprocal", (1, 1), 0.3)
    reported = curve_of(circuit, drawing(output_resistance=50.0), 0.7)
    assert reported == pytest.approx((2 - 1 / (1 + 50.0 / 50e3)) / 0.7, rel=1e-9)


@needs_ngspice
@pytest.mark.parametrize("function", ["sin", "cos", "exp"])
@pytest.mark.parametrize("signs", [(1, 1), (-1, -1)])
def test_a_generator_of_transistors_is_what_ngspice_finds(function, signs):
    circuit, part = generated(function, signs)
    ends = np.array(built_range(part, circuit.scaling))
    sx, sy = slopes_of(circuit.schematic, circuit.scaling, part)
    fit = TRANSISTOR.functions.fit(function, *ends)
    x, out = swept(subcircuit_of("curve", fit, sx, sy), *(ends / sx))
    found = np.array([curve_of(circuit, TRANSISTOR, sx * volts) / sy for volts in x])
    polynomial = np.array([curve_of(circuit, POLYNOMIAL, sx * volts) / sy for volts in x])
    assert np.linalg.norm(out - found) < 0.15 * np.linalg.norm(out - polynomial)
    assert np.abs(out - found).max() < 5e-5


@needs_ngspice
@pytest.mark.parametrize(
    ("signs", "low"),
    [
        ((1, 1), 0.22),
        *(
            pytest.param(signs, low, marks=pytest.mark.slow)
            for signs, low in (((1, -1), 0.3), ((-1, 1), 0.22), ((-1, -1), 0.3))
        ),
    ],
)
def test_a_divider_of_transistors_is_what_ngspice_finds(signs, low):
    circuit, part = generated("reciprocal", signs, low)
    ends = np.array(built_range(part, circuit.scaling))
    sx, sy = slopes_of(circuit.schematic, circuit.scaling, part)
    fit = TRANSISTOR.functions.fit("reciprocal", *ends)
    assert isinstance(fit, FittedQuotient)
    load = float(1 / loads_of(circuit)["f", False][0])
    seen = signs[0] * np.array([low, 1.0])
    x, out = swept(subcircuit_of("curve", fit, sx, sy), *(seen / sx), load)
    exact = 1 / (sx * x) / sy
    found = np.array([curve_of(circuit, TRANSISTOR, sx * volts) / sy for volts in x])
    assert np.linalg.norm(out - found) < 0.1 * np.linalg.norm(out - exact)


def swept(
    built: Subcircuit, low: float, high: float, load: float = 1e12
) -> tuple[np.ndarray, np.ndarray]:
    """Input and output volts of a generator of transistors into a load, in ngspice."""
    models = [circuits_path() / "models" / "transistor" / f"{n}.lib" for n in ("opamp", "mul4q")]
    low, high = sorted((low, high))
    deck = [
        *("* sweep", *(file.read_text() for file in models), built.text, "V1 x 0 0"),
        *(
            "X1 x out curve",
            f"R1 out 0 {load:.9g}",
            ".options reltol=1e-7 vntol=1e-9",
            ".save v(x) v(out)",
        ),
        f".dc V1 {low:.9g} {high:.9g} {(high - low) / 20:.9g}",
        ".end\n",
    ]
    raw = Ngspice(timeout=60).run("\n".join(deck))
    return np.real(raw["x"]), np.real(raw["out"])


# ---- in ngspice ----------------------------------------------------------------------------------


@cache
def network(name: str) -> Network:
    problem = {"car of 3": plants.car(N=3), "car": plants.car(N=9)}[name]
    return design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network


EFFECTS = {
    "nonlinearity 0.4 %": Parasitics(multiplier_nonlinearity=4e-3),
    "feedthrough 0.3 %": Parasitics(multiplier_feedthrough=3e-3),
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
    backend = SpiceBackend(level=level, simulation=Simulation(points=6000))
    circuit, probe = backend.prepare(network(name))
    found = predict(circuit, level, probe)
    run = simulate(backend, circuit, probe)
    assert found.control_error == pytest.approx(run.control_error, rel=0.02)
    assert found.settling_time == pytest.approx(run.settling_time(), rel=0.05)
