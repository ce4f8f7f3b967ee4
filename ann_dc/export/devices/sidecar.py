"""Sidecar files of device tables: the network and its test vector.

A table contains only the weights. All other data of the network are read from the network file,
whose content must match the vector.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.errors import ArgumentError, ExportError, FileFormatError, NetworkError
from ann_dc.evaluation.rules import NEAR, size_of
from ann_dc.export.reference.sidecar import check_vector, file_of, text_of, vector_of
from ann_dc.export.reference.vector import VECTOR, EulerWalk, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash
from ann_dc.weights.manifest import read_json
from ann_dc.weights.network_file import packed, unpacked

NETWORK = "network.npz"


def beside(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    """Return the files of a network and its test vector.

    Raises `ExportError` if the vector belongs to another network.
    """
    check_vector(network, vector)
    return {NETWORK: packed(network), VECTOR: vector.as_json()}


def network_and_vector(files: Mapping[str, bytes]) -> tuple[Network, ReferenceVector]:
    """Read the network and the test vector written by `beside`.

    Raises `FileFormatError` if a file is missing or invalid, or if the two files do not belong
    together.
    """
    vector = vector_of(files)
    network = unpacked(file_of(files, NETWORK), Path(NETWORK))
    if content_hash(network) != vector.content:
        raise FileFormatError(
            f"{NETWORK}: its content is not that of {VECTOR}; one of them was changed: export the "
            "network again"
        )
    return network, vector


def check_rewritten(
    files: Mapping[str, bytes],
    table: str,
    notes: str,
    write: Callable[[], Mapping[str, bytes]],
) -> str:
    """Recreate a table and its notes from the network file and compare them.

    Returns the control error of the table's network as a clause. Raises `FileFormatError` if the
    settings are invalid, or with the name of the first line or entry that differs.

    Parameters
    ----------
    table, notes : str
        Names of the two files.
    write : callable
        Function without arguments that returns both files for the network, with the settings in the
        notes.
    """
    try:
        anew = write()
    except (ExportError, ArgumentError) as error:
        raise FileFormatError(f"{notes}: {error}") from error
    lines = zip_longest(text_of(files, table).splitlines(), text_of(anew, table).splitlines())
    for number, (found, wanted) in enumerate(lines, 1):
        if found != wanted:
            raise FileFormatError(
                f"{table}: line {number} is {found!r:.80}, the network beside it gives "
                f"{wanted!r:.80}; export it again"
            )
    stated, own = read_json(text_of(files, notes)), read_json(text_of(anew, notes))
    off, known = stated.pop("control_error", "missing"), own.pop("control_error")
    for entry in sorted(stated.keys() | own.keys()):
        if stated.get(entry) != own.get(entry):
            raise FileFormatError(f"{notes}.{entry}: not that of {table}; export it again")
    if off != known and not (type(off) is type(known) is float and np.isclose(off, known, 1e-3)):
        raise FileFormatError(
            f"{notes}.control_error: {off!r:.40}, but the controls are {known} off"
        )
    if known is None:
        return "does not settle"
    return f"has controls {known:.1e} off" + f", NOT within {NEAR:.0%}" * (known > NEAR)


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
    """Return the divisors (N,) of the connections to every neuron, by name.

    A neuron shared by all cells has a single divisor.
    """
    stages = network.stages
    tau = {n.name: np.array(np.broadcast_to(n.tau, stages), float) for n in network.cell.neurons}
    for row in network.shared:
        name = network.cell.neurons[row].name
        tau[name][:] = tau[name][-1]
    return tau


def weight_error(before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray]) -> float:
    """Compute the largest relative error of the weights (N,).

    The error is infinite if a zero weight has become nonzero.
    """
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
    units; all neurons are compared if the network has no controls. Returns None if one of the
    networks does not settle from the vector's end.

    Parameters
    ----------
    changed : Network
        Network with changed numbers.
    vector : ReferenceVector
        Test vector of the unchanged network.
    step : float, optional
        Step h of the iteration in which the changed network settles; the vector's step by default.
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
