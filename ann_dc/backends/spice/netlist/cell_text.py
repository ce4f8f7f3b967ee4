"""Text of one cell: cards with cell-internal node names, and their values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

LINE = 100
"""Longest line; longer lines are continued."""


class CellText:
    r"""Cards of one cell with internal node names, and the values used by the cards.

    Names of its nodes lose the number of the cell. Those of its neighbours become ``prev__`` and
    ``next__``, with a number if they are further away. ``ports`` has the internal names by
    top-level nodes, and ``kinds`` the number of cards of each kind.

    >>> cell = CellText(3)
    >>> cell.card("R_1", ("q_x__3", "q_x__2"), "res", {"r": cell.value("r_1", 1e4)})
    >>> print("\n".join(cell.subcircuit("cell_0")).rstrip())
    .subckt cell_0 q_x prev__q_x params: r_1=10000
    R_1 q_x prev__q_x res r={r_1}
    .ends cell_0
    """

    def __init__(self, stage: int) -> None:
        self.stage = stage
        self.lines: list[str] = []
        self.values: dict[str, float] = {}
        self.ports: dict[str, str] = {}
        self.kinds: Counter[str] = Counter()

    def comment(self, text: str) -> None:
        """Add a comment line."""
        self.lines.append(f"* {commented(text)}")

    def value(self, name: str, given: float) -> str:
        """Add a parameter of the cell and return the card's reference to it."""
        assert name not in self.values, f"two parameters of a cell are called {name}"
        self.values[name] = given
        return f"{{{name}}}"

    def card(
        self,
        name: str,
        nodes: tuple[str, ...],
        kind: str,
        given: Mapping[str, str],
        *,
        counts_as: str | None = None,
    ) -> None:
        """Add one element of the given kind (subcircuit or model).

        The nodes have top-level names, with ``@`` before those internal to the cell. ``counts_as``
        is the row in the table of parts; by default the kind.
        """
        inside = " ".join(self._inside(node) for node in nodes)
        parameters = "".join(f" {key}={text}" for key, text in given.items())
        self.kinds[counts_as or kind] += 1
        self.lines.append(wrapped(f"{name} {inside} {kind}{parameters}"))

    def _inside(self, node: str) -> str:
        if node == "0":
            return node
        if node.startswith("@"):
            return node[1:]
        if node not in self.ports:
            self.ports[node] = self._local(node)
        return self.ports[node]

    def _local(self, node: str) -> str:
        where = re.fullmatch(r"(?P<name>.+?)__(?P<stage>-?\d+)(?P<sign>__n)?", node)
        if where is None:
            return node
        offset = int(where["stage"]) - self.stage
        away = "" if abs(offset) == 1 else f"{abs(offset)}"
        side = f"{'prev' if offset < 0 else 'next'}{away}__" if offset else ""
        return side + where["name"] + (where["sign"] or "")

    @property
    def shape(self) -> tuple:
        """Data that two cells must have in common to be instances of one subcircuit."""
        return tuple(self.lines), tuple(self.values), tuple(self.ports.values())

    def subcircuit(self, name: str) -> list[str]:
        """Return the definition, with this cell's values as defaults."""
        given = " ".join(f"{key}={number(value)}" for key, value in self.values.items())
        head = f".subckt {name} {' '.join(self.ports.values())} params: {given}"
        return [wrapped(head), *self.lines, f".ends {name}", ""]

    def instance(self, card: str, name: str, first: CellText) -> str:
        """Return this cell as an instance of a definition made from ``first``."""
        other = [
            f"{key}={number(value)}"
            for key, value in self.values.items()
            if value != first.values[key]
        ]
        return wrapped(" ".join([card, *self.ports, name, *other]))


def commented(text: str) -> str:
    """Return text that cannot end a comment."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def number(value: float) -> str:
    """Return a number in netlist format, with nine digits."""
    return f"{value:.9g}"


def wrapped(line: str) -> str:
    """Return the line, continued with ``+`` if it is long."""
    rows, row = [], ""
    for word in line.split(" "):
        if row and len(row) + 1 + len(word) > LINE:
            rows.append(row)
            row = "+ " + word
        else:
            row = f"{row} {word}" if row else word
    return "\n".join([*rows, row])
