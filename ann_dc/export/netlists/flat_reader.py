"""Flattened deck: elements after expansion of all subcircuits that are not parts.

The reader takes decks of this package, from which a list of parts is made. It does not run them.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from ann_dc.backends.spice.ngspice.expressions import value_of

PARTS = ("opamp", "opamp_fd", "mul4q", "ota", "ota_diff", "clk2")
"""Library subcircuits that represent a part, for every implementation of a level."""

FUNCTIONS = "func_"
"""Prefix of the names of function generators."""

ENDS = dict.fromkeys("rcvidb", 2) | dict.fromkeys("segm", 4) | {"q": 3}
"""Number of nodes of an element, by the first letter of its name."""

VALUED = "rcvi"
"""Elements whose first word after the nodes is their value."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Element:
    """Element of a flat netlist, named with its instances, such as ``x_cell_0.x_u_a.c1``.

    ``kind`` is a letter, or the name of the subcircuit that represents a part with the parameters
    ``given``. Nets inside an instance begin with its name. The remaining words are a model, a
    waveform or an expression; the value is in ohms, farads, volts or amperes.
    """

    name: str
    kind: str
    nodes: tuple[str, ...]
    words: tuple[str, ...] = ()
    value: float | None = None
    given: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Subcircuit:
    pins: tuple[str, ...]
    defaults: dict[str, str]
    cards: list[str]


@dataclass(frozen=True)
class _Deck:
    """Declarations of a deck: subcircuits, top-level cards, global parameters and nodes."""

    subcircuits: dict[str, _Subcircuit]
    cards: list[str]
    parameters: dict[str, float]
    everywhere: set[str]


def flattened(text: str, files: Mapping[str, str]) -> list[Element]:
    r"""Return every element of a deck, in the order of the cards.

    The included ``files`` are given by name. Raises `FileFormatError` if an element is unknown, or
    a file or a subcircuit is missing.
    """
    deck = _declared(text, files)
    return list(_opened(deck, deck.cards, deck.parameters, {}, ""))


def logical_lines(text: str, files: Mapping[str, str]) -> Iterator[str]:
    """Yield joined lower-case lines without comments, with included files expanded."""
    controls, left = False, {name.lower(): content for name, content in files.items()}
    for line in _joined(text):
        if line == ".end":
            return
        controls = line == ".control" or (controls and line != ".endc")
        if controls or line == ".endc":
            continue
        if line.startswith(".include"):
            name = line.removeprefix(".include").strip().strip('"')
            yield from logical_lines(left.pop(name), {})
        else:
            yield line


def _joined(text: str) -> list[str]:
    """Return lower-case lines joined with their continuations, without comments."""
    lines: list[list[str]] = []
    for row in map(str.strip, text.lower().splitlines()):
        if row.startswith("+") and lines:
            lines[-1].append(row[1:].strip())
        elif row and not row.startswith("*"):
            lines.append([row])
    return [" ".join(parts) for parts in lines]


def _declared(text: str, files: Mapping[str, str]) -> _Deck:
    deck, inside = _Deck({}, [], {}, {"0"}), None
    for line in logical_lines(text, files):
        words = line.split()
        if words[0] == ".subckt":
            inside = _Subcircuit(*_head(words[2:]), [])
            deck.subcircuits[words[1]] = inside
        elif words[0] == ".ends":
            inside = None
        elif words[0] == ".global":
            deck.everywhere.update(words[1:])
        elif words[0] == ".param":
            for name, given in _assigned(words[1:]).items():
                braced = given if given.startswith("{") else "{" + given + "}"
                deck.parameters[name] = value_of(braced, deck.parameters)
        elif not words[0].startswith("."):
            (deck if inside is None else inside).cards.append(line)
    return deck


def _head(words: list[str]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the plain words of a subcircuit or an instance, and its parameters."""
    pins = [word for word in words if "=" not in word and word != "params:"]
    return tuple(pins), _assigned(words)


def _assigned(words: list[str]) -> dict[str, str]:
    pairs = [word.partition("=") for word in words]
    return {name: given for name, _, given in pairs if given}


def _opened(
    deck: _Deck, cards: list[str], known: Mapping[str, float], nets: dict[str, str], path: str
) -> Iterator[Element]:
    """Yield the elements of cards within the instance that a path names."""
    for card in cards:
        words = card.split()
        name = path + words[0]
        if words[0][0] == "x":
            yield from _instance(deck, words, name, known, nets, path)
            continue
        count = ENDS[words[0][0]]
        nodes = tuple(_net(deck, word, nets, path) for word in words[1 : 1 + count])
        rest = tuple(words[1 + count :])
        valued = words[0][0] in VALUED and (rest[0][0] in "{+-." or rest[0][0].isdigit())
        value = value_of(rest[0], known) if valued else None
        yield Element(name=name, kind=words[0][0], nodes=nodes, words=rest, value=value)


def _instance(
    deck: _Deck,
    words: list[str],
    name: str,
    known: Mapping[str, float],
    nets: dict[str, str],
    path: str,
) -> Iterator[Element]:
    plain, given = _head(words[1:])
    *ends, kind = plain
    inner = deck.subcircuits[kind]
    nodes = tuple(_net(deck, word, nets, path) for word in ends)
    own = {n: value_of(v, known) for n, v in given.items()}
    own = {n: value_of(v, deck.parameters) for n, v in inner.defaults.items() if n not in own} | own
    if kind in PARTS or kind.startswith(FUNCTIONS):
        yield Element(name=name, kind=kind, nodes=nodes, given=own)
        return
    inside = dict(zip(inner.pins, nodes, strict=True))
    yield from _opened(deck, inner.cards, ChainMap(own, deck.parameters), inside, name + ".")


def _net(deck: _Deck, node: str, nets: Mapping[str, str], path: str) -> str:
    return node if node in deck.everywhere else nets.get(node, path + node)
