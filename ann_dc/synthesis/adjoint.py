"""The adjoint half of a cell: derivatives of a signal, by going through its atoms in reverse.

This is reverse-mode differentiation, done once on the wiring instead of on numbers, so the backward
half of a cell shares blocks with the forward half. The adjoint of a block becomes a summing block
of its own where it has several terms; a single term is passed on as it is, so that no multiplier
is spent on it, and so are terms that meet a constant only.
"""

from __future__ import annotations

from collections.abc import Iterable

from ann_dc.errors import SynthesisError
from ann_dc.network.functions import function_block
from ann_dc.synthesis.signals import Signal, add, atoms, partial, scaled, times
from ann_dc.synthesis.wiring import Wiring


def gradient(wiring: Wiring, potential: Signal, variables: Iterable[int]) -> dict[int, Signal]:
    """d(potential)/d(variable) as signals; gradients stop at sources and at named sums.

    Parameters
    ----------
    wiring : Wiring
        Takes the blocks of the adjoint half.
    potential : Signal
    variables : iterable of atoms

    Returns
    -------
    dict of atom to Signal
        One for every variable; empty signals where the potential does not depend on it.

    Examples
    --------
    >>> from ann_dc.synthesis import Wiring
    >>> wiring = Wiring(["x"])
    >>> gradient(wiring, {(0, 0): 0.5}, [0])
    {0: {(0,): 1.0}}
    """
    adjoints: dict[int, Signal] = {a: partial(potential, a) for a in atoms(potential)}
    pending = {a for a in adjoints if wiring.is_inner(a)}
    while pending:
        atom = max(pending)  # an atom's operands were made before it
        pending.remove(atom)
        adjoint, slopes = adjoints[atom], _slopes(wiring, atom)
        if len(adjoint) > 1 and not _is_multiple(slopes):
            adjoint = wiring.one(adjoint)
        for operand, slope in slopes:
            adjoints[operand] = add(adjoints.get(operand, {}), times(adjoint, slope))
            if wiring.is_inner(operand):
                pending.add(operand)
    return {variable: adjoints.get(variable, {}) for variable in variables}


def _is_multiple(slopes: list[tuple[int, Signal]]) -> bool:
    """Whether a block only multiplies one operand, whose adjoint then has no more terms."""
    return len(slopes) == 1 and set(slopes[0][1]) == {()}


def _slopes(wiring: Wiring, atom: int) -> list[tuple[int, Signal]]:
    """The derivatives of a block by each of its operands."""
    if atom in wiring.sums:
        signal = wiring.sums[atom]
        return [(operand, partial(signal, operand)) for operand in sorted(atoms(signal))]
    name, x = wiring.functions[atom]
    return [(x, _derivative(wiring, name, x, atom))]


def _derivative(wiring: Wiring, name: str, x: int, y: int) -> Signal:
    """dy/dx of a function block y = name(x), in x, y and further blocks of either."""
    rule = function_block(name).derivative
    if rule is None:
        return _special_derivative(wiring, name, x)
    total: Signal = {}
    for weight, factors in rule:
        term: Signal = {(): weight}
        for factor in factors:
            outer, _, inner = factor.rpartition("(")
            signal = {((x if inner.startswith("x") else y),): 1.0}
            term = times(term, wiring.function(outer, signal) if outer else signal)
        total = add(total, term)
    return total


def _special_derivative(wiring: Wiring, name: str, x: int) -> Signal:
    """Return that of atan, asin or acos, whose derivatives take a sum inside a block."""
    if name not in ("atan", "asin", "acos"):
        raise SynthesisError(
            f"function block {name!r}: it has no wiring rule for its derivative, which the adjoint "
            "half of a cell needs; give the block a derivative"
        )
    square = {(x, x): 1.0}
    if name == "atan":
        return wiring.function("reciprocal", add({(): 1.0}, square))
    root = wiring.function("sqrt", add({(): 1.0}, scaled(square, -1.0)))
    return scaled(wiring.function("reciprocal", root), 1.0 if name == "asin" else -1.0)
