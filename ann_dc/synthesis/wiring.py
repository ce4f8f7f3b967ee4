"""A cell under construction: atoms with their names, and the signals that feed them.

An atom is a source (a neuron, an input), a function block or a summing block; its operands were
made before it. Whoever wires a cell reads expressions into signals (`expressions`), derives the
adjoint half from them (`adjoint`) and takes blocks and connections at the end (`assembly`).
"""

from __future__ import annotations

from collections.abc import Iterable

from ann_dc.synthesis.signals import VALUE, Signal, bare


class Wiring:
    """The atoms of a cell.

    Parameters
    ----------
    sources : iterable of str
        Names of neurons and inputs.

    Attributes
    ----------
    names : list of str
        Name of every atom.
    sources : dict of name to atom
        Neurons, inputs and named sums.
    functions : dict of atom to (function, atom)
        Function blocks and what they read.
    sums : dict of atom to Signal
        Summing blocks and what they add up.
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
        """The signal that is one source or one named sum, by its ``name``."""
        return {(self.sources[name],): 1.0}

    def name_value(self, signal: Signal, name: str) -> None:
        """Call the summing block that carries a signal by the symbol whose value it is.

        Parameters
        ----------
        signal : Signal
            A source in the user's units.
        name : str
            Of the symbol.
        """
        self._values[_key(signal)] = f"{VALUE}{name}"

    def named_sum(self, name: str) -> Signal:
        """A summing block that the caller names (c, m, r, b) and fills later.

        Gradients stop at it, as they stop at a source.

        Parameters
        ----------
        name : str
            Of the block, for instance ``c.x``.

        Returns
        -------
        Signal
        """
        atom = self.sources[name] = self._atom(name)
        self.sums[atom] = {}
        self._leaves.add(atom)
        return {(atom,): 1.0}

    def fill(self, name: str, signal: Signal) -> None:
        """Say what the named sum ``name`` adds up: ``signal``."""
        self.sums[self.sources[name]] = signal

    def named_function(self, name: str, function: str, source: str) -> None:
        """A function block that the caller names, on a named sum; gradients stop at it.

        Parameters
        ----------
        name : str
            Of the block, for instance ``zeta.g1``.
        function : str
            Of a function block, for instance ``rectify``.
        source : str
            The named sum that it reads.
        """
        atom = self.sources[name] = self._atom(name)
        self.functions[atom] = (function, self.sources[source])
        self._leaves.add(atom)

    def atom(self, signal: Signal) -> int:
        """The node that carries a signal: itself if it is one, a summing block if not."""
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
        """A function block on a signal; the same block on the same signal exists once.

        Parameters
        ----------
        name : str
            Of a function block, for instance ``sin``.
        signal : Signal
            Its argument.

        Returns
        -------
        Signal
        """
        key = (name, self.atom(signal))
        if key not in self._known:
            self._known[key] = self._atom(f"{name}({bare(self.names[key[1]])})")
            self.functions[self._known[key]] = key
        return {(self._known[key],): 1.0}

    def one(self, signal: Signal) -> Signal:
        """The same signal as a single atom."""
        return {(self.atom(signal),): 1.0}

    def is_inner(self, atom: int) -> bool:
        """Whether gradients go through an atom: neither a source nor a named block."""
        return atom not in self._leaves and (atom in self.functions or atom in self.sums)


def _key(signal: Signal) -> object:
    return "sum", tuple(sorted(signal.items()))
