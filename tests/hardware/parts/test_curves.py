"""Function generators made of parts compute what they say, on paper and in ngspice."""

import re
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulator import needs_ngspice

from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.hardware.parts.curves import INSIDE, Breakpoints, Generated, Polynomial
from ann_dc.network.functions import FUNCTIONS, function_block
from ann_dc.resources import circuits_path

RANGES = {
    "sin": (-1.3, 1.3),
    "cos": (-0.38, 1.49),
    "tan": (-1.03, 1.0),
    "exp": (-2.0, 1.0),
    "log": (0.5, 2.0),
    "sqrt": (0.2, 2.0),
    "reciprocal": (0.5, 1.5),
    "tanh": (-1.5, 2.0),
    "sinh": (-2.0, 2.0),
    "cosh": (-1.0, 2.0),
    "atan": (-1.5, 1.5),
    "asin": (-0.8, 0.8),
    "acos": (-0.8, 0.8),
    "rectify": (-1.0, 1.0),
}
SMOOTH = [name for name in RANGES if name != "rectify"]
TRANSISTOR_ERROR = 6e-4
"""Of the Gilbert multipliers of a cascade, and of op amps of 70 dB behind diodes."""


def scales(name: str) -> tuple[float, float]:
    """Units per volt for voltages of about 1 V, the input inverted."""
    low, high = RANGES[name]
    f = function_block(name).value
    return -max(abs(low), abs(high)), float(np.abs(f(np.linspace(low, high, 101))).max())


@cache
def made(kind, name: str, sx_sign: int = 1, sy_sign: int = 1) -> Generated:
    sx, sy = scales(name)
    return kind().generator("curve", name, *RANGES[name], sx * sx_sign, sy * sy_sign)


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


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1)])
def test_a_polynomial_is_as_close_as_it_says(name, signs):
    sx, sy = np.multiply(scales(name), signs)
    generated = made(Polynomial, name, *signs)
    volts = np.linspace(*RANGES[name], 20_001) / sx
    error = cascade(generated.text, volts)["out"] - wanted(name, volts, sx, sy)
    largest = np.abs(wanted(name, volts, sx, sy)).max()
    assert np.abs(error).max() / largest <= 1.001 * generated.error + 1e-8
    assert generated.error <= Polynomial().tolerance


@pytest.mark.parametrize("name", SMOOTH)
def test_inner_nodes_stay_within_the_amplitude_of_the_input(name):
    low, high = RANGES[name]
    sx, _ = scales(name)
    nodes = cascade(made(Polynomial, name).text, np.linspace(low, high, 2001) / sx)
    inner = {node: v for node, v in nodes.items() if node not in ("x", "c", "out", "z_out")}
    assert max(np.abs(v).max() for v in inner.values()) <= max(abs(low), abs(high)) / abs(sx) + 1e-6


def test_errors_are_of_the_output():
    volts = np.linspace(*RANGES["cos"], 11) / scales("cos")[0]
    exact = cascade(made(Polynomial, "cos").text, volts)["out"]
    with_errors = cascade(made(Polynomial, "cos").text, volts, ge=0.1, oy=0.05)["out"]
    np.testing.assert_allclose(with_errors, 1.1 * exact + 0.05, rtol=1e-9)


@pytest.mark.parametrize(
    ("function", "half", "terms", "error", "multipliers"),
    [("sin", 1.3, 3, 1.9e-5, 4), ("cos", 1.3, 3, 2.0e-4, 3), ("tan", 0.75, 3, 2.2e-4, 4)],
)
def test_three_terms_suffice_for_the_papers_car(function, half, terms, error, multipliers):
    polynomial = Polynomial(tolerance=1.01 * error, most_terms=terms)
    generated = polynomial.generator("g", function, -half, half, half, 1.0)
    assert generated.error == pytest.approx(error, rel=0.05)
    assert generated.multipliers == multipliers
    assert generated.op_amps == generated.resistors == 0


# ---- the best polynomial ---------------------------------------------------------------------

ranges = st.tuples(st.floats(0.05, 0.85), st.floats(0.1, 0.9)).map(
    lambda pair: (pair[0], min(pair[0] + pair[1], 0.95))
)


@settings(max_examples=60, deadline=None)
@given(
    name=st.sampled_from([block.name for block in FUNCTIONS if block.name != "rectify"]),
    bounds=ranges,
    signs=st.tuples(st.sampled_from([-1, 1]), st.sampled_from([-1, 1])),
    tolerance=st.floats(1e-6, 1e-2),
)
def test_a_tolerance_is_kept_or_refused(name, bounds, signs, tolerance):
    sx, sy = 0.7 * signs[0], 1.4 * signs[1]
    try:
        generated = Polynomial(tolerance=tolerance).generator("g", name, *bounds, sx, sy)
    except NetworkError:
        with pytest.raises(NetworkError, match="8 terms"):  # one less accurate does no better
            Polynomial(tolerance=0.99 * tolerance).generator("g", name, *bounds, sx, sy)
        return
    volts = np.linspace(*bounds, 3001) / sx
    exact = wanted(name, volts, sx, sy)
    error = np.abs(cascade(generated.text, volts)["out"] - exact).max() / np.abs(exact).max()
    assert error <= 1.001 * generated.error + 2e-8  # nine digits are written
    assert generated.error <= tolerance


@pytest.mark.parametrize(("name", "degree"), [("exp", 4), ("log", 5), ("sqrt", 4), ("acos", 5)])
def test_the_error_alternates_between_equal_peaks(name, degree):
    """Chebyshev's theorem: degree + 2 peaks of equal size and alternating sign."""
    low, high = {"acos": (0.1, 0.8)}.get(name, RANGES[name])
    generated = Polynomial(tolerance=1.0, most_terms=2).generator("g", name, low, high, 1.0, 1.0)
    for terms in range(3, degree + 2):
        worst = generated.error
        generated = Polynomial(tolerance=0.999 * worst, most_terms=terms).generator(
            "g", name, low, high, 1.0, 1.0
        )
    assert generated.multipliers == degree
    places = low + (high - low) * (1 - np.cos(np.linspace(0, np.pi, 20_001))) / 2
    exact = wanted(name, places, 1.0, 1.0)
    error = (cascade(generated.text, places)["out"] - exact) / np.abs(exact).max()
    runs = np.split(error, np.flatnonzero(np.diff(np.sign(error))) + 1)
    peaks = np.array([np.abs(run).max() for run in runs])
    assert len(peaks) == degree + 2
    np.testing.assert_allclose(peaks, generated.error, rtol=0.02)


# ---- chords ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RANGES)
def test_chords_are_as_close_as_curvature_lets_them(name):
    """The best of n chords are off by (integral of sqrt |f''|)^2 / (16 n^2)."""
    low, high = RANGES[name]
    generated = made(Breakpoints, name)
    u = np.linspace(low, high, 4001)
    f = function_block(name).value(u)
    density = np.sqrt(np.abs(np.gradient(np.gradient(f, u), u)))
    bound = (density.mean() * (high - low)) ** 2 / (16 * 20**2) / np.abs(f).max()
    assert generated.error <= 1.15 * bound


@pytest.mark.parametrize("name", ["exp", "cos", "log"])
def test_twice_the_chords_have_a_quarter_of_the_error(name):
    sx, sy = scales(name)
    coarse, fine = (
        Breakpoints(segments=n).generator("g", name, *RANGES[name], sx, sy).error for n in (16, 32)
    )
    assert fine == pytest.approx(coarse / 4, rel=0.1)


@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
@pytest.mark.parametrize("name", ["sin", "cos", "exp"])
def test_parts_are_counted(kind, name):
    generated = made(kind, name)
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
    assert {cell for cell in count if count[cell]} <= {*kind.cells, "mul4q"}


# ---- in ngspice ------------------------------------------------------------------------------

LEVELS = {
    "ideal": "",
    "macro": ".param opamp_a0=1e6 opamp_gbw=10e6 opamp_sr=20e6 opamp_vsat=5 opamp_rout=1m"
    " mul_bw=10e6 mul_vsat=5 func_bw=10e6",
    "transistor": "",
}


def swept(generated: Generated, level: str, ends, given: str = "") -> tuple[np.ndarray, np.ndarray]:
    """Input and output volts of a DC sweep."""
    folder = circuits_path()
    files = [folder / "models" / level / f"{model}.lib" for model in ("opamp", "mul4q")]
    files += [folder / "cells" / f"{cell}.cir" for cell in Breakpoints.cells]
    low, high = sorted(ends)
    deck = [
        "* sweep",
        LEVELS[level],
        *(file.read_text() for file in files),
        generated.text,
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
def test_a_generator_computes_its_function(kind, level, name):
    generated = made(kind, name)
    sx, sy = scales(name)
    x, out = swept(generated, level, np.array(RANGES[name]) / sx)
    parts = {"ideal": 2e-6, "macro": 2e-5, "transistor": TRANSISTOR_ERROR}[level]
    assert np.abs(out - wanted(name, x, sx, sy)).max() <= generated.error + parts


@needs_ngspice
@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("name", ["exp", "tan"])
def test_polarities_and_errors_of_a_generator(kind, signs, name):
    generated = made(kind, name, *signs)
    sx, sy = np.multiply(scales(name), signs)
    x, out = swept(generated, "ideal", np.array(RANGES[name]) / sx, "ge=0.1 oy=0.05")
    exact = 1.1 * wanted(name, x, sx, sy) + 0.05
    assert np.abs(out - exact).max() <= 1.1 * generated.error + 2e-6


@needs_ngspice
def test_a_rectifier_is_made_of_rectifiers():
    generated = made(Breakpoints, "rectify")
    x, out = swept(generated, "ideal", (-1, 1))
    np.testing.assert_allclose(out, np.maximum(-x, 0), atol=1e-5)


# ---- what it refuses -------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
def test_the_same_generator_has_the_same_bytes(kind):
    sx, sy = scales("tan")
    again = kind().generator("curve", "tan", *RANGES["tan"], sx, sy)
    assert again.text == made(kind, "tan").text


@pytest.mark.parametrize("name", RANGES)
@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
def test_no_behavioural_source_is_written(kind, name):
    if kind is Polynomial and name == "rectify":
        return
    text = made(kind, name).text
    assert not re.search(r"^[BEGFH]", text, re.MULTILINE | re.IGNORECASE)
    assert text.splitlines()[1] == ".subckt curve x out params: ge=0 oy=0"
    assert text.splitlines()[-1] == ".ends curve"


def test_a_tolerance_out_of_reach_is_told():
    with pytest.raises(NetworkError) as error:
        Polynomial(tolerance=1e-5, most_terms=4).generator("g", "log", 0.1, 2.0, 1.0, 1.0)
    meaning = str(error.value)
    assert meaning.startswith("log over 0.1 .. 2: a polynomial of 4 terms is 0.0")
    assert "tolerance is 1e-05" in meaning
    assert "Breakpoints" in meaning


@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
@pytest.mark.parametrize(
    ("name", "given", "meaning"),
    [
        ("sin", (1.0, -1.0, 1.0, 1.0), "expected a range"),
        ("sin", (0.0, np.inf, 1.0, 1.0), "expected a range"),
        ("asin", (-2.0, 0.5, 1.0, 1.0), "expected a range within -1 .. 1"),
        ("log", (0.0, 1.0, 1.0, 1.0), "pole"),
        ("reciprocal", (-1.0, 2.0, 1.0, 1.0), "pole"),
        ("reciprocal", (-1.0, 1.0, 1.0, 1.0), "pole"),
        ("rectify", (-2.0, -1.0, 1.0, 1.0), "zero throughout"),
        ("sin", (-1.0, 1.0, 0.0, 1.0), "sx, sy"),
        ("sin", (-1.0, 1.0, 1.0, np.nan), "sx, sy"),
    ],
)
def test_ranges_and_scales_that_make_no_sense_are_refused(kind, name, given, meaning):
    with pytest.raises(NetworkError, match=meaning):
        kind().generator("g", name, *given)


def test_unknown_functions_and_numbers_out_of_range_are_refused():
    with pytest.raises(UnknownNameError, match="sin, cos, tan"):
        Polynomial().generator("g", "sine", -1.0, 1.0, 1.0, 1.0)
    with pytest.raises(NetworkError, match="tolerance"):
        Polynomial(tolerance=0.0)
    with pytest.raises(NetworkError, match="most_terms"):
        Polynomial(most_terms=1)
    with pytest.raises(NetworkError, match="segments"):
        Breakpoints(segments=0)
