"""From expressions to blocks: the algebra that wires a cell and derives its adjoint half.

Everything is a *signal*: a sum of weighted monomials in atoms, where an atom is a node that has to
exist (a neuron, an input, a function block, a summing block). Multiplying and differentiating
signals is polynomial algebra; multipliers are chosen last, over all signals of the cell at once,
so that a product which two signals share is built once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import cast

import sympy as sp

from ann_dc.errors import SynthesisError
from ann_dc.network.cell import ONE, Block, Connection, Function, Product, Sum
from ann_dc.network.functions import CODE, function_block
from ann_dc.synthesis.products import SharedProducts, Signal, bare


def add(*signals: Signal) -> Signal:
    """The sum of signals, without the terms that cancel."""
    total: Signal = {}
    for signal in signals:
        for monomial, weight in signal.items():
            total[monomial] = total.get(monomial, 0.0) + weight
    return {monomial: weight for monomial, weight in total.items() if weight != 0.0}


def scaled(signal: Signal, factor: float) -> Signal:
    """A signal times a number."""
    return {monomial: weight * factor for monomial, weight in signal.items() if factor != 0.0}


def times(a: Signal, b: Signal) -> Signal:
    """The product of two signals, multiplied out."""
    return add(*({tuple(sorted(m + n)): v * w} for m, v in a.items() for n, w in b.items()))


def partial(signal: Signal, atom: int) -> Signal:
    """The derivative of a signal by one of its atoms, all other atoms held."""
    result: Signal = {}
    for monomial, weight in signal.items():
        count = monomial.count(atom)
        if count:
            at = monomial.index(atom)
            rest = monomial[:at] + monomial[at + 1 :]
            result[rest] = result.get(rest, 0.0) + count * weight
    return result


class Wiring:
    """A cell under construction: atoms with their names, and the signals that feed them."""

    def __init__(self, sources: Iterable[str]) -> None:
        self.names: list[str] = []
        self._functions: dict[int, tuple[str, int]] = {}
        self._sums: dict[int, Signal] = {}
        self._known: dict[object, int] = {}
        self._leaves: set[int] = set()
        self.sources = {name: self._atom(name) for name in sources}

    # ---- atoms -------------------------------------------------------------------------------

    def _atom(self, name: str) -> int:
        self.names.append(name)
        return len(self.names) - 1

    def signal(self, name: str) -> Signal:
        """The signal that is one source or one named sum."""
        return {(self.sources[name],): 1.0}

    def named_sum(self, name: str) -> Signal:
        """A summing block that the caller names (c, m, r, b) and fills later.

        Gradients stop at it, as they stop at a source.
        """
        atom = self.sources[name] = self._atom(name)
        self._sums[atom] = {}
        self._leaves.add(atom)
        return {(atom,): 1.0}

    def fill(self, name: str, signal: Signal) -> None:
        """What a named sum adds up."""
        self._sums[self.sources[name]] = signal

    def atom(self, signal: Signal) -> int:
        """The node that carries a signal: itself if it is one, a summing block if not."""
        if len(signal) == 1:
            ((monomial, weight),) = signal.items()
            if len(monomial) == 1 and weight == 1.0:
                return monomial[0]
        key = ("sum", tuple(sorted(signal.items())))
        if key not in self._known:
            count = len(self._sums) - len(self._leaves)
            self._known[key] = self._atom(f"sum.{count}")
            self._sums[self._known[key]] = signal
        return self._known[key]

    def function(self, name: str, signal: Signal) -> Signal:
        """A function block on a signal; the same block on the same signal exists once."""
        key = (name, self.atom(signal))
        if key not in self._known:
            self._known[key] = self._atom(f"{name}({bare(self.names[key[1]])})")
            self._functions[self._known[key]] = key
        return {(self._known[key],): 1.0}

    # ---- expressions -------------------------------------------------------------------------

    def compile(self, expression: sp.Expr, symbols: Mapping[sp.Symbol, Signal]) -> Signal:
        """The signal that carries a SymPy expression.

        Raises
        ------
        SynthesisError
            If a function has no block.
        """
        if expression.is_Symbol:
            return dict(symbols[expression])  # type: ignore[index]
        if not expression.free_symbols:
            value = float(expression)
            return {(): value} if value else {}
        parts = lambda: [self.compile(a, symbols) for a in expression.args]  # noqa: E731  # pyright: ignore[reportArgumentType]
        if expression.is_Add:
            return add(*parts())
        if expression.is_Mul:
            return self._product(parts())
        if expression.is_Pow:
            return self._power(*expression.args, symbols)  # type: ignore[arg-type]
        return self._call(expression, symbols)

    def _product(self, parts: list[Signal]) -> Signal:
        varying = [part for part in parts if set(part) != {()}]
        constant = {(): 1.0}
        for part in parts:
            if set(part) == {()}:
                constant = times(constant, part)
        if len(varying) == 1:
            return times(constant, varying[0])
        for part in varying:
            constant = times(constant, part if len(part) <= 1 else {(self.atom(part),): 1.0})
        return constant

    def _power(self, base: sp.Expr, exponent: sp.Expr, symbols) -> Signal:
        if exponent.is_Integer or (2 * exponent).is_Integer:
            root = self.compile(base, symbols)
            if not exponent.is_Integer:
                root, exponent = self.function("sqrt", root), 2 * exponent
            if exponent.is_negative:
                root = self.function("reciprocal", root)
            if len(root) > 1:
                root = {(self.atom(root),): 1.0}
            result = root
            for _ in range(abs(int(exponent)) - 1):
                result = times(result, root)
            return result
        if base is sp.E or base.is_number:
            inner = self.compile(exponent * sp.log(base), symbols)
        else:  # a log-antilog stage, as analog hardware raises to a power
            inner = times(
                self.compile(exponent, symbols), self.function("log", self.compile(base, symbols))
            )
        return self.function("exp", inner)

    def _call(self, expression: sp.Expr, symbols) -> Signal:
        check_functions(expression)
        name, argument = type(expression).__name__, cast(sp.Expr, expression.args[0])
        if name in _REWRITTEN:
            return self.compile(_REWRITTEN[name](argument), symbols)
        return self.function(name, self.compile(argument, symbols))

    # ---- the adjoint half --------------------------------------------------------------------

    def gradient(self, potential: Signal, variables: Iterable[int]) -> dict[int, Signal]:
        """d(potential)/d(variable) as signals, by going through the atoms in reverse.

        The adjoint of a block becomes a summing block of its own where it has several terms; a
        single term is passed on as it is, so that no multiplier is spent on it.
        """
        adjoints: dict[int, Signal] = {a: partial(potential, a) for a in _atoms(potential)}
        pending = {a for a in adjoints if self._inner(a)}
        while pending:
            atom = max(pending)  # an atom's operands were made before it
            pending.remove(atom)
            adjoint = adjoints[atom]
            if len(adjoint) > 1:
                adjoint = {(self.atom(adjoint),): 1.0}
            for operand, slope in self._slopes(atom):
                adjoints[operand] = add(adjoints.get(operand, {}), times(adjoint, slope))
                if self._inner(operand):
                    pending.add(operand)
        return {variable: adjoints.get(variable, {}) for variable in variables}

    def _inner(self, atom: int) -> bool:
        return atom in self._functions or (atom in self._sums and atom not in self._leaves)

    def _slopes(self, atom: int) -> list[tuple[int, Signal]]:
        if atom in self._sums:
            signal = self._sums[atom]
            return [(operand, partial(signal, operand)) for operand in sorted(_atoms(signal))]
        name, x = self._functions[atom]
        return [(x, self._derivative(name, x, atom))]

    def _derivative(self, name: str, x: int, y: int) -> Signal:
        rule = function_block(name).derivative
        if rule is None:
            return self._special_derivative(name, x)
        total: Signal = {}
        for weight, factors in rule:
            term: Signal = {(): weight}
            for factor in factors:
                outer, _, inner = factor.rpartition("(")
                signal = {((x if inner.startswith("x") else y),): 1.0}
                term = times(term, self.function(outer, signal) if outer else signal)
            total = add(total, term)
        return total

    def _special_derivative(self, name: str, x: int) -> Signal:
        square = {(x, x): 1.0}
        if name == "atan":
            return self.function("reciprocal", add({(): 1.0}, square))
        root = self.function("sqrt", add({(): 1.0}, scaled(square, -1.0)))
        return scaled(self.function("reciprocal", root), 1.0 if name == "asin" else -1.0)

    # ---- blocks and connections --------------------------------------------------------------

    def finish(
        self, drives: Mapping[str, Signal], wires: Iterable[Connection] = ()
    ) -> tuple[tuple[Block, ...], tuple[Connection, ...]]:
        """Blocks in topological order and all connections.

        ``drives`` gives what arrives at each neuron from its own cell, ``wires`` the connections
        that the caller makes himself (to neighbours, or with a weight that differs by stage).
        """
        wires = tuple(wires)
        read = [*drives.values(), *(self.signal(wire.source) for wire in wires)]
        fed = [self._sums[atom] for atom in self._needed(read) if atom in self._sums]
        share = SharedProducts(self.names, [*drives.values(), *fed])
        blocks, connections = [], []
        for atom in self._ordered(read, wires, share):
            name = self.names[atom]
            if atom in share.pairs:
                a, b = share.pairs[atom]
                blocks.append(Product(name=name, a=self.names[a], b=self.names[b]))
            elif atom in self._functions:
                function, x = self._functions[atom]
                blocks.append(Function(name=name, function=function, x=self.names[x]))
            elif atom in self._sums:
                blocks.append(Sum(name=name))
                connections += self._connections(name, self._sums[atom], share)
        for target, signal in drives.items():
            connections += self._connections(target, signal, share)
        return tuple(blocks), (*connections, *wires)

    def _ordered(
        self, read: list[Signal], wires: tuple[Connection, ...], share: SharedProducts
    ) -> list[int]:
        """Every atom that the signals need, operands first."""
        before: dict[str, list[int]] = {}
        for wire in wires:
            before.setdefault(wire.target, []).append(self.sources[wire.source])
        placed: dict[int, None] = {}

        def place(atom: int) -> None:
            if atom not in placed:
                wired = before.get(self.names[atom], []) if atom in self._sums else []
                for operand in [*self._operands(atom, share), *wired]:
                    place(operand)
                placed[atom] = None

        for signal in read:
            for monomial in filter(None, signal):
                place(share.node(monomial))
        return list(placed)

    def _operands(self, atom: int, share: SharedProducts) -> list[int]:
        if atom in share.pairs:
            return list(share.pairs[atom])
        if atom in self._functions:
            return [self._functions[atom][1]]
        return [share.node(m) for m in self._sums.get(atom, {}) if m]

    def _connections(self, target: str, signal: Signal, share: SharedProducts) -> list[Connection]:
        return [
            Connection(
                source=self.names[share.node(monomial)] if monomial else ONE,
                target=target,
                weight=weight,
            )
            for monomial, weight in signal.items()
        ]

    def _needed(self, signals: Iterable[Signal]) -> list[int]:
        found: set[int] = set()
        stack = [a for signal in signals for a in _atoms(signal)]
        while stack:
            atom = stack.pop()
            if atom in found:
                continue
            found.add(atom)
            if atom in self._functions:
                stack.append(self._functions[atom][1])
            stack.extend(_atoms(self._sums.get(atom, {})))
        return sorted(found)


def _atoms(signal: Signal) -> set[int]:
    return {atom for monomial in signal for atom in monomial}


_REWRITTEN = {
    "sec": lambda x: 1 / sp.cos(x),
    "csc": lambda x: 1 / sp.sin(x),
    "cot": lambda x: sp.cos(x) / sp.sin(x),
    "coth": lambda x: 1 / sp.tanh(x),
    "sech": lambda x: 1 / sp.cosh(x),
    "csch": lambda x: 1 / sp.sinh(x),
    "acosh": lambda x: sp.log(x + sp.sqrt(x**2 - 1)),
    "asinh": lambda x: sp.log(x + sp.sqrt(x**2 + 1)),
    "atanh": lambda x: sp.log((1 + x) / (1 - x)) / 2,
}
"""Functions without a block of their own, in terms of those that have one."""


def check_functions(*expressions: sp.Expr) -> None:
    """Refuse functions that no block, and no combination of blocks, computes.

    Raises
    ------
    SynthesisError
        Naming the function and those that exist.
    """
    for call in {call for e in expressions for call in e.atoms(sp.Function)}:
        name = type(call).__name__
        if (name not in CODE and name not in _REWRITTEN) or len(call.args) != 1:
            raise SynthesisError(
                f"{call}: no function block {name!r}; write it with one of {', '.join(CODE)} or "
                "with sums, products and powers"
            )
