"""Adjoint half of a cell: derivatives of a signal in reverse order of its atoms.

This is reverse-mode differentiation, applied once to the wiring instead of to numbers. The backward
half of a cell therefore reuses blocks of the forward half. The adjoint of a block becomes a
separate summing block if it has several terms. A single term is passed unchanged, and so are terms
that are only multiplied by a constant, to save multipliers.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable

from ann_dc.errors import SynthesisError
from ann_dc.network.functions import ELEMENTARY, folded, function_block, lacking
from ann_dc.synthesis.signals import Signal, add, atoms, partial, scaled, times
from ann_dc.synthesis.wiring import Wiring


def gradient(wiring: Wiring, potential: Signal, variables: Iterable[int]) -> dict[int, Signal]:
    """Return d(potential)/d(variable) as signals, one per variable.

    Gradients stop at sources and at named sums. A signal is empty if the potential does not depend
    on the variable. The blocks of the adjoint half are added to the wiring.
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
    """Return True if a block only scales one operand, whose adjoint gains no terms."""
    return len(slopes) == 1 and set(slopes[0][1]) == {()}


def _slopes(wiring: Wiring, atom: int) -> list[tuple[int, Signal]]:
    """Return the derivatives of a block with respect to each of its operands."""
    if atom in wiring.sums:
        signal = wiring.sums[atom]
        return [(operand, partial(signal, operand)) for operand in sorted(atoms(signal))]
    name, x = wiring.functions[atom]
    return [(x, _derivative(wiring, name, x, atom))]


def _derivative(wiring: Wiring, name: str, x: int, y: int) -> Signal:
    """Return dy/dx of a block y = name(x), in x, y and further blocks of either."""
    tree, library = function_block(name).trees[1], _library(wiring)
    lacked = lacking(tree, library)
    if lacked:
        raise SynthesisError(
            f"function block {name!r}: its derivative has the operation {lacked!r}, but the "
            f"adjoint half of a cell is wired from {', '.join(library)}"
        )
    given: dict[str, Signal] = {"x": {(x,): 1.0}, "y": {(y,): 1.0}}
    return folded(tree, given, library, lambda value: {(): value})


def _library(wiring: Wiring) -> dict[str, Callable[..., Signal]]:
    """Return the operations of trees on signals, in terms of blocks."""

    def divide(a: Signal, b: Signal) -> Signal:
        if set(b) == {()}:
            return scaled(a, 1 / b[()])
        return times(a, wiring.function("reciprocal", b))

    library: dict[str, Callable[..., Signal]] = {
        "add": add,
        "subtract": lambda a, b: add(a, scaled(b, -1.0)),
        "multiply": times,
        "divide": divide,
    }
    functions = {name: functools.partial(wiring.function, name) for name in ELEMENTARY.values()}
    return library | functions
