r"""Signals: sums of weighted monomials in the atoms of a cell.

.. math:: s = \sum_j w_j \prod_{a \in m_j} a ,

where an atom is a node that has to exist: a neuron, an input, a function block, a summing block.
The computations of a cell are built as signals, because their multiplication and differentiation
are polynomial algebra. The required multipliers are selected last (`SharedProducts`).
"""

from __future__ import annotations

Monomial = tuple[int, ...]
"""Sorted factors (atoms) of a product, with repetition; empty for a constant."""

Signal = dict[Monomial, float]
"""Sum of weighted monomials."""


VALUE = "value."
"""Name prefix of a summing block that represents a state or control in the user's units."""
ROUNDING = 1e-15
"""Fraction of the summed magnitudes below which a sum is a rounding error of zero."""


def add(*signals: Signal) -> Signal:
    """Return the sum of signals, without terms that cancel to rounding.

    Examples
    --------
    >>> add({(0,): 1.0, (1,): 2.0}, {(0,): -1.0})
    {(1,): 2.0}
    """
    total: Signal = {}
    size: Signal = {}
    for signal in signals:
        for monomial, weight in signal.items():
            total[monomial] = total.get(monomial, 0.0) + weight
            size[monomial] = size.get(monomial, 0.0) + abs(weight)
    return {m: weight for m, weight in total.items() if abs(weight) > ROUNDING * size[m]}


def scaled(signal: Signal, factor: float) -> Signal:
    """Return a signal times a number; empty if ``factor`` is zero."""
    return {monomial: weight * factor for monomial, weight in signal.items() if factor != 0.0}


def divided(signal: Signal, by: float) -> Signal:
    """Return a signal divided by a non-zero number; inverts `scaled` to the bit."""
    return {monomial: weight / by for monomial, weight in signal.items()}


def times(a: Signal, b: Signal) -> Signal:
    """Return the expanded product of two signals.

    Examples
    --------
    >>> times({(1,): 2.0}, {(0,): 3.0, (): 1.0})
    {(0, 1): 6.0, (1,): 2.0}
    """
    return add(*({tuple(sorted(m + n)): v * w} for m, v in a.items() for n, w in b.items()))


def partial(signal: Signal, atom: int) -> Signal:
    """Return the derivative of a signal by one of its atoms, all other atoms fixed.

    Examples
    --------
    >>> partial({(0, 0, 1): 3.0}, 0)
    {(0, 1): 6.0}
    """
    result: Signal = {}
    for monomial, weight in signal.items():
        count = monomial.count(atom)
        if count:
            at = monomial.index(atom)
            rest = monomial[:at] + monomial[at + 1 :]
            result[rest] = result.get(rest, 0.0) + count * weight
    return result


def atoms(signal: Signal) -> set[int]:
    """Return every atom that a signal reads."""
    return {atom for monomial in signal for atom in monomial}


def bare(name: str) -> str:
    """Return a node's name for use inside another name.

    States and controls lose their population prefix.
    """
    return (
        name.removeprefix(VALUE)
        if name.startswith(VALUE)
        else name.removeprefix("q." if name.startswith("q.") else "u.")
    )
