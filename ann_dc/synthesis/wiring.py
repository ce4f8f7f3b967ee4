"""Cell under construction: named atoms and the signals that feed them.

An atom is a source (a neuron, an input), a function block or a summing block; its operands precede
it. Expressions are read into signals (`expressions`), the adjoint half is derived from these
(`adjoint`), and blocks and connections are generated at the end (`assembly`).
"""

from __future__ import annotations

from collections.abc import Iterable

from ann_dc.synthesis.signals import VALUE, Signal, bare


class Wiring:
    """Atoms of a cell.

    Parameters
    ----------
    sources : iterable of str
        Names of neurons and inputs.

    Attributes
    ----------
    sources : dict of name to atom
        Neurons, inputs and named sums.
    functions : dict of atom to (function, atom)
        Function blocks and their arguments.
    sums : dict of atom to Signal
        Summing blocks and their inputs.
    """

    def __init__(self, sources: Iterable[str]) -> None:
        self.names: list[str] = []
        self.functions: dict[int, tuple[str, int]] = {}
        self.sums: dict[int, Signal] = {}
        self._known: dict[object, int] = {}
        self._values: dict[object, str] = {}
        self._leaves: set[int] = set()
        self.sources = {name: self._atom(name) for name in sources}

    def _atom(self, name: str) -> int:
        self.names.append(name)
        return len(self.names) - 1

    def signal(self, name: str) -> Signal:
        """Return the signal of one source or named sum."""
        return {(self.sources[name],): 1.0}

    def name_value(self, signal: Signal, name: str) -> None:
        """Name the summing block of a signal after the symbol that it represents.

        The signal is a source in the user's units.
        """
        self._values[_key(signal)] = f"{VALUE}{name}"

    def named_sum(self, name: str) -> Signal:
        """Add a named summing block (c, m, r, b), filled later, and return its signal.

        Gradients stop at the block, as at a source. A name is, for instance, ``c.x``.
        """
        atom = self.sources[name] = self._atom(name)
        self.sums[atom] = {}
        self._leaves.add(atom)
        return {(atom,): 1.0}

    def fill(self, name: str, signal: Signal) -> None:
        """Set the inputs of the named sum ``name`` to ``signal``."""
        self.sums[self.sources[name]] = signal

    def named_function(self, name: str, function: str, source: str) -> None:
        """Add a named function block on a named sum; gradients stop at the block.

        For instance, the block ``zeta.g1`` has the function ``rectify``; ``source`` is the named
        sum.
        """
        atom = self.sources[name] = self._atom(name)
        self.functions[atom] = (function, self.sources[source])
        self._leaves.add(atom)

    def atom(self, signal: Signal) -> int:
        """Return the node of a signal: the atom itself if it is one, else a summing block."""
        if len(signal) == 1:
            ((monomial, weight),) = signal.items()
            if len(monomial) == 1 and weight == 1.0:
                return monomial[0]
        key = _key(signal)
        if key not in self._known:
            count = len(self.sums.keys() - self._leaves)
            self._known[key] = self._atom(self._values.get(key, f"sum.{count}"))
            self.sums[self._known[key]] = signal
        return self._known[key]

    def function(self, name: str, signal: Signal) -> Signal:
        """Return the signal of a function block such as ``sin`` on a signal.

        A block with the same function and argument is created once.
        """
        key = (name, self.atom(signal))
        if key not in self._known:
            self._known[key] = self._atom(f"{name}({bare(self.names[key[1]])})")
            self.functions[self._known[key]] = key
        return {(self._known[key],): 1.0}

    def one(self, signal: Signal) -> Signal:
        """Return the signal as a single atom."""
        return {(self.atom(signal),): 1.0}

    def is_inner(self, atom: int) -> bool:
        """Return True if gradients pass through an atom: neither source nor named block."""
        return atom not in self._leaves and (atom in self.functions or atom in self.sums)


def _key(signal: Signal) -> object:
    return "sum", tuple(sorted(signal.items()))
