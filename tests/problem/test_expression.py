"""The expression language: what it reads, and what it refuses and how fast."""

import math
import re
import time

import mpmath
import pytest
import sympy as sp
from hypothesis import HealthCheck, assume, given, settings, strategies as st
from sympy.printing.str import StrPrinter

from ann_dc.errors import ExpressionError
from ann_dc.problem.expression import FUNCTIONS, parse_expression

x, y = sp.symbols("x y")
SYMBOLS = {"x": x, "y": y}


def parse(text) -> sp.Expr:
    return parse_expression(text, SYMBOLS, "dynamics.v")


READ = [
    ("1/2", sp.Rational(1, 2)),
    ("0.5", sp.Float(0.5)),
    ("7", sp.Integer(7)),
    ("pi", sp.pi),
    ("-x**2", -(x**2)),
    ("+x", x),
    ("2**-1 * x", x / 2),
    ("x - (y - 1)", x - y + 1),
    ("x\n  + y", x + y),
    ("exp(-8750/x)", sp.exp(-8750 / x)),
    ("1e-3*x", sp.Float(1e-3) * x),
    ("x**(1/3)", x ** sp.Rational(1, 3)),
    ("exp(500 - 500*x)", sp.exp(500 - 500 * x)),
    ("exp(1000*x - 1000)", sp.exp(1000 * x - 1000)),
    ("2**x + x**y", 2**x + x**y),
    ("exp(y*log(x))", sp.exp(y * sp.log(x))),
    ("x**150 + 1e200*y", x**150 + sp.Float(1e200) * y),
    ("-(x + 1)*y", sp.Mul(-1, x + 1, y)),
    ("2*(x + 1)*y/3", sp.Mul(sp.Rational(2, 3), x + 1, y)),
    ("1/(2*(x + y))", sp.Mul(sp.Rational(1, 2), 1 / (x + y))),
    ("x" + " + x" * 1000, 1001 * x),
    ("*".join(["x"] * 300), x**300),
]


@pytest.mark.parametrize(("text", "expression"), READ)
def test_reads(text, expression):
    assert parse(text) == expression


class Text(StrPrinter):
    """SymPy's own text, with floats to the last digit and e as a function."""

    def _print_Float(self, number):
        return repr(float(number))

    def _print_Exp1(self, _):
        return "exp(1)"


NUMBERS = (
    st.integers(-9, 9).map(sp.Integer)
    | st.tuples(st.integers(-99, 99), st.integers(1, 99)).map(lambda pq: sp.Rational(*pq))
    | st.floats(-1e3, 1e3, allow_subnormal=False).filter(lambda f: abs(f) > 1e-9).map(sp.Float)
    | st.just(sp.pi)
)


def _symbolic(children):
    pairs = st.tuples(children, children)
    calls = st.tuples(st.sampled_from(sorted(FUNCTIONS)), children)
    exponents = st.integers(-9, 9) | st.sampled_from([sp.Rational(1, 2), sp.Rational(-2, 3)])
    return st.one_of(
        pairs.map(lambda ab: ab[0] + ab[1]),
        pairs.map(lambda ab: ab[0] - ab[1]),
        pairs.map(lambda ab: ab[0] * ab[1]),
        pairs.filter(lambda ab: ab[1] != 0).map(lambda ab: ab[0] / ab[1]),
        st.tuples(children, exponents).filter(lambda be: be[0] != 0).map(lambda be: be[0] ** be[1]),
        calls.map(lambda call: FUNCTIONS[call[0]](call[1])),
    )


DECLARED = st.recursive(st.sampled_from([x, y, x**y, 2**x]) | NUMBERS, _symbolic, max_leaves=5)


def is_ordinary(expression: sp.Expr) -> bool:
    """Finite, real, and with numbers that a float holds: what a declaration may hold."""
    if expression.has(sp.nan, sp.oo, -sp.oo, sp.zoo, sp.I) or len(str(expression)) > 500:
        return False
    try:
        parts = [part for part in sp.preorder_traversal(expression) if part.is_number and part != 0]
        values = [complex(part) for part in parts]
    except (TypeError, OverflowError):
        return False
    return all(1e-290 < abs(v) < 1e290 and abs(v.imag) <= 1e-12 * abs(v) for v in values)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(DECLARED)
def test_what_sympy_writes_is_read_as_the_same(expression):
    assume(is_ordinary(expression))
    text = Text().doprint(expression)
    try:
        read = parse(text)
    except ExpressionError as refusal:  # (x**-9)**-9... multiplies exponents, which are bounded
        assume("has an exponent outside" not in str(refusal))
        raise
    assert read == expression or read.equals(expression)  # SymPy writes sqrt(2)/3 in several ways


@pytest.mark.parametrize("name", FUNCTIONS)
def test_reads_every_function(name):
    assert parse(f"{name}(x)") == getattr(sp, name, FUNCTIONS[name])(x)


def test_a_name_may_stand_for_a_number():
    assert parse_expression("x**p", {"x": x, "p": sp.Integer(3)}, "cost") == x**3


REFUSED = [
    ("__import__('os')", "letters, digits"),
    ("__import__(x)", "'__import__(x)' calls __import__, which is not a known function"),
    ("x.__class__", "'x.__class__' is an attribute"),
    ("x.diff(x)", "'x.diff(x)'"),
    ("x if y else 1", "is a conditional"),
    ("1if x else y", "is a conditional"),
    ("lambda: x", "':'"),
    ("f'{x}'", "letters, digits"),
    ("'x'", "letters, digits"),
    ("(x := 1)", "':'"),
    ("[x for x in y]", "'['"),
    ("{x}", "'{'"),
    ("x, y", "a list of values"),
    ("x and y", "a logical operation"),
    ("not x", "'not x'"),
    ("x < y", "'<'"),
    ("x^2", "x**2"),
    ("x // y", "'x // y'"),
    ("await x", "'await x'"),
    ("sin(*x)", "'*x'"),
    ("sin(x, y)", "exactly one plain argument"),
    ("sin()", "exactly one plain argument"),
    ("sin(**x)", "exactly one plain argument"),
    ("sin", "call it, as in sin(x)"),
    ("sin(x)(y)", "'sin(x)(y)'"),
    ("omega", "'omega' is not a name of this problem"),
    ("True", "'True' is not a real number"),
    ("None", "'None' is not a real number"),
    ("...", "'...' is not a real number"),
    ("1j", "'1j' is not a real number"),
    ("1e400", "scale the units"),
    ("1/0", "divides by zero"),
    ("x/(y - y)", "divides by zero"),
    ("0**-1", "divides by zero"),
    ("log(0)*x", "not a finite real number"),
    ("sqrt(-1)", "not a finite real number"),
    ("sqrt(sin(4))", "not a finite real number"),
    ("tan(pi/2)", "not a finite real number"),
    ("x**1001", "outside -1000 to 1000"),
    ("(x**90)**90", "outside -1000 to 1000"),
    ("9**9**9", "outside -1000 to 1000"),
    ("9**9**9**9", "outside -1000 to 1000"),
    ("(9**99)**99", "scale the units"),
    ("((10000001/10000000)**500)**500", "too many digits"),
    ("*".join(["(10000001/10000000)**150"] * 9), "too many digits"),
    ("(3*x)**900", "scale the units"),
    ("1e301", "scale the units"),
    ("9" * 5000, "not an expression"),
    ("((((2*x)**90)**90)**90)**90", "scale the units"),
    ("exp(10**90*log(2))", "outside -1000 to 1000"),
    ("exp(10**90*log(2*x) + y)", "outside -1000 to 1000"),
    ("exp(100*log(exp(100*log(exp(100*log(2*x))))))", "(100*log(2*x))"),
    ("exp(exp(exp(exp(9))))", "scale the units"),
    ("exp(800)", "scale the units"),
    ("0**x", "divides by zero"),
    ("abs(x)", "sqrt(x**2 + 0.01)"),
    ("Max(x, y)", "not smooth"),
    ("sign(x)", "not smooth"),
    ("x +", "is not an expression"),
    ("(x", "is not an expression"),
    ("x) + (y", "is not an expression"),
    ("x\0", "letters, digits"),
    ("ｘ", "letters, digits"),
    ("  ", "empty"),
    ("(" * 101 + "x" + ")" * 101, "more than 100 parentheses"),
    ("(" * 5_000_000 + ")" * 5_000_000, "at most 10000"),
    ("-" * 9999 + "x", "write it in parts"),
    ("x**" * 3000 + "2", "write it in parts"),
    ("x+" * 4999 + "x", "write it in parts"),
    (3, "expected text"),
    (None, "expected text"),
    (b"x", "expected text"),
]


@pytest.mark.parametrize(("text", "remedy"), REFUSED, ids=lambda given: str(given)[:30])
def test_refuses_at_once_and_says_why(text, remedy):
    start = time.thread_time()
    with pytest.raises(ExpressionError, match=re.escape(remedy)) as refusal:
        parse(text)
    assert time.thread_time() - start < 0.5  # 0.1 s and some air for a busy machine
    assert str(refusal.value).startswith("dynamics.v: ")
    assert len(str(refusal.value)) < 600


def test_a_refusal_lists_what_is_allowed():
    with pytest.raises(ExpressionError, match=r"the names x, y, and the functions sin, cos, tan"):
        parse("omega")


def _numbers():
    whole = st.integers(1, 9).map(lambda n: (str(n), lambda p: mpmath.mpf(n)))
    dyadic = st.integers(1, 31).map(lambda n: (str(n / 8), lambda p: mpmath.mpf(n) / 8))
    return whole | dyadic


def _grown(children):
    """A tree is its text and, independently, its value at a point p = {name: number}."""

    def joined(sign, operation):
        return st.tuples(children, children).map(
            lambda ab: (
                f"({ab[0][0]} {sign} {ab[1][0]})",
                lambda p: operation(ab[0][1](p), ab[1][1](p)),
            )
        )

    def called(name):
        function = getattr(mpmath, name)
        return children.map(lambda a: (f"{name}({a[0]})", lambda p: function(a[1](p))))

    powers = st.tuples(children, st.integers(2, 3)).map(
        lambda an: (f"({an[0][0]})**{an[1]}", lambda p: an[0][1](p) ** an[1])
    )
    return st.one_of(
        joined("+", lambda a, b: a + b),
        joined("-", lambda a, b: a - b),
        joined("*", lambda a, b: a * b),
        joined("/", lambda a, b: a / b),
        powers,
        children.map(lambda a: (f"-{a[0]}", lambda p: -a[1](p))),
        *map(called, ["sin", "cos", "atan", "tanh"]),
    )


VARIABLES = st.sampled_from(["x", "y"]).map(lambda name: (name, lambda p: p[name]))
TREES = st.recursive(VARIABLES | _numbers(), _grown, max_leaves=6)


@settings(max_examples=150, deadline=None)
@given(TREES, st.floats(0.1, 2), st.floats(0.1, 2))
def test_text_means_what_it_says(tree, x_value, y_value):
    text, value = tree
    with mpmath.workdps(40):
        point = {"x": mpmath.mpf(x_value), "y": mpmath.mpf(y_value)}
        try:
            expected = value(point)
        except ZeroDivisionError:
            assume(False)
        assume(expected == 0 or 1e-6 < abs(expected) < 1e6)
        try:
            expression = parse(text)
        except ExpressionError as refusal:  # a constant part may be too large or 1/0
            assume(not re.search("magnitude|divides", str(refusal)))
            raise
        got = sp.lambdify([x, y], expression, modules="mpmath")(*point.values())
        assert math.isclose(got, expected, rel_tol=1e-6, abs_tol=1e-9)
