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


VALUE = "value."
"""Begins the name of a summing block that carries a state or control in the user's units."""
ROUNDING = 1e-15
"""Share of what was added up below which a sum is what rounding left of a zero."""


def add(*signals: Signal) -> Signal:
    """The sum of signals, without the terms that cancel, to rounding.

    Returns
    -------
    Signal

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
    """A signal times a number; nothing where ``factor`` is zero."""
    return {monomial: weight * factor for monomial, weight in signal.items() if factor != 0.0}


def divided(signal: Signal, by: float) -> Signal:
    """A signal over a number that is not zero; what was scaled by it is as it was, to the bit."""
    return {monomial: weight / by for monomial, weight in signal.items()}


def times(a: Signal, b: Signal) -> Signal:
    """The product of two signals, multiplied out.

    Parameters
    ----------
    a, b : Signal

    Returns
    -------
    Signal

    Examples
    --------
    >>> times({(1,): 2.0}, {(0,): 3.0, (): 1.0})
    {(0, 1): 6.0, (1,): 2.0}
    """
    return add(*({tuple(sorted(m + n)): v * w} for m, v in a.items() for n, w in b.items()))


def partial(signal: Signal, atom: int) -> Signal:
    """The derivative of a signal by one of its atoms, all other atoms held.

    Parameters
    ----------
    signal : Signal
    atom : int

    Returns
    -------
    Signal

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
    """Every atom that a signal reads."""
    return {atom for monomial in signal for atom in monomial}


def bare(name: str) -> str:
    """A node's name inside another's: states and controls without their population."""
    return (
        name.removeprefix(VALUE)
        if name.startswith(VALUE)
        else name.removeprefix("q." if name.startswith("q.") else "u.")
    )
