"""Function generators as cards: they compute their fits, on paper and in ngspice."""

import re
from functools import cache

import numpy as np
import pytest
from ranges import RANGES, SMOOTH
from simulator import needs_ngspice

from ann_dc.backends.spice.netlist.curves import CURVE_CELLS, INSIDE, Subcircuit, subcircuit_of
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.generator_curves import Breakpoints, Curve, Polynomial
from ann_dc.network.functions import function_block
from ann_dc.resources import circuits_path

TRANSISTOR_ERROR = 6e-4
"""Of the Gilbert multipliers of a cascade, and of op amps of 70 dB behind diodes."""


def scales(name: str) -> tuple[float, float]:
    """Units per volt for voltages of about 1 V, the input inverted."""
    low, high = RANGES[name]
    f = function_block(name).value
    return -max(abs(low), abs(high)), float(np.abs(f(np.linspace(low, high, 101))).max())


@cache
def fitted(kind, name: str) -> Curve:
    return kind().fit(name, *RANGES[name])


@cache
def generator(kind, name: str, sx_sign: int = 1, sy_sign: int = 1) -> Subcircuit:
    sx, sy = scales(name)
    return subcircuit_of("curve", fitted(kind, name), sx * sx_sign, sy * sy_sign)


def wanted(name: str, volts: np.ndarray, sx: float, sy: float) -> np.ndarray:
    return function_block(name).value(sx * volts) / sy


# ---- what is written, computed by hand -------------------------------------------------------


def expression(text: str, ge: float, oy: float) -> float:
    return float(eval(text.strip("{}"), {"__builtins__": {}}, {"ge": ge, "oy": oy}))


def cascade(text: str, x: np.ndarray, ge: float = 0.0, oy: float = 0.0) -> dict[str, np.ndarray]:
    """Voltages of all nodes, from the equation of every card."""
    cards = [line.split() for line in text.splitlines() if line[0] in "VX"]
    nodes = {"x": x, "0": np.zeros_like(x)}
    for card in [card for card in cards if card[0].startswith("V")]:
        assert card[2] == "0"
        nodes[card[1]] = np.full_like(x, expression(card[3], ge, oy))
    for _, x1, x2, y1, y2, z, out, cell, vm, gain in [card for card in cards if card[0][0] == "X"]:
        assert cell == "mul4q"
        product = (nodes[x1] - nodes[x2]) * (nodes[y1] - nodes[y2]) / float(vm.split("=")[1])
        assert out not in nodes
        nodes[out] = (1 + expression(gain.split("=")[1], ge, oy)) * product + nodes[z]
    return nodes


@pytest.mark.sampled(27)
@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1)])
def test_a_cascade_computes_its_polynomial(name, signs):
    sx, sy = np.multiply(scales(name), signs)
    volts = np.linspace(*RANGES[name], 20_001) / sx
    error = cascade(generator(Polynomial, name, *signs).text, volts)["out"] - wanted(
        name, volts, sx, sy
    )
    largest = np.abs(wanted(name, volts, sx, sy)).max()
    assert np.abs(error).max() / largest <= 1.001 * fitted(Polynomial, name).error + 1e-8


@pytest.mark.parametrize("name", SMOOTH)
def test_inner_nodes_stay_within_the_amplitude_of_the_input(name):
    low, high = RANGES[name]
    sx, _ = scales(name)
    nodes = cascade(generator(Polynomial, name).text, np.linspace(low, high, 2001) / sx)
    inner = {node: v for node, v in nodes.items() if node not in ("x", "c", "out", "z_out")}
    assert max(np.abs(v).max() for v in inner.values()) <= max(abs(low), abs(high)) / abs(sx) + 1e-6


def test_errors_are_of_the_output():
    volts = np.linspace(*RANGES["cos"], 11) / scales("cos")[0]
    exact = cascade(generator(Polynomial, "cos").text, volts)["out"]
    with_errors = cascade(generator(Polynomial, "cos").text, volts, ge=0.1, oy=0.05)["out"]
    np.testing.assert_allclose(with_errors, 1.1 * exact + 0.05, rtol=1e-9)


@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
@pytest.mark.parametrize("name", ["sin", "cos", "exp"])
def test_parts_are_counted(kind, name):
    generated = generator(kind, name)
    lines = generated.text.splitlines()
    count = {
        cell: sum(bool(re.search(rf"^X.* {cell} ", line)) for line in lines) for cell in INSIDE
    }
    cells = circuits_path() / "cells"
    resistors = {
        cell: len(re.findall(r"^R", (cells / f"{cell}.cir").read_text(), re.MULTILINE))
        for cell in ("breakpoint", "inv", "sum")
    }
    assert generated.multipliers == count["mul4q"]
    assert generated.op_amps == sum(count[cell] for cell in resistors)
    assert generated.resistors == sum(line.startswith("R") for line in lines) + sum(
        number * count[cell] for cell, number in resistors.items()
    )
    assert {cell for cell in count if count[cell]} <= {*CURVE_CELLS[kind], "mul4q"}


# ---- in ngspice ------------------------------------------------------------------------------

LEVELS = {
    "ideal": "",
    "macro": ".param opamp_a0=1e6 opamp_gbw=10e6 opamp_sr=20e6 opamp_vsat=5 opamp_rout=1m"
    " mul_bw=10e6 mul_vsat=5 func_bw=10e6",
    "transistor": "",
}


def swept(built: Subcircuit, level: str, ends, given: str = "") -> tuple[np.ndarray, np.ndarray]:
    """Input and output volts of a DC sweep."""
    folder = circuits_path()
    files = [folder / "models" / level / f"{model}.lib" for model in ("opamp", "mul4q")]
    files += [folder / "cells" / f"{cell}.cir" for cell in CURVE_CELLS[Breakpoints]]
    low, high = sorted(ends)
    deck = [
        "* sweep",
        LEVELS[level],
        *(file.read_text() for file in files),
        built.text,
        "V1 x 0 0",
        f"X1 x out curve {given}",
        ".options reltol=1e-6",
        f".dc V1 {low:.9g} {high:.9g} {(high - low) / 100:.9g}",
        ".save v(x) v(out)",
        ".end",
    ]
    raw = Ngspice(timeout=60).run("\n".join(deck) + "\n")
    return np.real(raw["x"]), np.real(raw["out"])


@needs_ngspice
@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ["sin", "cos", "tan", "exp", "sqrt"])
@pytest.mark.sampled(2)
def test_a_generator_computes_its_function(kind, level, name):
    generated = generator(kind, name)
    sx, sy = scales(name)
    x, out = swept(generated, level, np.array(RANGES[name]) / sx)
    parts = {"ideal": 2e-6, "macro": 2e-5, "transistor": TRANSISTOR_ERROR}[level]
    assert np.abs(out - wanted(name, x, sx, sy)).max() <= fitted(kind, name).error + parts


@pytest.mark.sampled(8)
@needs_ngspice
@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("name", ["exp", "tan"])
def test_polarities_and_errors_of_a_generator(kind, signs, name):
    generated = generator(kind, name, *signs)
    sx, sy = np.multiply(scales(name), signs)
    x, out = swept(generated, "ideal", np.array(RANGES[name]) / sx, "ge=0.1 oy=0.05")
    exact = 1.1 * wanted(name, x, sx, sy) + 0.05
    assert np.abs(out - exact).max() <= 1.1 * fitted(kind, name).error + 2e-6


@pytest.mark.sampled(2)
@needs_ngspice
@pytest.mark.parametrize("level", ["ideal", "transistor"])
@pytest.mark.parametrize(
    ("ends", "sx", "sy"),
    [((0.46, 3.98), 3.98, 2.17), ((0.21, 1.32), -1.32, 4.8), ((-1.32, -0.21), 1.32, 4.8)],
)
def test_a_divider_computes_one_over_u(level, ends, sx, sy):
    divider = subcircuit_of("curve", Polynomial().fit("reciprocal", *ends), sx, sy)
    assert (divider.multipliers, divider.op_amps) == (1, 1)
    x, out = swept(divider, level, np.array(ends) / sx, "ge=0.1 oy=0.05")
    exact = 1.1 * wanted("reciprocal", x, sx, sy) + 0.05
    assert np.abs(out - exact).max() <= {"ideal": 1e-6, "transistor": 2e-3}[level]


@needs_ngspice
def test_a_rectifier_is_made_of_rectifiers():
    generated = generator(Breakpoints, "rectify")
    x, out = swept(generated, "ideal", (-1, 1))
    np.testing.assert_allclose(out, np.maximum(-x, 0), atol=1e-5)


# ---- text ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
def test_the_same_generator_has_the_same_bytes(kind):
    sx, sy = scales("tan")
    again = subcircuit_of("curve", kind().fit("tan", *RANGES["tan"]), sx, sy)
    assert again.text == generator(kind, "tan").text


@pytest.mark.parametrize("name", RANGES)
@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
def test_no_behavioural_source_is_written(kind, name):
    if kind is Polynomial and name not in SMOOTH:
        return
    text = generator(kind, name).text
    assert not re.search(r"^[BEGFH]", text, re.MULTILINE | re.IGNORECASE)
    assert text.splitlines()[1] == ".subckt curve x out params: ge=0 oy=0"
    assert text.splitlines()[-1] == ".ends curve"


@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
@pytest.mark.parametrize("units", [(0.0, 1.0), (1.0, np.nan), (np.inf, 1.0)])
def test_units_that_make_no_sense_are_refused(kind, units):
    with pytest.raises(
        NetworkError, match=r"^sin over -1.3 .. 1.3: sx, sy: expected nonzero units"
    ):
        subcircuit_of("curve", fitted(kind, "sin"), *units)
