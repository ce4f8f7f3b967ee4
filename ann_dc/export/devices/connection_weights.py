"""Tables of connection weights, which are all of a network that a device has, and their errors."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.errors import FileFormatError, NetworkError
from ann_dc.evaluation.rules import NEAR, size_of
from ann_dc.export.reference.contents import csv_text
from ann_dc.export.reference.vector import EulerWalk, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.weights.manifest import Table


def weights_in(network: Network) -> dict[str, np.ndarray]:
    """Return the weights (N,) of all connections, by name."""
    stages = network.stages
    return {
        c.name: np.array(np.broadcast_to(np.asarray(c.weight, float), stages))
        for c in network.cell.connections
    }


def with_weights(network: Network, weights: Mapping[str, np.ndarray]) -> Network:
    """Return the network with the given weights (N,) for all connections, by name."""
    wires = tuple(replace(c, weight=weights[c.name]) for c in network.cell.connections)
    return replace(network, cell=replace(network.cell, connections=wires))


def time_constants(network: Network) -> dict[str, np.ndarray]:
    """Return the divisors (N,) of the connections to every neuron; a shared neuron has only one."""
    stages = network.stages
    tau = {n.name: np.array(np.broadcast_to(n.tau, stages), float) for n in network.cell.neurons}
    for row in network.shared:
        name = network.cell.neurons[row].name
        tau[name][:] = tau[name][-1]
    return tau


def weight_error(before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray]) -> float:
    """Compute the largest relative error of weights; infinite if a zero has become nonzero."""
    worst = 0.0
    for name, exact in before.items():
        gap, size = np.abs(after[name] - exact), np.abs(exact)
        with np.errstate(divide="ignore", invalid="ignore"):
            worst = max(worst, float(np.where(gap == 0, 0.0, gap / size).max()))
    return worst


def control_error(
    network: Network, changed: Network, vector: ReferenceVector, step: float | None = None
) -> float | None:
    """Compute the control error of a changed network when both networks have settled.

    Returns the largest difference relative to the size of the controls (`size_of`), in the user's
    units; all neurons are compared if the network has no controls. The changed network settles from
    the vector's end with steps h of network time, those of the vector by default. Returns None if
    one of the networks does not settle.
    """
    start = network.pack(vector.end)
    steps, end, _ = EulerWalk(changed, step or vector.step).settled(start, vector.tolerance)
    if not vector.settles or steps < 0:
        return None
    try:
        exact, found = equilibrium(network, start), equilibrium(changed, end)
    except NetworkError:
        return None
    controls = network.of_population("u")
    rows = controls if controls.any() else slice(None)
    first, exact, found = (
        network.user_units(x)[rows] for x in (network.pack(vector.start), exact, found)
    )
    reach = max(np.abs(first).max(), np.abs(exact).max())
    return float(np.abs(found - exact).max() / size_of(exact, reach))


def table_and_notes(
    names: tuple[str, str],
    columns: Sequence[str],
    cells: Mapping[str, Sequence[Sequence[object]]],
    notes: Mapping[str, object],
) -> dict[str, bytes]:
    """Return the cells of every connection and stage as CSV, and the notes as JSON."""
    rows = ([name, stage, *row] for name, rows in cells.items() for stage, row in enumerate(rows))
    table, text = csv_text(columns, rows), json.dumps(notes, indent=1) + "\n"
    return {names[0]: table.encode(), names[1]: text.encode()}


def check_connections(place: str, table: Mapping[str, np.ndarray], network: Network) -> None:
    """Raise `FileFormatError` unless a table has the connections and stages of its network."""
    names = sorted(c.name for c in network.cell.connections)
    if sorted(table) != names or any(len(rows) != network.stages for rows in table.values()):
        raise FileFormatError(f"{place}: its connections differ from those of the network file")


def stated_errors(notes: Table, key: str, error: float) -> str:
    """Return the control error in the notes as a clause.

    Raises `FileFormatError` if the table has another weight error than its notes.

    Examples
    --------
    >>> notes = Table("notes.json", {"weight_error": 0.1, "control_error": 0.02})
    >>> stated_errors(notes, "weight_error", 0.1)
    'has controls 2.0e-02 off, NOT within 1%'
    """
    stated = notes.get(key, float)
    if not np.isclose(error, stated, rtol=1e-9, atol=0.0):
        raise FileFormatError(
            f"{notes.place}.{key}: {stated:.3g}, but the weights of the table are {error:.3g} off; "
            "export the network again"
        )
    if notes.given.get("control_error") is None:
        return "does not settle"
    off = notes.get("control_error", float)
    return f"has controls {off:.1e} off" + f", NOT within {NEAR:.0%}" * (off > NEAR)
