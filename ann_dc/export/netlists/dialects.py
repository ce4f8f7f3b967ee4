"""Single-file decks in the dialects of LTspice and Xyce.

Both dialects follow the grammar in the simulators' manuals. Neither simulator has been run: the
LTspice deck runs in ngspice's LTspice mode.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

from ann_dc.backends.spice.netlist.cell_text import number, wrapped
from ann_dc.backends.spice.pdk.files import PACKAGE
from ann_dc.errors import ExportError
from ann_dc.export.netlists.build import Build, LevelOrName, build, name_of
from ann_dc.export.netlists.flat_reader import flattened
from ann_dc.export.netlists.pack import (
    DECK,
    PARTS,
    accuracy_text,
    claims_of,
    expected_text,
    models_of,
    plain,
    scaling_text,
)
from ann_dc.export.netlists.parts import Part, parts_of, parts_text
from ann_dc.export.reference.contents import README, with_sums
from ann_dc.export.reference.sidecar import check_vector
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.si_prefixes import counted
from ann_dc.validation import checked

MEASURED = 0.999
"""Time of the control measurement relative to the end of the run."""

EXPONENT = re.compile(r"(?<![\w.])e(?=[=)}])", re.IGNORECASE)
"""Parameter ``e`` of an inverter, which both simulators read as 2.718."""

SWITCH = re.compile(r"sw\(vt=2\.5 vh=0 (.*)\)")
BRACED = re.compile(r"\{([^{}]*)\}")

LTSPICE = """\
| here | in the pack's deck | why |
|---|---|---|
| one file | library included | nothing to look for |
| `.meas tran` | `.control`, `wrdata`, `echo` | LTspice has no command language; see its log |
| `ee` in `inv` | `e` | LTspice reads `e` as a constant |
| `.save`, `.tran`, `.options`, `B`, `S`, `params:` | the same | the same grammar |
"""

XYCE = """\
| here | in the pack's deck | why |
|---|---|---|
| one file | library included | nothing to look for |
| `.print tran format=csv` | `.save`, `wrdata` | writes the named nodes, here `waveforms.csv` |
| `.measure tran` | `.control`, `echo` | Xyce has no command language; see `deck.cir.mt0` |
| `B1 out 0 V={...}`, all in braces | braces around parameters | grammar of expressions |
| `X... name params: a=1` | `X... name a=1` | instances need the word |
| `vswitch(von=2.6 voff=2.4 ...)` | `sw(vt=2.5 vh=0 ...)` | the model it has |
| `level=2` of diodes with `nbv` | level 1 | only that one has `nbv` |
| no `off` behind diodes | `off` | another start of the operating point |
| `.param a={...}` | `.param a=...` | expressions stand in braces |
| `.options timeint`, `nonlin` | `.options` | packages of options |
| `ee` in `inv` | `e` | not to be taken for a constant |
"""


@checked
def ltspice_files(
    network: Network,
    vector: ReferenceVector,
    *,
    level: LevelOrName = "macro",
    series: str = "exact",
) -> dict[str, bytes]:
    """Export a deck in the LTspice dialect, tested only in ngspice's LTspice mode.

    Options and errors are those of `pack_files`, except the level ``sky130``. The files are
    'deck.cir', 'parts.csv', 'scaling.csv', 'expected_controls.csv', 'README.md',
    'reference_vector.json' and ``SHA256SUMS``.
    """
    made = _build(network, vector, level, series)
    return _files(made, vector, _deck(made, str, _ltspice_end), "LTspice", LTSPICE)


@checked
def xyce_files(
    network: Network,
    vector: ReferenceVector,
    *,
    level: LevelOrName = "macro",
    series: str = "exact",
) -> dict[str, bytes]:
    """Export a deck in the Xyce dialect, not tested in Xyce; the files are as in `ltspice_files`.

    Raises `ExportError` for the levels ``sky130`` and ``switched-capacitor``.
    """
    made = _build(network, vector, level, series)
    if made.level.technology.clocked:
        raise ExportError(
            f"level {name_of(level)}: its switches need a hard threshold, and those of Xyce "
            "change over a range; use another level, or the pack for ngspice"
        )
    return _files(made, vector, _deck(made, _xyce, _xyce_end), "Xyce", XYCE)


def _build(network: Network, vector: ReferenceVector, level: LevelOrName, series: str) -> Build:
    check_vector(network, vector)
    if name_of(level).lower() == PACKAGE:
        raise ExportError(
            f"level {name_of(level)}: its models are written for ngspice, with AGAUSS and lengths "
            "in micrometres; use another level, or the pack for ngspice"
        )
    return build(network, level, series, vector.duration)


def _files(
    made: Build, vector: ReferenceVector, deck: str, simulator: str, differences: str
) -> dict[str, bytes]:
    parts = parts_of(flattened(deck, {}), made.level.name)
    texts = {
        DECK: deck,
        PARTS: parts_text(parts),
        "scaling.csv": scaling_text(made),
        "expected_controls.csv": expected_text(made),
        README: _readme(made, parts, simulator, differences),
    }
    files = {name: text.encode() for name, text in texts.items()}
    return with_sums({**files, VECTOR: vector.as_json()})


def _readme(made: Build, parts: Sequence[Part], simulator: str, differences: str) -> str:
    cells = counted(made.network.stages, "cells")
    return f"""# {plain(made.network.title)}: a deck for {simulator}

{accuracy_text(made, parts)}

`{DECK}` is the {made.level.name} level of {cells}. It measures the volts of
every control near the end of the run; `expected_controls.csv` has those that are expected, and
`scaling.csv` the value of a volt. **It was written after {simulator}'s manual, and has not been
run in {simulator}.** What is different from the deck for ngspice:

{differences}"""


def _deck(made: Build, dialect: Callable[[str], str], end: Callable[[Build], Iterator[str]]) -> str:
    """Return the deck of a dialect, converted card by card."""
    deck = made.deck
    lines = (*models_of(made), *deck.cells, *deck.row, *deck.inputs)
    cards = (
        card if card.startswith("*") else wrapped(dialect(EXPONENT.sub("ee", card)))
        for card in _cards("\n".join(lines))
    )
    head = (deck.head[0], *(f"* {words}" for words in claims_of(made)), *deck.head[2:])
    return "\n".join([*head, *cards, *end(made), ".end", ""])


def _cards(text: str) -> Iterator[str]:
    """Yield cards with their continuation lines, and comments."""
    card = ""
    for line in text.splitlines():
        if line.startswith("+"):
            card += " " + line[1:].strip()
            continue
        if card:
            yield card
        card = line.rstrip()
    yield card


def _measures(made: Build) -> Iterator[str]:
    at = number(MEASURED * made.deck.end)
    for reading in made.controls:
        yield f".meas tran end_{reading.node} FIND v({reading.node}) AT={at}"


def _ltspice_end(made: Build) -> Iterator[str]:
    yield from made.deck.analysis
    yield from _measures(made)


def _xyce(card: str) -> str:
    letter, words = card[:1].lower(), card.split()
    if letter == "b":
        *head, expression = words
        kind, _, body = expression.partition("=")
        body = BRACED.sub(r"(\1)", body)
        return " ".join([*head, f"{kind}={{{body}}}"])
    if letter == "x":
        place = next((i for i, word in enumerate(words) if "=" in word), len(words))
        more = ["params:", *words[place:]] if words[place:] else []
        return " ".join([*words[:place], *more])
    if letter == "d":
        return card.removesuffix(" off")
    if words[:1] == [".param"]:
        name, _, given = card.removeprefix(".param").strip().partition("=")
        return f".param {name}={given if given.startswith('{') else '{' + given + '}'}"
    if words[:1] == [".model"]:
        card = SWITCH.sub(r"vswitch(von=2.6 voff=2.4 \1)", card)
        return card.replace(" d(", " d(level=2 ") if "nbv=" in card else card
    return card


def _xyce_end(made: Build) -> Iterator[str]:
    deck = made.deck
    given = dict(pair.split("=") for pair in deck.options.split())
    step, end = number(deck.timing.step), number(deck.timing.end)
    yield f".options timeint method={given['method']} reltol={given['reltol']} abstol=1e-7"
    yield ".options nonlin maxstep=100"
    yield f".tran {step} {end} 0 {step}"
    nodes = " ".join(f"v({node})" for node in deck.signals.values())
    yield wrapped(f".print tran format=csv file=waveforms.csv {nodes}")
    yield from (card.replace(".meas", ".measure") for card in _measures(made))
