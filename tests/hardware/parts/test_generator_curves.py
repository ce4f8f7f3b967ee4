"""Fits of function generators: as close as they say, and as close as theory lets them."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.polynomial import polynomial
from ranges import RANGES, SMOOTH

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.hardware.parts.generator_curves import (
    Breakpoints,
    FittedPolynomial,
    FittedQuotient,
    Polynomial,
)
from ann_dc.network.functions import function_block


def computed(fit: FittedPolynomial, u: np.ndarray) -> np.ndarray:
    """The polynomial at u, by its definition."""
    U = (u - fit.centre) / fit.half
    if not fit.parity:
        return polynomial.polyval(U, fit.powers)
    return polynomial.polyval(2 * U**2 - 1, fit.powers) * (U if fit.parity < 0 else 1.0)


def off(fit: FittedPolynomial, points: int) -> float:
    """Its largest error over the largest |f|."""
    u = np.linspace(fit.stretch.low, fit.stretch.high, points)
    exact = function_block(fit.stretch.function).value(u)
    return float(np.abs(computed(fit, u) - exact).max() / np.abs(exact).max())


# ---- the best polynomial ---------------------------------------------------------------------


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", SMOOTH)
def test_a_polynomial_is_as_close_as_it_says(name):
    fit = Polynomial().fit(name, *RANGES[name])
    assert off(fit, 20_001) <= 1.001 * fit.error + 1e-12
    assert fit.error <= Polynomial().tolerance


@pytest.mark.parametrize(("name", "parity"), [("sin", -1), ("cos", 1), ("exp", 0)])
def test_an_odd_or_even_function_takes_half_as_many_multipliers(name, parity):
    assert Polynomial().fit(name, -1.0, 1.0).parity == parity


@pytest.mark.parametrize(
    ("function", "half", "terms", "error", "multipliers"),
    [("sin", 1.3, 3, 1.9e-5, 4), ("cos", 1.3, 3, 2.0e-4, 3), ("tan", 0.75, 3, 2.2e-4, 4)],
)
def test_three_terms_suffice_for_the_papers_car(function, half, terms, error, multipliers):
    gain_rule = Polynomial(tolerance=1.01 * error, most_terms=terms)
    fit = gain_rule.fit(function, -half, half)
    assert fit.error == pytest.approx(error, rel=0.05)
    assert fit.multipliers == multipliers


ranges = st.tuples(st.floats(0.05, 0.85), st.floats(0.1, 0.9)).map(
    lambda pair: (pair[0], min(pair[0] + pair[1], 0.95))
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    name=st.sampled_from(SMOOTH),
    bounds=ranges,
    tolerance=st.floats(1e-6, 1e-2),
)
def test_a_tolerance_is_kept_or_refused(name, bounds, tolerance):
    try:
        fit = Polynomial(tolerance=tolerance).fit(name, *bounds)
    except NetworkError:
        with pytest.raises(NetworkError, match="8 terms"):  # one less accurate does no better
            Polynomial(tolerance=0.99 * tolerance).fit(name, *bounds)
        return
    if isinstance(fit, FittedQuotient):  # a divider, which is exact but for its parts
        assert name == "reciprocal"
        return
    assert off(fit, 3001) <= 1.001 * fit.error + 1e-12
    assert fit.error <= tolerance


@pytest.mark.parametrize(("name", "degree"), [("exp", 4), ("log", 5), ("sqrt", 4), ("acos", 5)])
def test_the_error_alternates_between_equal_peaks(name, degree):
    """Chebyshev's theorem: degree + 2 peaks of equal size and alternating sign."""
    low, high = {"acos": (0.1, 0.8)}.get(name, RANGES[name])
    fit = Polynomial(tolerance=1.0, most_terms=2).fit(name, low, high)
    for terms in range(3, degree + 2):
        fit = Polynomial(tolerance=0.999 * fit.error, most_terms=terms).fit(name, low, high)
    assert fit.multipliers == degree
    places = low + (high - low) * (1 - np.cos(np.linspace(0, np.pi, 20_001))) / 2
    exact = function_block(name).value(places)
    error = (computed(fit, places) - exact) / np.abs(exact).max()
    runs = np.split(error, np.flatnonzero(np.diff(np.sign(error))) + 1)
    peaks = np.array([np.abs(run).max() for run in runs])
    assert len(peaks) == degree + 2
    np.testing.assert_allclose(peaks, fit.error, rtol=0.02)


# ---- chords ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RANGES)
def test_chords_are_as_close_as_curvature_lets_them(name):
    """The best of n chords are off by (integral of sqrt |f''|)^2 / (16 n^2)."""
    low, high = RANGES[name]
    fit = Breakpoints().fit(name, low, high)
    u = np.linspace(low, high, 4001)
    f = function_block(name).value(u)
    density = np.sqrt(np.abs(np.gradient(np.gradient(f, u), u)))
    bound = (density.mean() * (high - low)) ** 2 / (16 * 20**2) / np.abs(f).max()
    assert fit.error <= 1.15 * bound


@pytest.mark.parametrize("name", ["exp", "cos", "log"])
def test_twice_the_chords_have_a_quarter_of_the_error(name):
    coarse, fine = (Breakpoints(segments=n).fit(name, *RANGES[name]).error for n in (16, 32))
    assert fine == pytest.approx(coarse / 4, rel=0.1)


# ---- what it refuses -------------------------------------------------------------------------


def test_a_tolerance_out_of_reach_is_told():
    with pytest.raises(NetworkError) as error:
        Polynomial(tolerance=1e-5, most_terms=4).fit("log", 0.1, 2.0)
    meaning = str(error.value)
    assert meaning.startswith("log over 0.1 .. 2: a polynomial of 4 terms is 0.0")
    assert "tolerance is 1e-05" in meaning
    assert "Breakpoints" in meaning


@pytest.mark.parametrize("kind", [Polynomial, Breakpoints])
@pytest.mark.parametrize(
    ("name", "given", "meaning"),
    [
        ("sin", (1.0, -1.0), "expected a range"),
        ("sin", (0.0, np.inf), "expected a range"),
        ("asin", (-2.0, 0.5), "expected a range within -1 .. 1"),
        ("log", (0.0, 1.0), "pole"),
        ("reciprocal", (-1.0, 2.0), "pole"),
        ("reciprocal", (-1.0, 1.0), "pole"),
        ("rectify", (-2.0, -1.0), "zero throughout"),
        ("sign", (-1.0, 2.0), "^sign over -1 .. 2: jumps near"),
        ("sign", (0.0, 2.0), "^sign over 0 .. 2: jumps near 0"),
        ("sign", (1.0, 2.0), "^sign over 1 .. 2: constant"),
    ],
)
def test_ranges_that_make_no_sense_are_refused(kind, name, given, meaning):
    with pytest.raises(NetworkError, match=meaning):
        kind().fit(name, *given)


def test_unknown_functions_and_numbers_out_of_range_are_refused():
    with pytest.raises(UnknownNameError, match="sin, cos, tan"):
        Polynomial().fit("sine", -1.0, 1.0)
    with pytest.raises(NetworkError, match="tolerance"):
        Polynomial(tolerance=0.0)
    with pytest.raises(NetworkError, match="most_terms"):
        Polynomial(most_terms=1)
    with pytest.raises(NetworkError, match="segments"):
        Breakpoints(segments=0)


# ---- a divider -------------------------------------------------------------------------------


@pytest.mark.parametrize("ends", [(0.46, 3.98), (0.21, 1.32), (-1.32, -0.21)])
def test_one_over_u_is_a_divider_where_no_polynomial_does(ends):
    fit = Polynomial().fit("reciprocal", *ends)
    assert isinstance(fit, FittedQuotient)
    assert (fit.stretch.low, fit.stretch.high, fit.error) == (*ends, 0.0)


def test_one_over_u_is_a_polynomial_where_one_does():
    assert isinstance(Polynomial().fit("reciprocal", 1.0, 2.0), FittedPolynomial)


def test_nothing_divides_by_zero():
    with pytest.raises(NetworkError):
        Polynomial().fit("reciprocal", -0.1, 1.0)
