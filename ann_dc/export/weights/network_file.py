"""A network as a file: every number in a named array, every name in a manifest.

The file is an ``.npz`` (read it with ``numpy.load(path, allow_pickle=False)``). Its entries:

=====================  ==========================================================
``manifest``           uint8, the UTF-8 text of a JSON table: names and wiring, no numbers
``tau/mu.x``           () or (N,) time constant of a neuron
``weight/m.x<-c.x``    () or (N,) weight of a connection, by its name
``input/q_d.x``        (N,) value of an input
``start/q.x``          (N,) initial states
``rails``, ``unit``    (P, 2) limiters and (P,) units of the P neurons
``gain/0``             (points, C, C) coordinators of a level, finest first
=====================  ==========================================================

Equal networks give equal bytes, and nothing in a file is ever executed.
"""

from __future__ import annotations

import io
import json
import operator
import os
import zipfile
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ann_dc.errors import FileFormatError, NetworkError, UnknownNameError
from ann_dc.export.weights.manifest import FORMAT, SCHEMA, Table, read_manifest
from ann_dc.export.weights.npz import BROKEN, Entries, write_entries
from ann_dc.network.cell import (
    Cell,
    Connection,
    Function,
    Limiter,
    Neuron,
    PIDual,
    Product,
    Role,
    Sum,
    Template,
)
from ann_dc.network.coordinators import Coordinators
from ann_dc.network.ends import Absent, Pin
from ann_dc.network.network import Network
from ann_dc.whole_files import read_whole

MAX_BYTES = 2_000_000_000
"""Largest file in bytes; a row of `MAX_STAGES` stays far below it."""
MAX_MANIFEST = 10_000_000
"""Largest manifest in bytes."""
MAX_STAGES = 1_000_000
"""Longest row that a file may ask for."""

KEYS = (
    "format schema title stages neurons inputs blocks connections duals chains pins absent left "
    "start levels"
)
BLOCKS = {kind.__name__.lower(): kind for kind in (Sum, Product, Function)}
TEMPLATES = {template.name.lower(): template for template in Template}
ROLES = {role.value: role for role in Role}


def save(network: Network, path: str | os.PathLike[str]) -> None:
    """Write a network to one ``.npz`` file.

    Parameters
    ----------
    network : Network
    path : path-like
        The file; one that exists is replaced once the new one is complete.

    Raises
    ------
    OutputError
        If the file cannot be written there; what was there before stays.

    Examples
    --------
    >>> import tempfile
    >>> chain = Network(stages=3, cell=Cell(
    ...     neurons=(Neuron(name="x"),),
    ...     connections=(Connection(source="x", target="x", weight=-0.1),)))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(chain, f"{folder}/chain.npz")
    ...     evaluator(load(f"{folder}/chain.npz")).rhs([1, 2, 3]).tolist()
    [-0.1, -0.2, -0.30000000000000004]
    """
    manifest = json.dumps(_manifest(network), indent=1, default=operator.index)
    write_entries(Path(path), {"manifest": manifest}, _arrays(network))


def load(path: str | os.PathLike[str]) -> Network:
    """Read a network that `save` wrote; it runs exactly as the saved one.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Network

    Raises
    ------
    FileFormatError
        If the file is not one that `save` wrote; the message names the file and the entry.
    """
    file = Path(path)
    content = read_whole(file, MAX_BYTES, "give the path of a saved network (.npz)")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return _network(Entries(archive, len(content)))
    except (FileFormatError, NetworkError, UnknownNameError) as error:
        raise FileFormatError(f"{file}: {error}") from error
    except BROKEN as error:
        raise FileFormatError(
            f"{file}: not a complete .npz file ({error}); save the network again"
        ) from error


# ---- writing -----------------------------------------------------------------------------------


def _manifest(network: Network) -> dict:
    cell, coordinators = network.cell, network.coordinators
    return {
        "format": FORMAT,
        "schema": SCHEMA,
        "title": network.title,
        "stages": network.stages,
        "neurons": [{"name": n.name, "role": n.role.value} for n in cell.neurons],
        "inputs": list(cell.inputs),
        "blocks": [{"kind": type(b).__name__.lower(), **asdict(b)} for b in cell.blocks],
        "connections": [
            {"source": c.source, "target": c.target, "template": c.template.name.lower()}
            for c in cell.connections
        ],
        "duals": [asdict(dual) for dual in cell.duals],
        "chains": [list(chain) for chain in cell.chains],
        "pins": [asdict(pin) for pin in network.pins],
        "absent": [asdict(absent) for absent in network.absent],
        "left": dict(sorted(network.left.items())),
        "start": sorted(network.start),
        "levels": 0 if coordinators is None else len(coordinators.gains),
    }


def _arrays(network: Network) -> dict[str, object]:
    cell, coordinators = network.cell, network.coordinators
    arrays: dict[str, object] = {
        "rails": [(n.limiter.low, n.limiter.high) for n in cell.neurons],
        "unit": [n.unit for n in cell.neurons],
    }
    arrays |= {f"tau/{n.name}": _one_or_each(n.tau, network) for n in cell.neurons}
    for name, connection in zip(_weight_names(cell.connections), cell.connections):
        arrays[name] = _one_or_each(connection.weight, network)
    arrays |= {f"input/{name}": network.inputs[name] for name in cell.inputs}
    arrays |= {f"start/{name}": network.start[name] for name in sorted(network.start)}
    gains = () if coordinators is None else coordinators.gains
    return arrays | {f"gain/{level}": gain for level, gain in enumerate(gains)}


def _one_or_each(value, network: Network) -> np.ndarray:
    """One number, or one a stage."""
    return np.asarray(value) if np.ndim(value) == 0 else np.broadcast_to(value, network.stages)


def _weight_names(connections: Iterable[Connection]) -> list[str]:
    """Entries of the weights; a second wire between the same two nodes is numbered."""
    seen: Counter[str] = Counter()
    names = []
    for connection in connections:
        seen[connection.name] += 1
        count = seen[connection.name]
        names.append(f"weight/{connection.name}" + (f"#{count}" if count > 1 else ""))
    return names


# ---- reading -----------------------------------------------------------------------------------


def _network(entries: Entries) -> Network:
    table = read_manifest(entries.text("manifest", MAX_MANIFEST))
    table.only(KEYS)
    stages = table.whole("stages", 1, MAX_STAGES)
    cell = _cell(table, entries, stages)
    left = table.get("left", dict)
    network = Network(
        cell=cell,
        stages=stages,
        inputs={name: entries.array(f"input/{name}", (stages,)) for name in cell.inputs},
        pins=table.records("pins", Pin),
        absent=table.records("absent", Absent),
        left={target: Table("manifest.left", left).get(target, str) for target in left},
        start={name: entries.array(f"start/{name}", (stages,)) for name in table.names("start")},
        coordinators=_coordinators(table, entries, len(cell.chains)),
        title=table.get("title", str),
    )
    entries.finish()
    return network


def _cell(table: Table, entries: Entries, stages: int) -> Cell:
    return Cell(
        neurons=_neurons(table, entries, stages),
        inputs=table.names("inputs"),
        blocks=tuple(
            row.record(row.choice("kind", BLOCKS), "kind") for row in table.rows("blocks")
        ),
        connections=_connections(table, entries, stages),
        duals=table.records("duals", PIDual),
        chains=tuple(_pair(chain) for chain in table.get("chains", list)),
    )


def _neurons(table: Table, entries: Entries, stages: int) -> tuple[Neuron, ...]:
    rows = table.rows("neurons")
    for row in rows:
        row.only("name role")
    names = [row.get("name", str) for row in rows]
    rails = entries.array("rails", (len(rows), 2), rails=True)
    units = entries.array("unit", (len(rows),))
    return tuple(
        Neuron(
            name=name,
            role=row.choice("role", ROLES),
            tau=entries.one_or_each(f"tau/{name}", stages),
            limiter=Limiter(low=float(low), high=float(high)),
            unit=float(unit),
        )
        for row, name, (low, high), unit in zip(rows, names, rails, units)
    )


def _connections(table: Table, entries: Entries, stages: int) -> tuple[Connection, ...]:
    rows = table.rows("connections")
    wires = []
    for row in rows:
        row.only("source target template")
        source, target = row.get("source", str), row.get("target", str)
        template = row.choice("template", TEMPLATES)
        wires.append(Connection(source=source, target=target, template=template))
    weights = [entries.one_or_each(name, stages) for name in _weight_names(wires)]
    return tuple(
        Connection(source=w.source, target=w.target, template=w.template, weight=weight)
        for w, weight in zip(wires, weights)
    )


def _pair(chain) -> tuple[str, str]:
    if not isinstance(chain, list) or len(chain) != 2 or not all(isinstance(c, str) for c in chain):
        raise FileFormatError(f"manifest.chains: expected two neuron names, got {chain!r}")
    return chain[0], chain[1]


def _coordinators(table: Table, entries: Entries, chains: int) -> Coordinators | None:
    levels = table.whole("levels", 0, 64)
    shape = (None, chains, chains)
    gains = tuple(entries.array(f"gain/{level}", shape) for level in range(levels))
    return Coordinators(gains=gains) if gains else None
