"""Vector code for shared neurons: read in every lane, summed over all cells.

Their states and derivatives are stored at the places of the last stage. Other stages have zeros in
these places.
"""

from __future__ import annotations

from collections.abc import Callable

from ann_dc.evaluation.codegen.writer import Function


class Buses:
    """Shared neurons of a function under construction, whose states are read immediately.

    ``rows`` are those of the shared neurons among the neurons of a cell. The ghosts at an end of
    the states have ``beyond`` neurons. ``base`` contains the addresses of ``x``, ``rates``,
    ``drives`` and ``out``, and the offset ``last`` of the first neuron of the last stage in a table
    of derivatives. ``is_row`` is True if a lane is a stage, ``is_wide`` if rates have one number
    per lane. ``values`` contains the state of every shared neuron in all lanes.
    """

    def __init__(
        self, f: Function, rows: tuple[int, ...], beyond: int, base: dict[str, str], *,
        is_row: bool, is_wide: bool,
    ) -> None:  # fmt: skip
        self.f, self.rows, self.base = f, rows, base
        self.is_row, self.is_wide = is_row, is_wide
        self.ghost = beyond * f.width
        self.values = {row: self._at("x", row, self.ghost) for row in rows}
        self.totals: dict[int, str] = {}

    def begin(self) -> None:
        """Reset the sums of all shared neurons to zero."""
        self.totals = {row: self.f.slot() for row in self.rows}

    def add(self, row: int, arriving: str) -> None:
        """Add the contribution of the cells, one per lane, to the sum of a neuron."""
        f, total = self.f, self.totals[row]
        f.store(f.op("fadd", f.load(total), arriving), total)

    def end(self, at_limits: Callable[[int, str], str]) -> None:
        """Write net inputs and derivatives of all shared neurons, limited by ``at_limits``."""
        f = self.f
        for row, slot in self.totals.items():
            total = f.load(slot)
            if self.is_row:
                total = f.spread(f.across("fadd", total))
            drive = at_limits(row, total)
            derivative = f.op("fmul", self._rate(row), drive)
            for name, value in (("drives", drive), ("out", derivative)):
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
