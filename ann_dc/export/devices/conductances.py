r"""Crossbar conductances: a pair G+ and G- for every connection weight.

The net input of a node is the current of a pair of columns, scaled by the amplifier of the node:

.. math:: w = \frac{G^+ - G^-}{k}, \qquad \text{folded:}\quad \frac{w}{\tau} = \frac{G^+ - G^-}{k}.

A positive weight is a device in G+ and a negative weight is a device in G-. The other position of
the pair is open, 0 S. Device conductances span a limited number of decades above a lowest value.
The weights of one node have a common k, so they must lie within the same number of decades. In the
plain form every node has its k, and the capacitor of the integrator sets tau. In the folded form
the integrators of all neurons have the same capacitor and a common k; connections to a sum have no
tau.

Conductances are written as decimal numbers with enough digits to recover the weights to the last
bit.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from decimal import Decimal, DecimalException, localcontext

import numpy as np

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.devices.connection_weights import (
    control_error,
    stated_errors,
    weight_error,
    weights_in,
    with_weights,
)
from ann_dc.export.devices.crossbar import EXACT, Crossbar, crossbar_of, exact, nearest
from ann_dc.export.reference.contents import csv_text, rows_by_connection
from ann_dc.export.reference.sidecar import beside, network_and_vector, notes_of
from ann_dc.export.reference.vector import EulerWalk, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import Index, PositiveFinite, checked
from ann_dc.weights.manifest import Table

FORMAT = "ann_dc conductances"
SCHEMA = 1
TABLE, NOTES = "conductances.csv", "conductances.json"
COLUMNS = ("connection", "stage", "g_plus_S", "g_minus_S")
MAX_LEVELS = 2**24
MAX_DECADES = 30


@checked
def conductances_files(
    network: Network,
    vector: ReferenceVector,
    *,
    lowest: PositiveFinite = 1e-6,
    decades: PositiveFinite = 2.0,
    levels: Index = 0,
    folded: bool = False,
) -> dict[str, bytes]:
    """Export the weights of a network as conductance pairs, with quantisation errors.

    'conductances.csv' has one row per connection and stage. 'conductances.json' contains the range,
    the scales and the errors. The preconditioner is not part of a crossbar; it is stored in
    'network.npz'.

    Parameters
    ----------
    network : Network
        Network to export.
    vector : ReferenceVector
        Test vector of the network.
    lowest : float
        Smallest conductance of a conducting device in siemens. Default 1e-6.
    decades : float
        Decades from the lowest to the highest conductance. Default 2.
    levels : int
        Number of values of a device, in equal steps from the lowest to the highest conductance. The
        default 0 allows any value.
    folded : bool
        True if the time constants of the neurons are folded into their conductances. Default False.

    Returns
    -------
    dict of str to bytes
        File contents by file name.

    Raises
    ------
    ExportError
        If the weights of a node do not fit within the decades, or the vector belongs to another
        network.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> files = conductances_files(network, reference_vector(network))
    >>> print(files["conductances.csv"].decode().splitlines()[0])
    connection,stage,g_plus_S,g_minus_S
    >>> all((weights_of(files)[c.name] == c.weight).all() for c in network.cell.connections)
    True
    """
    if levels == 1 or levels > MAX_LEVELS:
        raise ExportError(f"levels: expected 0 (any value) or 2 to {MAX_LEVELS}, got {levels}")
    if decades > MAX_DECADES:
        raise ExportError(f"decades: expected {MAX_DECADES} at most, got {decades:g}")
    files = beside(network, vector)
    with localcontext(EXACT):
        highest = exact(lowest) * Decimal(10) ** exact(decades)
        bar = crossbar_of(network, highest, decades, folded)
        pairs = {name: bar.siemens(name, w) for name, w in weights_in(network).items()}
        if levels:
            pairs = {n: [nearest(g, lowest, highest, levels) for g in p] for n, p in pairs.items()}
        found = {name: bar.weights(name, siemens) for name, siemens in pairs.items()}
    notes = {
        "format": FORMAT,
        "schema": SCHEMA,
        "rule": "weight = (g_plus - g_minus) * divisor / scale; 0 S is a place that is left open",
        "wiring": vector.wiring,
        "content": vector.content,
        "folded": int(folded),
        "lowest_S": lowest,
        "highest_S": float(highest),
        "decades": decades,
        "levels": levels,
        "devices": sum(g != 0 for siemens in pairs.values() for g in siemens),
        "scales_S": {node: str(scale) for node, scale in bar.scales.items()},
        "columns": dict(bar.columns),
        "divisors": {name: [str(by) for by in given] for name, given in bar.divisors.items()},
        "weight_error": weight_error(weights_in(network), found),
        "control_error": 0.0
        if not levels
        else control_error(network, with_weights(network, found), vector),
    }
    return {
        TABLE: _table(pairs),
        NOTES: (json.dumps(notes, indent=1) + "\n").encode(),
        **files,
    }


@checked
def weights_of(files: Mapping[str, bytes]) -> dict[str, np.ndarray]:
    """Compute the weights of exported conductances (exact inverse of the export).

    Parameters
    ----------
    files : mapping of str to bytes
        Files returned by `conductances_files`.

    Returns
    -------
    dict of str to (N,) array
        Weights by connection name.

    Raises
    ------
    FileFormatError
        If the files are not those of `conductances_files`.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> files = conductances_files(network, reference_vector(network), levels=256)
    >>> exact = {c.name: c.weight for c in network.cell.connections}
    >>> all(abs(w / exact[name] - 1).max() < 0.1 for name, w in weights_of(files).items())
    True
    """
    notes = notes_of(files, NOTES, FORMAT, SCHEMA)
    bar, pairs = _bar_of(notes), _pairs_of(files)
    if pairs.keys() != bar.columns.keys():
        raise FileFormatError(f"{TABLE}: its connections are not those of {NOTES}")
    with localcontext(EXACT):
        for name, siemens in pairs.items():
            if len(siemens) != len(bar.divisors[name]):
                raise FileFormatError(f"{TABLE}: {name}: a stage is missing, or there are too many")
        return {name: bar.weights(name, siemens) for name, siemens in pairs.items()}


@checked
def conductances_check(files: Mapping[str, bytes]) -> str:
    """Compute the weights of exported conductances and the steps of the network that has them.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing or invalid, the
    weights have another error than the notes, or all weights are those of the network and it takes
    different steps.
    """
    network, vector = network_and_vector(files)
    weights, own = weights_of(files), weights_in(network)
    if weights.keys() != own.keys() or any(len(w) != network.stages for w in weights.values()):
        raise FileFormatError(f"{TABLE}: its connections are not those of the network beside it")
    error, changed = weight_error(own, weights), with_weights(network, weights)
    known = stated_errors(notes_of(files, NOTES, FORMAT, SCHEMA), "weight_error", error)
    if error:
        return f"weights within {error:.1e} of the network's; the network of them {known}"
    walk = EulerWalk(changed, vector.step)
    worst = vector.check(lambda x, count: changed.unpack(walk.after(changed.pack(x), count)))
    early = max(vector.early)
    return f"all weights come back to the last bit; {early} steps within {worst:.0e} of the vector"


def _table(pairs: Mapping[str, list[Decimal]]) -> bytes:
    rows = (
        [name, stage, *(f"{max(part, Decimal(0)).normalize():E}" for part in (g, -g))]
        for name, siemens in pairs.items()
        for stage, g in enumerate(siemens)
    )
    return csv_text(COLUMNS, rows).encode()


# ---- reading ---------------------------------------------------------------------------------


def _bar_of(notes: Table) -> Crossbar:
    columns, scales = notes.get("columns", dict), notes.get("scales_S", dict)
    divisors = notes.get("divisors", dict)
    if columns.keys() != divisors.keys() or not {*map(str, columns.values())} <= scales.keys():
        raise FileFormatError(f"{NOTES}: columns, scales and divisors are not of one network")
    if not all(isinstance(given, list) for given in divisors.values()):
        raise FileFormatError(f"{NOTES}.divisors: expected lists")
    return Crossbar(
        scales={node: _positive("scales_S", text) for node, text in scales.items()},
        divisors={n: tuple(_positive("divisors", t) for t in g) for n, g in divisors.items()},
        columns={name: str(node) for name, node in columns.items()},
    )


def _positive(place: str, text: object) -> Decimal:
    number = _decimal(text)
    if not number > 0:
        raise FileFormatError(f"{NOTES}.{place}: expected a positive number, got {text!r:.40}")
    return number


def _decimal(text: object) -> Decimal:
    """Parse a finite decimal number within the range of a float64."""
    try:
        number = Decimal(text if isinstance(text, str) and len(text) < 60 else "nan")
    except DecimalException:
        number = Decimal("nan")
    if not number.is_finite() or not -400 < number.adjusted() < 400:
        raise FileFormatError(f"expected a finite number, got {text!r:.40}")
    return number


def _pairs_of(files: Mapping[str, bytes]) -> dict[str, list[Decimal]]:
    """Return the signed conductances by connection, in the order of stages."""
    pairs: dict[str, list[Decimal]] = {}
    for name, rows in rows_by_connection(files, TABLE, COLUMNS).items():
        both = [(_decimal(plus), _decimal(minus)) for plus, minus in rows]
        if any(min(pair) < 0 for pair in both):
            raise FileFormatError(f"{TABLE}: {name}: a conductance is negative")
        pairs[name] = [plus - minus for plus, minus in both]
    return pairs
