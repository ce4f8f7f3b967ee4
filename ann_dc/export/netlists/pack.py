"""Self-contained circuit folder: deck, library, BOM, scaling and expected results.

Run ``unzip``, then ``ngspice -b deck.cir``; Python is not needed. The run writes the settled and
expected controls to 'controls.csv', and the waveforms of the controls to 'waveforms.txt'. A check
compares the hashes and does not run the deck.
"""

from __future__ import annotations

import io
import math
import re
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import number
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.netlists.build import Build, LevelOrName, build
from ann_dc.export.netlists.flat_reader import flattened, logical_lines
from ann_dc.export.netlists.parts import (
    CLASSES,
    REAL,
    Part,
    bill_text,
    package_of,
    parts_of,
    parts_text,
)
from ann_dc.export.reference.contents import README, csv_text, stated, with_sums
from ann_dc.export.reference.sidecar import check_vector
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.fidelity.circuit_study import NEAR
from ann_dc.network.network import Network
from ann_dc.si_prefixes import counted
from ann_dc.validation import checked
from ann_dc.weights.hashes import content_hash

ZIP, PARTS = "pack.zip", "parts.csv"
DECK, FOLDER = "deck.cir", "library"
CONTROLS, WAVEFORMS = "controls.csv", "waveforms.txt"
"""Output files of a run."""
LONGEST_README = 100_000
"""Largest number of bytes that are read of a zipped README."""
ROWS = 200
"""Maximum number of rows of a waveform table."""

CONTENT, ACCURACY = "content", "predicted control error"
"""Prefixes of the netlist lines on the network and on its accuracy."""

WORD = re.compile(r"[a-z_]\w*")


@checked
def pack_files(
    network: Network,
    vector: ReferenceVector,
    *,
    level: LevelOrName = "macro",
    series: str = "exact",
    zipped: bool = False,
) -> dict[str, bytes]:
    """Export a circuit as a folder that ngspice runs without Python.

    The files are 'deck.cir', ``library/*``, 'bill.csv', 'parts.csv', 'scaling.csv',
    'expected_controls.csv', 'expected_waveforms.csv', 'README.md', 'reference_vector.json' and
    ``SHA256SUMS``. Raises `ExportError` with the reason if the network cannot be built at the level
    or is not that of the vector, and `UnknownNameError` for an unknown level or series.

    The level is ``behavioural``, ``macro``, ``differential``, ``ota-c``, ``switched-capacitor``,
    ``transistor``, a part set by name, or a `Level`. The series of the resistors is
    ``exact``, ``E12``, ``E24``, ``E96``, ``E24-pairs`` or ``E96-pairs``. With ``zipped``, the
    result is a single file 'pack.zip' with all files, with reproducible bytes.
    """
    check_vector(network, vector)
    files = with_sums(_files(build(network, level, series, vector.duration), vector))
    return {ZIP: _zip(files)} if zipped else files


def _files(made: Build, vector: ReferenceVector) -> dict[str, bytes]:
    deck, library = deck_text(made), library_of(made)
    parts = parts_of(flattened(deck, library), made.level.name)
    texts = {
        DECK: deck,
        **library,
        "bill.csv": bill_text(made, parts),
        PARTS: parts_text(parts),
        "scaling.csv": scaling_text(made),
        "expected_controls.csv": expected_text(made),
        "expected_waveforms.csv": waveforms_text(made),
        README: readme_text(made, parts),
    }
    return {name: text.encode() for name, text in texts.items()} | {VECTOR: vector.as_json()}


def _zip(files: Mapping[str, bytes]) -> bytes:
    """Pack the files into a zip file with reproducible bytes, without time stamps."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, files[name])
    return stream.getvalue()


def stated_in_pack(files: Mapping[str, bytes]) -> str:
    """Return the statements of a README, which a zipped folder contains."""
    if ZIP not in files:
        return stated(files)
    with zipfile.ZipFile(io.BytesIO(files[ZIP])) as archive, archive.open(README) as stream:
        return stated({README: stream.read(LONGEST_README)})


def scaling_text(build: Build) -> str:
    """Return CSV text with the value of 1 V at every node of a cell."""
    rows, scaling = [], build.circuit.scaling
    for name in build.circuit.schematic.polarity:
        nodes = [node for (own, _), node in build.deck.signals.items() if own == name]
        if nodes:
            scale, alias = build.circuit.scale_of(name), build.circuit.alias[name]
            where = nodes[0] if len(nodes) == 1 else f"{alias}__<stage>"
            used = f"{scaling.used(name):.3g}" if name in scaling.peaks else ""
            ends = (f"{scale.factor:.9g}", f"{1 / scale.factor:.9g}", f"{scale.offset:.9g}")
            rows.append((where, name, *ends, used))
    head = ("node", "quantity", "user unit per volt", "volts per user unit", "offset", "used")
    return csv_text(head, rows)


def expected_text(build: Build) -> str:
    """Return CSV text with the final controls, in the user's units and in volts."""
    rows = []
    for reading in build.controls:
        value = build.final(reading)
        volts = reading.scale.network(value)
        place = plain(reading.name), reading.stage, reading.node
        rows.append((*place, f"{value:.9g}", f"{volts:.9g}"))
    return csv_text(("control", "stage", "node", "expected", "volts"), rows)


def waveforms_text(build: Build) -> str:
    """Return CSV text with the waveforms (V over s) of the ideal network's neurons with a node."""
    probe, timing, network = build.probe, build.deck.timing, build.network
    count = len(probe.time)
    at = np.unique(np.linspace(0, count - 1, min(count, ROWS)).round().astype(int))
    values = evaluator(network).values(probe.states[at])[..., 1:-1]
    seconds = timing.release + timing.unit * probe.time[at]
    columns = [
        values[:, network.node_index[r.name], r.stage] / build.circuit.value_of(r.name)
        for r in build.readings
    ]
    table = np.column_stack([seconds, *columns])
    head = ("seconds", *(f"v({reading.node})" for reading in build.readings))
    return csv_text(head, ([f"{value:.7g}" for value in row] for row in table + 0.0))


def _without_maker(parts: Iterable[Part], level: str) -> str:
    """Return parts without a purchasable type at a level: ``analog switch (2), preset (1)``."""
    count: Counter[str] = Counter()
    for part in parts:
        count[CLASSES[part.kind].description] += package_of(part.kind, level).library == "ann_dc"
    return ", ".join(f"{name} ({number})" for name, number in sorted(count.items()) if number)


BOUGHT = """
Resistors and capacitors have exact values, of which many megohms or few femtofarads cannot be
bought or built: `series=E96-pairs` takes two resistors of that series for each, and capacitors of
E24. With `series=E96`, one for each, controls are often off by several percent.
"""


SETTLING = f"""Above {NEAR:.0%} the result is NOT that of the ideal network, and the exit code is
1. The expected values are those of the ideal network; parts of a level deviate by the effect of
their gain, bandwidth and limits. `ann-dc circuit` prints their noise, tolerances and settling time.
"""
WAVES = """The expected values are those of the ideal network at that time. Small errors of parts
add up over the time of an oscillator, and grow in a chaotic network.
"""
"""Lines of a README on the expected values, by whether the network settles."""


def accuracy_text(build: Build, parts: Iterable[Part] = ()) -> str:
    """Return the first lines of a README: parts without a maker, predicted accuracy."""
    unnamed = _without_maker(parts, build.level.name)
    lines = [f"No part to buy for: {unnamed}."] if unnamed else []
    if build.settles:
        lines += [f"A circuit {_accuracy_words(build.control_error, build.probe.size_in_words)}."]
    else:
        kind = "follows inputs over time" if build.network.waveforms else "does not settle"
        lines += [f"A circuit that {kind}; it runs for {build.deck.timing.end:.4g} s."]
    lines += [f"WARNING: {build.doubt}."] if build.doubt else []
    return "\n\n".join(lines)


def readme_text(build: Build, parts: Sequence[Part]) -> str:
    """Return the README of a folder: content, use, and results to check."""
    deck, network = build.deck, build.network
    first = build.controls[0]
    kinds = ", ".join(counted(number, name) for name, number in deck.parts.items())
    zero = f"{first.scale.offset:.6g} + " if first.scale.offset else ""
    named = parts if build.level.name in REAL else ()
    exact = build.series.name == "exact"
    bought = BOUGHT if exact else ""
    cells = counted(network.stages, "cells")
    with_them = "" if exact else f", capacitors: {build.series.capacitors.name}"
    return f"""# {plain(network.title)}: an analog neural network of {cells}

{accuracy_text(build, named)}

Level: {build.level.name}. Resistors: {build.series.name}{with_them}. {len(parts)} parts: {kinds}.
{bought}
    ngspice -b {DECK}

runs it for {deck.end:.4g} s of circuit time, and needs nothing but this folder. It writes

- `{CONTROLS}`: every control in the user's units at the end, with the expected value,
- `{WAVEFORMS}`: the volts of the controls over time,

and the control error relative to {build.probe.size_in_words}.
{SETTLING if build.settles else WAVES}
| file | content |
|---|---|
| `{DECK}` | the netlist: cells, the row, inputs, reset, the transient |
| `library/` | the models and cells that it includes |
| `bill.csv` | bill of materials: one line for equal components |
| `parts.csv` | every part: reference, name in the deck, value, nets |
| `scaling.csv` | value of a volt at every node |
| `expected_controls.csv` | the controls at the end, in the user's units and in volts |
| `expected_waveforms.csv` | all neurons in volts over seconds, as the ideal network moves |
| `reference_vector.json` | the network's own steps, for `ann-dc inspect` |
| `SHA256SUMS` | `sha256sum -c SHA256SUMS` |

A control is read off its node: {plain(first.name)} of stage {first.stage} is
{zero}{first.scale.factor:.6g} * v({first.node}); `scaling.csv` has the others. The node `rst` holds
the reset: 5 V until {deck.timing.release:.3g} s, 0 V from then on. One unit of network time is
{deck.timing.unit:.4g} s.
"""


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
        "* ---- cell array",
        *deck.row,
        "* ---- inputs and reset",
        *deck.inputs,
        *deck.analysis,
        "* ---- output",
        *_control_lines(build),
        ".end",
    )
    return "\n".join(lines) + "\n"


def _control_lines(build: Build) -> Iterator[str]:
    """Yield the ngspice commands that run, compare and write."""
    expected = {reading: build.final(reading) for reading in build.controls}
    own = {reading: build.network.neuron(reading.name).scale for reading in expected}
    size = build.probe.control_size
    reported = re.sub(r"[^\w.%(),: -]", "_", build.probe.size_in_words, flags=re.ASCII)
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
    if build.settles:
        yield f"if worst gt {number(NEAR)}"
        yield f'echo "NOT where the ideal network settles: off by $&worst of {reported}"'
        yield from ("quit 1", "end")
    verb = "settled" if build.settles else "at the end of the run"
    yield f'echo "controls {verb}: off by $&worst of {reported}"'
    yield from ("quit 0", ".endc")


def claims_of(build: Build) -> tuple[str, str]:
    """Return the netlist lines on the network and on its accuracy."""
    if not build.settles:
        return f"{CONTENT} {content_hash(build.given)}", f"duration {build.deck.timing.end:.6g} s"
    error = f"{build.control_error:.1e} of {build.probe.size_in_words}"
    return f"{CONTENT} {content_hash(build.given)}", f"{ACCURACY} {error}"


def _accuracy_words(error: float, size: str) -> str:
    """Return the predicted control error of a circuit as text.

    It is relative to the size of the controls, as in `Trajectory.size_in_words`; nan is unknown.
    """
    if math.isnan(error):
        return "whose control error was not predicted: the level has no emulation"
    above = f", NOT within {NEAR:.0%}" if error > NEAR else ""
    off = f"off by {error:.1e} of {size}{above} (nominal parts)"
    return f"whose controls are predicted to be {off}"


def plain(name: str) -> str:
    """Return a name without characters that ngspice or a table would interpret."""
    return re.sub(r"[^\w.]", "_", name, flags=re.ASCII)
