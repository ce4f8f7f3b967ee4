"""Expressions as text: what is read back is what was written, whatever its size."""

from functools import reduce

import pytest
import sympy as sp
from hypothesis import given, settings, strategies as st

from ann_dc.errors import ExpressionError
from ann_dc.problem.expression import FUNCTIONS
from ann_dc.problem.serialisation import IN_OTHER_WORDS, expression_of, lines_of

x, y, z = sp.symbols("x y z")
SYMBOLS = {"x": x, "y": y, "z": z}


def through_text(expression):
    return expression_of(lines_of(sp.sympify(expression)), SYMBOLS, "cost")


NUMBERS = st.one_of(
    st.integers(-9, 9).map(sp.Integer),
    st.fractions(-5, 5, max_denominator=12).map(lambda f: sp.Rational(f.numerator, f.denominator)),
    st.floats(-1e3, 1e3).filter(lambda value: not 0 < abs(value) < 1e-9).map(sp.Float),
)
EXPONENTS = st.sampled_from((2, 3, -1, -2, sp.S.Half, -sp.S.Half, sp.Rational(2, 3), 1.5, -2.5))


def grown(inner):
    return st.one_of(
        st.lists(inner, min_size=2, max_size=6).map(lambda parts: sp.Add(*parts)),
        st.lists(inner, min_size=2, max_size=5).map(lambda parts: sp.Mul(*parts)),
        st.tuples(inner, EXPONENTS).map(lambda pair: sp.Pow(1 + pair[0] ** 2, pair[1])),
        st.tuples(st.sampled_from((sp.sin, sp.cos, sp.tanh, sp.atan, sp.exp)), inner).map(
            lambda pair: pair[0](pair[1] / 1000)
        ),
    )


def is_ordinary(expression):
    """No infinity, of doubles either, and no imaginary number: a problem takes none."""
    is_finite = all(abs(number) < 1e300 for number in expression.atoms(sp.Number))
    return is_finite and not expression.has(sp.nan, sp.zoo, sp.oo, -sp.oo, sp.I)


EXPRESSIONS = st.recursive(st.one_of(NUMBERS, st.sampled_from((x, y, z))), grown, max_leaves=12)


@settings(max_examples=150, deadline=None)
@given(EXPRESSIONS.filter(is_ordinary))
def test_what_is_read_back_is_what_was_written(expression):
    try:
        again = through_text(expression)
    except ExpressionError as error:  # numbers beyond the parser's bounds
        assert "magnitude" in str(error) or "exponent" in str(error)  # noqa: PT017
        return
    if again == expression:
        return
    # a number before a sum in parentheses is multiplied out on the way: the same to rounding
    for at in (0.3, 1.7):
        values = {x: at, y: at + 0.25, z: 1.25 - at}
        given_value, read = complex(expression.subs(values)), complex(again.subs(values))
        assert read == pytest.approx(given_value, rel=1e-9, abs=1e-9)


SAME = {
    "a sum below a product": 2 * x * (x + y),
    "a quotient": -2.5 * x * y / z,
    "powers of powers": (1 / x) ** sp.Rational(1, 3),
    "roots": sp.sqrt(x) / sp.sqrt(y + 1),
    "a negative power": x ** sp.Float(-1.5),
    "constants": sp.E * x + sp.pi + sp.sqrt(2),
    "a number of all digits": sp.Float(0.1) * x + sp.Float(1 / 3),
    "a Float that is one": sp.Float(1.0) * x,
    "minus one as a Float": sp.Float(-1.0) * x,
    "a large whole number": 12345678901234567890 * x,
    "a long sum": sp.Add(*(sp.sin(k * x + k) for k in range(400))),
    "a long polynomial": sp.expand((x + y + z + 1) ** 12),
    "deep calls": reduce(lambda e, _: sp.sin(e + y), range(120), x),
    "zero": sp.S.Zero,
}


@pytest.mark.sampled(6)
@pytest.mark.parametrize("expression", SAME.values(), ids=SAME)
def test_the_structure_survives(expression):
    assert through_text(expression) == expression


def test_a_small_expression_is_one_line_and_a_large_one_several():
    assert lines_of(x * sp.sin(y)) == ("x*sin(y)",)
    assert len(lines_of(SAME["a long polynomial"])) > 1


@pytest.mark.parametrize("name", [*FUNCTIONS, *IN_OTHER_WORDS])
def test_every_function_that_a_network_computes_is_written(name):
    call = getattr(sp, name, FUNCTIONS[name])(2 + x) if name != "atanh" else sp.atanh(x / 9)
    again = through_text(call)
    value = 0.4 if name not in ("asin", "acos") else -1.6
    assert float(again.subs(x, value)) == pytest.approx(float(call.subs(x, value)), rel=1e-13)


@pytest.mark.parametrize("power", [x**y, 2**x, (x + 1) ** (-y)])
def test_a_power_that_varies_keeps_its_value(power):
    at = {x: 1.3, y: 0.7}
    assert float(through_text(power).subs(at)) == pytest.approx(float(power.subs(at)), rel=1e-14)


def test_a_function_without_a_word_is_named():
    with pytest.raises(ExpressionError, match=r"erf\(x\).*sin, cos"):
        lines_of(x * sp.erf(x))


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ((), "cost: expected a line"),
        (("__import__('os')",), "not allowed"),
        (("_2", "x"), "not a name"),
        (("x", ""), "empty"),
        (("9**9**9",), "exponent"),
    ],
)
def test_bad_lines_are_refused(lines, message):
    with pytest.raises(ExpressionError, match=message):
        expression_of(lines, SYMBOLS, "cost")
