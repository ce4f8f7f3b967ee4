"""Inequalities as text: what is read, and what is refused and how fast."""

import re
import time

import pytest
import sympy as sp
from hypothesis import given, strategies as st

from ann_dc.errors import ExpressionError
from ann_dc.problem.expression import parse_expression
from ann_dc.problem.inequality import SIGNS
from ann_dc.problem.toml_file import parse_relations

x, y = sp.symbols("x y")
SYMBOLS = {"x": x, "y": y, "limit": sp.Float(2.5)}


def parse(text) -> dict[str, sp.Rel]:
    return parse_relations("gap", text, SYMBOLS, "constraints.gap")


READ = [
    ("x <= 1", {"gap": x <= 1}),
    ("x<limit", {"gap": x < 2.5}),
    ("x**2 + y**2 >= 1", {"gap": x**2 + y**2 >= 1}),
    ("sin(x) > -1/2", {"gap": sp.sin(x) > -sp.Rational(1, 2)}),
    ("-1 <= x - y < 1", {"gap_low": sp.Le(-1, x - y), "gap_high": x - y < 1}),
    ("limit > x >= y", {"gap_high": sp.Gt(2.5, x), "gap_low": x >= y}),
    ("0 <= 1", {"gap": sp.Le(0, 1, evaluate=False)}),
    (" x\n <= \n1 ", {"gap": x <= 1}),
]


@pytest.mark.parametrize(("text", "relations"), READ)
def test_reads(text, relations):
    assert parse(text) == relations


sides = st.recursive(
    st.sampled_from(["x", "y", "2", "0.5", "limit"]),
    lambda inner: st.builds("({} {} {})".format, inner, st.sampled_from("+-*"), inner),
    max_leaves=6,
)


@given(sides, st.sampled_from([*SIGNS]), sides)
def test_sides_are_what_the_parser_of_formulas_reads(left, sign, right):
    (relation,) = parse(f"{left}{sign}{right}").values()
    assert relation.rel_op == sign
    expected = [parse_expression(side, SYMBOLS, "side") for side in (left, right)]
    assert [relation.lhs, relation.rhs] == expected


@given(sides, st.sampled_from([*SIGNS]), sides)
def test_what_sympy_writes_is_read_again(left, sign, right):
    (relation,) = parse(f"{left}{sign}{right}").values()
    (again,) = parse(str(relation)).values()
    assert again.rel_op == sign
    for one, other in zip(again.args, relation.args):
        assert abs((one - other).subs({x: 0.3, y: 0.7})) < 1e-12


REFUSED = [
    ("x", "'x' is not an inequality", "x**2 + y <= 1"),
    ("", "'' is not an inequality", "<=, <, >= or >"),
    ("x = 1", "'x = 1' is not an inequality", "equality by the map"),
    ("x == 1", "'x == 1' is not an inequality", "equality by the map"),
    ("x => 1", "'x => 1' is not an inequality", "<="),
    ("x <= 1 == y", "'x <= 1 == y' is not an inequality", "<="),
    ("0 <= x <= y <= 1", "'0 <= x <= y <= 1' is not an inequality", "-1 <= x <= 1"),
    ("0 <= x >= y", "'0 <= x >= y' has two bounds on the same side", "two inequalities"),
    ("x <=", "the text is empty", "write an expression"),
    ("x <= 1 and y <= 2", "'1 and y' is a logical operation", "Allowed"),
    ("x <= 1, y <= 2", "'1, y' is a list of values", "Allowed"),
    ("(x <= 1)", "'(x' is not an expression", "write it like"),
    ("abs(x) <= 1", "'abs(x)' calls abs, which is not smooth", "smooth approximation"),
    ("z <= 1", "'z' is not a name of this problem", "x, y, limit"),
    ("open('/etc/passwd') <= 1", '"\'" in "open(\'/etc/passwd\')" is not allowed', "letters"),
    ("x.__class__ <= 1", "'x.__class__' is an attribute", "Allowed"),
    ("x <= (lambda: 1)()", "':' in '(lambda: 1)()' is not allowed", "letters"),
    (3, "expected text", "got 3"),
    (None, "expected text", "got None"),
    (["x <= 1"], "expected text", "x <= 1"),
]


@pytest.mark.parametrize(("text", "fault", "remedy"), REFUSED, ids=lambda given: str(given)[:30])
def test_what_is_no_inequality_is_refused(text, fault, remedy):
    with pytest.raises(ExpressionError, match=re.escape(f"constraints.gap: {fault}")) as refusal:
        parse(text)
    assert remedy in str(refusal.value)


@pytest.mark.parametrize(
    "text",
    [
        "<" * 1_000_000,
        "x" * 1_000_000 + "<= 1",
        "(" * 9_000 + "x <= 1",
        "9**9**9 <= x",
        "x <= " + "*".join(["(x + 1e-9)**999"] * 500) + "**999",
        "exp(exp(exp(9))) <= exp(exp(exp(8)))",
    ],
    ids=lambda text: text[:12],
)
def test_a_hostile_text_costs_no_time(text):
    start = time.thread_time()
    with pytest.raises(ExpressionError) as refusal:
        parse(text)
    assert time.thread_time() - start < 2
    assert len(str(refusal.value)) < 2000
