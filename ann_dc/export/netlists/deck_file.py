"""Deck of a self-contained ngspice folder, with library files and result output.

``ngspice -b deck.cir`` runs the deck. The run writes the settled and expected controls to
'controls.csv', and the waveforms of the controls to ``waveforms.txt``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from ann_dc.backends.spice.netlist.cell_text import number
from ann_dc.export.netlists.build import Build
from ann_dc.export.netlists.flat_reader import logical_lines
from ann_dc.fidelity.circuit_study import NEAR
from ann_dc.weights.hashes import content_hash

DECK, FOLDER = "deck.cir", "library"
CONTROLS, WAVEFORMS = "controls.csv", "waveforms.txt"
"""Output files of a run."""

CONTENT, ACCURACY = "content", "predicted control error"
"""Prefixes of the netlist lines on the network and on its accuracy."""

WORD = re.compile(r"[a-z_]\w*")


def library_of(build: Build) -> dict[str, str]:
    """Return the library files that a deck includes, by file name in the folder."""
    deck = build.deck
    names = {name: f"{FOLDER}/{name.rpartition('/')[2]}" for name in deck.library}
    own = "\n".join((*_without_library(build), *deck.cells, *deck.row, *deck.inputs))
    known, needed = {text: _declares(text) for text in deck.library.values()}, set()
    reading = _words(own)
    while reading:
        more = {text for text, made in known.items() if made & reading} - needed
        needed |= more
        reading = set().union(*(_words(text) for text in more))
    return {names[name]: text + "\n" for name, text in deck.library.items() if text in needed}


def _without_library(build: Build) -> Iterator[str]:
    """Yield figures and generators among the models of a deck."""
    inlined = {*build.deck.library.values()}
    return (line for line in build.deck.models if line not in inlined)


def _declares(text: str) -> set[str]:
    """Return the names of the subcircuits and models of a file."""
    lines = [line.split() for line in logical_lines(text, {})]
    return {words[1] for words in lines if words[0] in (".subckt", ".model")}


def _words(text: str) -> set[str]:
    return {word for line in logical_lines(text, {}) for word in WORD.findall(line)}


def models_of(build: Build) -> list[str]:
    """Return figures, models and cells that a deck needs, one text per file."""
    kept = {text.rstrip() for text in library_of(build).values()} | {*_without_library(build)}
    return [text for text in build.deck.models if text in kept]


def deck_text(build: Build) -> str:
    """Return the deck of a folder; it needs only its library files."""
    deck = build.deck
    files = {text.rstrip(): name for name, text in library_of(build).items()}
    models = [f".include {files[text]}" if text in files else text for text in models_of(build)]
    lines = (
        deck.head[0],
        f"* run: ngspice -b {DECK}; it writes {CONTROLS} and {WAVEFORMS}",
        *(f"* {words}" for words in claims_of(build)),
        *deck.head[2:],
        *models,
        "* ---- cells",
        *deck.cells,
        "* ---- the row",
        *deck.row,
        "* ---- inputs and reset",
        *deck.inputs,
        *deck.analysis,
        "* ---- what is written down",
        *_control_lines(build),
        ".end",
    )
    return "\n".join(lines) + "\n"


def _control_lines(build: Build) -> Iterator[str]:
    """Yield the ngspice commands that run, compare and write."""
    expected = {reading: build.settled(reading) for reading in build.controls}
    own = {reading: build.network.neuron(reading.name).scale for reading in expected}
    size = build.probe.control_size
    told = re.sub(r"[^\w.%(),: -]", "_", build.probe.size_in_words, flags=re.ASCII)
    yield from (".control", "set numdgt=9", "run", "let worst = 0", "let last = length(time) - 1")
    yield f"if time[last] lt {number(0.999 * build.deck.end)}"
    yield from ('echo "the run ended early: nothing is settled"', "quit 1", "end")
    yield f'echo "control,stage,node,settled,expected" > {CONTROLS}'
    for reading, value in expected.items():
        factor, zero = number(reading.scale.factor), number(reading.scale.offset)
        row = f"{plain(reading.name)},{reading.stage},{reading.node},$&settled,{number(value)}"
        yield f"let settled = {zero} + {factor} * v({reading.node})[last]"
        yield f'echo "{row}" >> {CONTROLS}'
        share = number(abs(own[reading].factor) * size)
        yield f"let off = abs(settled - ({number(value)})) / {share}"
        yield from ("if off gt worst", "let worst = off", "end")
    yield from ("set wr_singlescale", "set wr_vecnames")
    yield f"wrdata {WAVEFORMS} " + " ".join(f"v({reading.node})" for reading in expected)
    yield f"if worst gt {number(NEAR)}"
    yield f'echo "NOT where the ideal network settles: off by $&worst of {told}"'
    yield from ("quit 1", "end")
    yield f'echo "controls settled: off by $&worst of {told}"'
    yield from ("quit 0", ".endc")


def claims_of(build: Build) -> tuple[str, str]:
    """Return the netlist lines on the network and on its accuracy."""
    error = f"{build.control_error:.1e} of {build.probe.size_in_words}"
    return f"{CONTENT} {content_hash(build.given)}", f"{ACCURACY} {error}"


def accuracy_words(error: float, size: str) -> str:
    """Return the predicted control error of a circuit as text.

    The error is relative to the size of the controls (nan: unknown), with ``size`` as in
    `Trajectory.size_in_words`.

    Examples
    --------
    >>> print(accuracy_words(6.1e-4, "the largest one"))
    whose controls are predicted to be off by 6.1e-04 of the largest one (nominal parts)
    """
    if math.isnan(error):
        return "whose control error was not predicted: the level has no emulation"
    above = f", NOT within {NEAR:.0%}" if error > NEAR else ""
    off = f"off by {error:.1e} of {size}{above} (nominal parts)"
    return f"whose controls are predicted to be {off}"


def plain(name: str) -> str:
    """Return a name without characters that ngspice or a table would interpret.

    Examples
    --------
    >>> plain("u.a b"), plain("u.a")
    ('u.a_b', 'u.a')
    """
    return re.sub(r"[^\w.]", "_", name, flags=re.ASCII)
