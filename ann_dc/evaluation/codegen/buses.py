"""Neurons that all cells share, as vector code: read in every lane, and a sum over all of them.

Their states and moves lie where the last stage has them; other stages have zeros in their places.
"""

from __future__ import annotations

from collections.abc import Callable

from ann_dc.evaluation.codegen.writer import Function


class Buses:
    """The shared neurons of a function that is being written.

    Parameters
    ----------
    f : Function
        Whose lines come next: the states are read at once.
    rows : sequence of int
        Of the shared neurons among all.
    neurons : int
        P.
    base : dict of str to str
        Addresses of ``x``, ``rates``, ``drives`` and ``out``, and ``last``, where the first neuron
        of the last stage lies in a table of moves.
    is_row : bool
        Whether a lane is a stage; else it is a sample.
    is_wide : bool
        Whether rates have a number a lane.

    Attributes
    ----------
    values : dict of int to str
        Of every shared neuron, in all lanes.
    """

    def __init__(
        self, f: Function, rows: tuple[int, ...], neurons: int, base: dict[str, str], *,
        is_row: bool, is_wide: bool,
    ) -> None:  # fmt: skip
        self.f, self.rows, self.base = f, rows, base
        self.is_row, self.is_wide = is_row, is_wide
        self.ghost = neurons * f.width
        self.values = {row: self._at("x", row, self.ghost) for row in rows}
        self.totals: dict[int, str] = {}

    def begin(self) -> None:
        """Nothing has arrived yet."""
        self.totals = {row: self.f.slot() for row in self.rows}

    def add(self, row: int, arriving: str) -> None:
        """What these cells send to a neuron; a lane each."""
        f, total = self.f, self.totals[row]
        f.store(f.op("fadd", f.load(total), arriving), total)

    def end(self, at_rails: Callable[[int, str], str]) -> None:
        """Drives and moves of all of them, which stop where ``at_rails`` says."""
        f = self.f
        for row, slot in self.totals.items():
            total = f.load(slot)
            if self.is_row:
                total = f.spread(f.across("fadd", total))
            drive = at_rails(row, total)
            move = f.op("fmul", self._rate(row), drive)
            for name, value in (("drives", drive), ("out", move)):
                self._put(value, self._address(name, row))

    def _address(self, name: str, row: int, beyond: int = 0) -> str:
        return self.f.address(self.base[name], self.base["last"], row * self.f.width + beyond)

    def _at(self, name: str, row: int, beyond: int = 0) -> str:
        f, address = self.f, self._address(name, row, beyond)
        return f.spread(f.load(address, 1)) if self.is_row else f.load(address)

    def _rate(self, row: int) -> str:
        f = self.f
        if self.is_wide:
            return self._at("rates", row)
        stage = f.integer("sdiv", self.base["last"], f.width)
        return f.spread(f.load(f.address(self.base["rates"], stage, row), 1))

    def _put(self, value: str, address: str) -> None:
        f = self.f
        if self.is_row:
            f.store(f.lane(value, 0), address, 1)
        else:
            f.store(value, address)
