r"""Capacitor ratios for switched-capacitor chips, in units of one capacitor.

In every clock period, of network time h, a branch with m units transfers the charge of its source
to an op amp with M feedback units:

.. math::
    x_{k+1} = x_k + \sum \frac{m}{M}\, s, \quad \frac{m}{M} \approx \frac{h\, w}{\tau},
    \qquad y = \sum \frac{m}{M}\, s, \quad \frac{m}{M} \approx w,

at a neuron and at a sum. All branches of an op amp have the same M: the value within the largest
capacitor whose worst ratio error is smallest. A branch with negative m samples its source in the
opposite clock phase.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

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
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.validation import NotNegative, PositiveFinite, checked

FORMAT = "ann_dc capacitors"
SCHEMA = 1
TABLE, NOTES = "capacitors.csv", "capacitors.json"
COLUMNS = ("connection", "stage", "units", "feedback_units", "farads", "feedback_farads")
MOST_UNITS = 4096
SAME = 1e-12
"""Ratio errors closer than this are treated as equal, and the smaller M is used."""


@checked
def capacitors_files(
    network: Network,
    vector: ReferenceVector,
    *,
    unit: PositiveFinite = 100e-15,
    largest: PositiveFinite = 25.6e-12,
    step: NotNegative = 0.0,
) -> dict[str, bytes]:
    """Export the weights of a network as capacitor ratios, with the rounding errors.

    The CSV table has one row per branch. The JSON notes contain the step, the errors and the
    saturation limits.

    Parameters
    ----------
    network : Network
        Network with a diagonal preconditioner.
    vector : ReferenceVector
        Test vector of the network.
    unit : float
        Unit capacitor in farads. Default 100 fF.
    largest : float
        Largest capacitor in farads, at most 4096 units. Default 25.6 pF.
    step : float
        Network time of one clock period. The default 0 uses the step of the vector.

    Returns
    -------
    dict of str to bytes
        File contents by file name.

    Raises
    ------
    ExportError
        If the network has another preconditioner, a node needs larger capacitors, or the vector
        belongs to another network.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> files = capacitors_files(network, reference_vector(network))
    >>> print(files["capacitors.csv"].decode().splitlines()[0])
    connection,stage,units,feedback_units,farads,feedback_farads
    """
    if network.preconditioner.kind is not PreconditionerKind.DIAGONAL:
        raise ExportError(
            f"{network.title}: its preconditioner is a {network.preconditioner.kind.value}, "
            "switched capacitors need a diagonal one; design with "
            "preconditioner=PreconditionerKind.DIAGONAL, or use dataclasses.replace(network, "
            "preconditioner=Diagonal())"
        )
    if not 1 <= largest / unit * (1 + SAME) < MOST_UNITS + 1:
        raise ExportError(
            f"largest: expected 1 to {MOST_UNITS} units of {unit:g} F, got {largest:g} F"
        )
    files = beside(network, vector)
    period = step or vector.step
    units = _units(network, period, int(largest / unit * (1 + SAME)), unit)
    found = _weights(network, units, period)
    notes = {
        "format": FORMAT,
        "schema": SCHEMA,
        "rule": (
            "neuron: x[k+1] = x[k] + sum(units / feedback_units * source); "
            "sum: y = sum(units / feedback_units * source)"
        ),
        "wiring": vector.wiring,
        "content": vector.content,
        "unit_F": unit,
        "largest_F": largest,
        "largest_units": int(max(np.abs(pair).max() for pair in units.values())),
        "units": int(sum(np.abs(pair[:, 0]).sum() for pair in units.values())),
        "step": period,
        "rails": _limits(network),
        "ratio_error": weight_error(weights_in(network), found),
        "control_error": control_error(network, with_weights(network, found), vector, period),
    }
    cells = {
        name: [[*pair, *(_farads(u, unit) for u in pair)] for pair in pairs.tolist()]
        for name, pairs in units.items()
    }
    return {**table_and_notes((TABLE, NOTES), COLUMNS, cells, notes), **files}


@checked
def units_of(files: Mapping[str, bytes]) -> dict[str, np.ndarray]:
    """Read the signed branch units and the feedback units (N, 2) of every connection, by name.

    Raises `FileFormatError` if the files are not those of `capacitors_files`.
    """
    unit = notes_of(files, NOTES, FORMAT, SCHEMA).get("unit_F", float)
    found: dict[str, list[tuple[int, int]]] = {}
    for name, rows in rows_by_connection(files, TABLE, COLUMNS).items():
        found[name] = [(_whole(own), _whole(across)) for own, across, _, _ in rows]
        for stage, (pair, row) in enumerate(zip(found[name], rows)):
            if pair[1] < 1 or row[2:] != [_farads(u, unit) for u in pair]:
                raise FileFormatError(f"{TABLE}: {name}[{stage}]: units and farads do not agree")
    return {name: np.array(pairs, np.int64) for name, pairs in found.items()}


@checked
def capacitors_check(files: Mapping[str, bytes]) -> str:
    """Compare the weights of exported capacitors with those of the network file and the notes."""
    network, _ = network_and_vector(files)
    notes, units = notes_of(files, NOTES, FORMAT, SCHEMA), units_of(files)
    check_connections(TABLE, units, network)
    found = _weights(network, units, notes.get("step", float))
    error = weight_error(weights_in(network), found)
    known = stated_errors(notes, "ratio_error", error)
    return f"ratios within {error:.1e} of the network's; the network of them {known}"


# ---- units -----------------------------------------------------------------------------------


def _op_amps(
    network: Network, step: float
) -> Iterator[tuple[str, list[str], np.ndarray, np.ndarray]]:
    """Yield node, connections (c,), stages (s,) and ratios (c, s) of op amps with equal branches.

    A shared neuron has one op amp for all stages, another node one per stage.
    """
    weights, tau = weights_in(network), time_constants(network)
    shared = {network.cell.neurons[row].name for row in network.shared}
    for node in dict.fromkeys(c.target for c in network.cell.connections):
        names = [c.name for c in network.cell.connections if c.target == node]
        rates = step / tau[node] if node in tau else np.ones(network.stages)
        ratios = np.array([weights[name] * rates for name in names])
        if node in shared:
            yield node, names, np.arange(network.stages), ratios
            continue
        kinds, which = np.unique(ratios, axis=1, return_inverse=True)
        for kind in range(kinds.shape[1]):
            yield node, names, np.flatnonzero(which == kind), kinds[:, [kind]]


def _units(network: Network, step: float, most: int, unit: float) -> dict[str, np.ndarray]:
    """Return the branch and feedback units (N, 2) of every connection."""
    units = {c.name: np.zeros((network.stages, 2), np.int64) for c in network.cell.connections}
    for node, names, stages, ratios in _op_amps(network, step):
        across = _nearest(f"{node}[{stages[0]}]", ratios, most, unit)
        own = np.rint(ratios * across).astype(np.int64)
        for name, row in zip(names, own):
            units[name][stages, 0], units[name][stages, 1] = row, across
    return units


def _nearest(place: str, ratios: np.ndarray, most: int, unit: float) -> int:
    """Return the smallest M with the smallest worst error of the ratios at a place."""
    sizes = np.unique(np.abs(ratios[ratios != 0]))
    if not len(sizes):
        return 1
    across = np.arange(1, most + 1)
    own = np.rint(sizes[:, None] * across)
    fits = (own >= 1).all(axis=0) & (own <= most).all(axis=0)
    if not fits.any():
        least, top = sizes[0], sizes[-1]
        needed = np.ceil(0.5 / least) * max(top, 1.0)
        raise ExportError(
            f"{place}: ratios from {least:.3g} to {top:.3g} need capacitors of {needed:.0f} "
            f"units at least, {most} are allowed; raise largest to {needed * unit:.3g} F or "
            "more, or use a smaller unit"
        )
    worst = np.abs(own / across / sizes[:, None] - 1).max(axis=0)
    worst[~fits] = np.inf
    return int(across[np.argmax(worst <= worst.min() + SAME)])


def _weights(network: Network, units: Mapping[str, np.ndarray], step: float) -> dict:
    """Return the weights (N,) of the discrete-time network with these ratios."""
    tau, found = time_constants(network), {}
    for c in network.cell.connections:
        own, across = units[c.name].T
        found[c.name] = own / across * (tau[c.target] / step if c.target in tau else 1.0)
    return found


def _limits(network: Network) -> dict[str, list[float | None]]:
    """Return (low, high) of the neurons with saturation limits; None for no limit."""
    ends = {n.name: (n.limiter.low, n.limiter.high) for n in network.cell.neurons}
    return {
        name: [float(end) if np.isfinite(end) else None for end in pair]
        for name, pair in ends.items()
        if np.isfinite(pair).any()
    }


def _farads(units: int, unit: float) -> str:
    return f"{abs(units) * unit:.6g}"


def _whole(text: str) -> int:
    plain = text.removeprefix("-")
    if not (plain.isascii() and plain.isdigit() and len(plain) < 10):
        raise FileFormatError(f"{TABLE}: expected a whole number of units, got {text!r:.20}")
    return int(text)
