r"""Signals: sums of weighted monomials in the atoms of a cell.

.. math:: s = \sum_j w_j \prod_{a \in m_j} a ,

where an atom is a node that has to exist: a neuron, an input, a function block, a summing block.
What a cell computes is built as signals, because multiplying and differentiating them is
polynomial algebra; which multipliers they take is decided last (`SharedProducts`).
"""

from __future__ import annotations

Monomial = tuple[int, ...]
"""Atoms that are multiplied, sorted, with repetition; empty for a constant."""

Signal = dict[Monomial, float]
"""A sum of weighted monomials."""


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


def atoms(signal: Signal) -> set[int]:
    """Every atom that a signal reads."""
    return {atom for monomial in signal for atom in monomial}


def bare(name: str) -> str:
    """A node's name inside another's: states and controls without their population."""
    return name[2:] if name.startswith(("q.", "u.")) else name
