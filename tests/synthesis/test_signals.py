"""Signals are polynomials: their algebra against SymPy's."""

import sympy as sp
from hypothesis import given, settings, strategies as st

from ann_dc.synthesis.signals import add, partial, scaled, times

SYMBOLS = sp.symbols("x y z")

SIGNALS = st.dictionaries(
    st.lists(st.integers(0, 2), max_size=3).map(lambda m: tuple(sorted(m))),
    st.integers(-4, 4).filter(bool).map(float),
    max_size=4,
)


def polynomial(signal) -> sp.Expr:
    return sp.Add(*(w * sp.Mul(*(SYMBOLS[a] for a in m)) for m, w in signal.items()))


@settings(max_examples=50, deadline=None)
@given(SIGNALS, SIGNALS)
def test_signals_are_polynomials(a, b):
    same = lambda signal, expression: sp.expand(polynomial(signal) - expression) == 0  # noqa: E731
    assert same(add(a, b), polynomial(a) + polynomial(b))
    assert same(times(a, b), polynomial(a) * polynomial(b))
    assert same(scaled(a, -0.5), polynomial(a) * -0.5)
    for atom, symbol in enumerate(SYMBOLS):
        assert same(partial(a, atom), polynomial(a).diff(symbol))
    assert 0.0 not in {*add(a, b).values(), *times(a, b).values(), *scaled(a, 0.0).values()}
