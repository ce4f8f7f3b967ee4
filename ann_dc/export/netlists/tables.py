"""What lies in a pack beside the deck: scaling sheet, expected controls and waveforms, README."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.export.netlists.build import Build
from ann_dc.export.netlists.deck_file import (
    CONTROLS,
    DECK,
    WAVEFORMS,
    accuracy_words,
    plain,
)
from ann_dc.export.netlists.packages import REAL
from ann_dc.export.netlists.parts import Part, without_maker
from ann_dc.fidelity.circuit_study import NEAR
from ann_dc.si_prefixes import counted

ROWS = 200
"""Most rows of a table of waveforms."""


def csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Rows as CSV text.

    Parameters
    ----------
    head : sequence of str
    rows : iterable of sequences

    Examples
    --------
    >>> csv_text(("a", "b"), [(1, "x, y")])
    'a,b\\n1,"x, y"\\n'
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return stream.getvalue()


def scaling_text(build: Build) -> str:
    """CSV text: what a volt at every node of a cell stands for.

    Parameters
    ----------
    build : Build

    Returns
    -------
    str
    """
    rows, scaling = [], build.circuit.scaling
    for name in build.circuit.schematic.polarity:
        nodes = [node for (own, _), node in build.deck.signals.items() if own == name]
        if nodes:
            scale, alias = build.circuit.scale_of(name), build.circuit.alias[name]
            where = nodes[0] if len(nodes) == 1 else f"{alias}__<stage>"
            used = f"{scaling.used(name):.3g}" if name in scaling.peaks else ""
            ends = (f"{scale.factor:.9g}", f"{1 / scale.factor:.9g}", f"{scale.offset:.9g}")
            rows.append((where, name, *ends, used))
    head = ("node", "stands for", "user unit a volt", "volts a user unit", "offset", "used")
    return csv_text(head, rows)


def expected_text(build: Build) -> str:
    """CSV text: what every control settles to, in the user's units and in volts.

    Parameters
    ----------
    build : Build

    Returns
    -------
    str
    """
    rows = []
    for reading in build.controls:
        value = build.settled(reading)
        volts = reading.scale.network(value)
        place = plain(reading.name), reading.stage, reading.node
        rows.append((*place, f"{value:.9g}", f"{volts:.9g}"))
    return csv_text(("control", "stage", "node", "expected", "volts"), rows)


def waveforms_text(build: Build) -> str:
    """CSV text: volts over seconds of all neurons that a node carries, as the ideal network moves.

    Parameters
    ----------
    build : Build

    Returns
    -------
    str
    """
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


BOUGHT = """
Resistors and capacitors have exact values, of which many megohms or few femtofarads cannot be
bought or built: `series=E96-pairs` takes two resistors of that series for each, and capacitors of
E24. With `series=E96`, one for each, controls are often off by several percent.
"""


def accuracy_text(build: Build, parts: Iterable[Part] = ()) -> str:
    """Return the first lines of a README: parts without a maker, and the predicted accuracy.

    Parameters
    ----------
    build : Build
    parts : iterable of Part
        Those to buy.
    """
    unnamed = without_maker(parts, build.level.name)
    lines = [f"No part to buy for: {unnamed}."] if unnamed else []
    lines += [f"A circuit {accuracy_words(build.control_error, build.probe.size_in_words)}."]
    lines += [f"WARNING: {build.doubt}."] if build.doubt else []
    return "\n\n".join(lines)


def readme_text(build: Build, parts: Sequence[Part]) -> str:
    """What the pack is, how to run it, and what to look at.

    Parameters
    ----------
    build : Build
    parts : sequence of Part
        Of the circuit.

    Returns
    -------
    str
    """
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

- `{CONTROLS}`: every control in the user's units as it settled, beside what is expected,
- `{WAVEFORMS}`: the volts of the controls over time,

and says how far the controls are off, as a share of {build.probe.size_in_words}.
Above {NEAR:.0%} it says that they are NOT where the ideal network settles, with exit code 1. The
expected values are those of the ideal
network; parts of a level are off by what their gain, bandwidth and rails cost. `ann-dc circuit` has
their noise, tolerances and settling time.

| file | what |
|---|---|
| `{DECK}` | the netlist: cells, the row, inputs, reset, the transient |
| `library/` | the models and cells that it includes |
| `bill.csv` | what to buy: one line for all components that are the same |
| `parts.csv` | every part: reference, name in the deck, value, nets |
| `scaling.csv` | what a volt at a node stands for |
| `expected_controls.csv` | what the controls settle to, in the user's units and in volts |
| `expected_waveforms.csv` | all neurons in volts over seconds, as the ideal network moves |
| `reference_vector.json` | the network's own steps, for `ann-dc inspect` |
| `SHA256SUMS` | `sha256sum -c SHA256SUMS` |

A control is read off its node: {plain(first.name)} of stage {first.stage} is
{zero}{first.scale.factor:.6g} * v({first.node}); `scaling.csv` has the others. The node `rst` holds
the reset: 5 V until {deck.timing.release:.3g} s, 0 V from then on. One unit of network time is
{deck.timing.unit:.4g} s.
"""
