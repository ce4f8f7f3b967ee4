"""Conversion of expressions to signals: expanded sums and products, or blocks.

Powers become products, roots and reciprocals. A power with a variable exponent is a log-antilog
stage, as in analog hardware. A function without a block is expressed by functions with blocks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import sympy as sp

from ann_dc.errors import SynthesisError
from ann_dc.network.functions import CODE
from ann_dc.problem.named_functions import IN_OTHER_WORDS
from ann_dc.synthesis.signals import Signal, add, times
from ann_dc.synthesis.wiring import Wiring


def signal_of(expression: sp.Expr, symbols: Mapping[sp.Symbol, Signal], wiring: Wiring) -> Signal:
    """Return the signal of a SymPy expression, adding required blocks to the wiring.

    ``symbols`` maps each symbol to its signal. Raises `SynthesisError` if a function has no block.
    """
    return _Reader(symbols, wiring).read(expression)


def check_functions(*expressions: sp.Expr) -> None:
    """Reject functions that no block or combination of blocks computes.

    Raises `SynthesisError` with the function and the existing functions.
    """
    for call in {call for e in expressions for call in e.atoms(sp.Function)}:
        name = type(call).__name__
        if (name not in CODE and name not in IN_OTHER_WORDS) or len(call.args) != 1:
            raise SynthesisError(
                f"{call}: no function block {name!r}; write it with one of {', '.join(CODE)} or "
                "with sums, products and powers"
            )


@dataclass(frozen=True)
class _Reader:
    """Converter of expressions over one set of symbols to signals, node by node."""

    symbols: Mapping[sp.Symbol, Signal]
    wiring: Wiring

    def read(self, expression: Any) -> Signal:
        if expression.is_Symbol:
            return dict(self.symbols[expression])
        if not expression.free_symbols:
            value = float(expression)
            return {(): value} if value else {}
        if expression.is_Add:
            return add(*map(self.read, expression.args))
        if expression.is_Mul:
            return self._product([self.read(part) for part in expression.args])
        if expression.is_Pow:
            return self._power(*expression.args)
        return self._call(expression)

    def _product(self, parts: list[Signal]) -> Signal:
        varying = [part for part in parts if set(part) != {()}]
        product = {(): 1.0}
        for part in parts:
            if set(part) == {()}:
                product = times(product, part)
        if len(varying) == 1:
            return times(product, varying[0])
        for part in varying:
            product = times(product, part if len(part) <= 1 else self.wiring.one(part))
        return product

    def _power(self, base: Any, exponent: Any) -> Signal:
        if (2 * exponent).is_Integer:
            return self._root_or_power(self.read(base), exponent)
        if base is sp.E or base.is_number:
            inner = self.read(exponent * sp.log(base))
        else:
            inner = times(self.read(exponent), self.wiring.function("log", self.read(base)))
        return self.wiring.function("exp", inner)

    def _root_or_power(self, root: Signal, exponent: Any) -> Signal:
        """Return a signal raised to an integer or half-integer power."""
        if not exponent.is_Integer:
            root, exponent = self.wiring.function("sqrt", root), 2 * exponent
        if exponent.is_negative:
            root = self.wiring.function("reciprocal", root)
        if len(root) > 1:
            root = self.wiring.one(root)
        power = root
        for _ in range(abs(int(exponent)) - 1):
            power = times(power, root)
        return power

    def _call(self, expression: sp.Expr) -> Signal:
        check_functions(expression)
        name, argument = type(expression).__name__, cast(sp.Expr, expression.args[0])
        if name in IN_OTHER_WORDS:
            return self.read(IN_OTHER_WORDS[name](argument))
        return self.wiring.function(name, self.read(argument))
