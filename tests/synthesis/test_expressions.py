"""Wiring of expressions and of their adjoint half, against SymPy on smooth random expressions."""

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings, strategies as st

from ann_dc.errors import SynthesisError
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Cell, Function, Neuron, Product
from ann_dc.network.network import Network
from ann_dc.synthesis.adjoint import gradient
from ann_dc.synthesis.assembly import assemble
from ann_dc.synthesis.expressions import signal_of
from ann_dc.synthesis.wiring import Wiring

X, Y, Z = SYMBOLS = sp.symbols("x y z")
NAMES = [str(s) for s in SYMBOLS]


def wired(expression: sp.Expr) -> Network:
    """Neurons x, y, z and value; x' .. z' are the gradient and value' is the expression."""
    wiring = Wiring([*NAMES, "value"])
    signal = signal_of(expression, {s: wiring.signal(str(s)) for s in SYMBOLS}, wiring)
    slopes = gradient(wiring, signal, [wiring.sources[name] for name in NAMES])
    drives = {name: slopes[wiring.sources[name]] for name in NAMES}
    blocks, connections = assemble(wiring, drives | {"value": signal})
    neurons = tuple(Neuron(name=name) for name in (*NAMES, "value"))
    return Network(cell=Cell(neurons=neurons, blocks=blocks, connections=connections), stages=1)


def outcome(network: Network, point) -> np.ndarray:
    """(d/dx, d/dy, d/dz, value) as the network computes them."""
    return evaluator(network).rhs(np.array([*point, 0.0]))


def by_sympy(expression: sp.Expr, point) -> np.ndarray:
    at = dict(zip(SYMBOLS, map(sp.Float, point)))
    exact = [expression.diff(s) for s in SYMBOLS] + [expression]
    return np.array([float(e.subs(at)) for e in exact])


def counts(network: Network) -> tuple[int, int]:
    """(multipliers, function blocks)."""
    return network.cell.count(Product), network.cell.count(Function)


# ---- random expressions ------------------------------------------------------------------------

LEAVES = st.sampled_from([X, Y, Z, sp.Rational(1, 2), sp.Integer(-2), sp.Float(1.7)])
BOUNDED = (sp.sin, sp.cos, sp.tanh, sp.atan)


def grown(parts):
    """Smooth functions of smooth functions, defined and tame everywhere."""
    two = st.tuples(parts, parts)
    return st.one_of(
        two.map(lambda p: p[0] + p[1]),
        two.map(lambda p: p[0] - 3 * p[1]),
        two.map(lambda p: p[0] * p[1]),
        st.tuples(st.sampled_from(BOUNDED), parts).map(lambda p: p[0](p[1])),
        parts.map(lambda e: sp.exp(sp.sin(e))),
        parts.map(lambda e: sp.sqrt(1 + e**2)),
        parts.map(lambda e: 1 / (2 + sp.cos(e))),
        parts.map(lambda e: sp.log(2 + sp.sin(e))),
        parts.map(lambda e: sp.asin(sp.sin(e) / 2)),
        parts.map(lambda e: sp.acos(sp.tanh(e) / 2)),
        parts.map(lambda e: (1 + sp.sin(e) ** 2) ** sp.Rational(-3, 2)),
        parts.map(lambda e: sp.tan(sp.sin(e))),
    )


EXPRESSIONS = st.recursive(LEAVES, grown, max_leaves=6)
POINTS = st.tuples(*(st.floats(-1.5, 1.5),) * 3)


@settings(max_examples=80, deadline=None)
@given(EXPRESSIONS, POINTS)
def test_value_and_gradient_of_random_expressions(expression, point):
    expected = by_sympy(expression, point)
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(
        outcome(wired(expression), point), expected, rtol=1e-10, atol=1e-11 * scale
    )


SPECIAL = [
    X / Y, X**-2 * Y**3, sp.sqrt(X) * Y, X ** sp.Rational(5, 2), X**Y, sp.Integer(2) ** X, sp.E**Y,
    X**1.5, sp.sec(X) + sp.csc(Y) + sp.cot(Z), sp.sinh(X) * sp.cosh(Y), sp.sech(X), sp.csch(Y),
    sp.coth(X), sp.acosh(1 + X), sp.asinh(X), sp.atanh(X / 2), sp.asin(X / 2) * sp.acos(Y / 2),
    sp.atan(X * Y), sp.exp(-(X**2) - Y**2), (X + Y) ** 4, sp.pi * X, sp.Float(0) * X, sp.Integer(3),
]  # fmt: skip


@pytest.mark.parametrize("expression", SPECIAL, ids=str)
def test_special_expressions(expression):
    point = (0.6, 0.8, 0.4)
    np.testing.assert_allclose(
        outcome(wired(expression), point), by_sympy(expression, point), rtol=1e-12, atol=1e-14
    )


def test_a_function_without_a_block():
    with pytest.raises(SynthesisError, match=r"erf\(x\): no function block 'erf'; write it with"):
        wired(sp.erf(X))


# ---- sharing -----------------------------------------------------------------------------------


def test_a_product_is_built_once():
    # x y in the value, and d(x y z) = (y z, x z, x y): three products and one on top
    assert counts(wired(X * Y * Z)) == (4, 0)


def test_a_power_is_built_from_squares():
    wiring = Wiring(["x"])
    blocks, _ = assemble(wiring, {"x": signal_of(X**8, {X: wiring.signal("x")}, wiring)})
    assert len(blocks) == 3


def test_a_function_is_built_once():
    network = wired(Y * sp.cos(X) + Z * sp.cos(X) + sp.cos(X) ** 2)
    functions = [block.function for block in network.cell.blocks if isinstance(block, Function)]
    assert sorted(functions) == ["cos", "sin"]


def test_an_exponential_is_its_own_derivative():
    network = wired(sp.exp(X))
    assert counts(network) == (0, 1)


def test_equal_sums_are_one_block():
    network = wired(sp.sin(X + Y) * sp.cos(X + Y))
    sums = [b.name for b in network.cell.blocks if b.name.startswith("sum")]
    arriving = [
        frozenset((c.source, c.weight) for c in network.cell.connections if c.target == s)
        for s in sums
    ]
    assert len(set(arriving)) == len(arriving)
