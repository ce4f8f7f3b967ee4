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

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Context, Decimal, DecimalException, localcontext

import numpy as np

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.devices.connection_weights import (
    check_connections,
    control_error,
    stated_errors,
    table_and_notes,
    time_constants,
    weight_error,
    weights_in,
    with_weights,
)
from ann_dc.export.reference.contents import rows_by_connection
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
EXACT = Context(prec=34)
"""Decimal context of conductances."""
INTEGRATORS = "integrators"
"""Name of the common scale of all integrators if time constants are folded in."""


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
        highest = _exact(lowest) * Decimal(10) ** _exact(decades)
        bar = _crossbar_of(network, highest, decades, folded)
        pairs = {name: bar.siemens(name, w) for name, w in weights_in(network).items()}
        if levels:
            pairs = {n: [_nearest(g, lowest, highest, levels) for g in p] for n, p in pairs.items()}
        found = {name: bar.weights(name, siemens) for name, siemens in pairs.items()}
    notes = {
        "format": FORMAT,
        "schema": SCHEMA,
        "rule": "weight = (g_plus - g_minus) * divisor / scale; 0 S is an open place",
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
    cells = {
        name: [[f"{max(part, Decimal(0)).normalize():E}" for part in (g, -g)] for g in siemens]
        for name, siemens in pairs.items()
    }
    return {**table_and_notes((TABLE, NOTES), COLUMNS, cells, notes), **files}


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
                raise FileFormatError(f"{TABLE}: {name}: expected one entry per stage")
        return {name: bar.weights(name, siemens) for name, siemens in pairs.items()}


@checked
def conductances_check(files: Mapping[str, bytes]) -> str:
    """Compare the weights of exported conductances with those of the network file and the notes.

    If all weights are equal, the network must also take the steps of the test vector.
    """
    network, vector = network_and_vector(files)
    weights = weights_of(files)
    check_connections(TABLE, weights, network)
    error, changed = weight_error(weights_in(network), weights), with_weights(network, weights)
    known = stated_errors(notes_of(files, NOTES, FORMAT, SCHEMA), "weight_error", error)
    if error:
        return f"weights within {error:.1e} of the network's; the network of them {known}"
    walk = EulerWalk(changed, vector.step)
    worst = vector.check(lambda x, count: changed.unpack(walk.after(changed.pack(x), count)))
    early = max(vector.early)
    return f"all weights are equal to the last bit; {early} steps within {worst:.0e} of the vector"


# ---- scales --------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class _Crossbar:
    """Map between weights and conductances: a scale k in siemens per summing node.

    Connections have a summing node, their column, and divisors of the weights: 1 or tau. Decimal
    numbers have twice the digits of a float64, so that the division after a multiplication recovers
    the last bit.
    """

    scales: Mapping[str, Decimal]
    divisors: Mapping[str, tuple[Decimal, ...]]
    columns: Mapping[str, str]

    def siemens(self, name: str, weights: np.ndarray) -> list[Decimal]:
        """Return the signed conductances of a connection's weights (N,)."""
        scale, divisors = self.scales[self.columns[name]], self.divisors[name]
        return [_exact(w) * scale / by for w, by in zip(weights.tolist(), divisors)]

    def weights(self, name: str, siemens: list[Decimal]) -> np.ndarray:
        """Return the weights (N,) of a connection's conductances (inverse of `siemens`)."""
        scale, divisors = self.scales[self.columns[name]], self.divisors[name]
        return np.array([float(g * by / scale) for g, by in zip(siemens, divisors)])


def _crossbar_of(network: Network, highest: Decimal, decades: float, folded: bool) -> _Crossbar:
    """Compute scales that map the largest weight of a node to the highest conductance (siemens).

    Raises `ExportError` if the weights of a node span more decades than given.
    """
    weights, tau = weights_in(network), time_constants(network)
    columns, divisors = {}, {}
    sizes: dict[str, list[tuple[Decimal, str]]] = defaultdict(list)
    for c in network.cell.connections:
        with_tau = folded and c.target in tau
        columns[c.name] = INTEGRATORS if with_tau else c.target
        by = [_exact(t) if with_tau else Decimal(1) for t in tau.get(c.target, weights[c.name])]
        divisors[c.name] = tuple(by)
        given = zip(weights[c.name].tolist(), by)
        sizes[columns[c.name]] += [(abs(_exact(w)) / t, c.name) for w, t in given if w]
    scales = {}
    for node in dict.fromkeys(columns.values()):
        there = sizes[node] or [(Decimal(1), "")]
        (largest, most), (least, few) = max(there), min(there)
        scales[node] = highest / largest
        needed = float((largest / least).log10())
        if needed > decades * (1 + 1e-12):
            hint = "use folded=False, or " if node == INTEGRATORS else ""
            raise ExportError(
                f"{network.title}: the weights at {node}, from {few} to {most}, span "
                f"{needed:.2f} decades, conductances {decades:g}; {hint}give "
                f"decades={np.ceil(10 * needed) / 10:g} or more, or scale the problem to reduce "
                "the span of its weights"
            )
    return _Crossbar(scales=scales, divisors=divisors, columns=columns)


def _nearest(g: Decimal, lowest: float, highest: Decimal, levels: int) -> Decimal:
    """Return the nearest of equally spaced conductances, with the sign; 0 S remains open."""
    if g == 0:
        return g
    first = _exact(lowest)
    step = (highest - first) / (levels - 1)
    return (first + step * ((abs(g) - first) / step).to_integral_value()).copy_sign(g)


def _exact(number: float) -> Decimal:
    """Return the shortest decimal number that parses to the float64."""
    return Decimal(repr(float(number)))


# ---- reading ---------------------------------------------------------------------------------


def _bar_of(notes: Table) -> _Crossbar:
    columns, scales = notes.get("columns", dict), notes.get("scales_S", dict)
    divisors = notes.get("divisors", dict)
    if columns.keys() != divisors.keys() or not {*map(str, columns.values())} <= scales.keys():
        raise FileFormatError(f"{NOTES}: columns, scales and divisors belong to different networks")
    if not all(isinstance(given, list) for given in divisors.values()):
        raise FileFormatError(f"{NOTES}.divisors: expected lists")
    return _Crossbar(
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
