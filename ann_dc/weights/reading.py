"""Strict conversion of a manifest and arrays to a network, the inverse of `writing`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.network.cell import (
    Cell,
    Connection,
    Function,
    Limiter,
    Neuron,
    Product,
    Role,
    Sum,
    Template,
)
from ann_dc.network.duals import InequalityDual, ObjectiveDual, PIDual
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner, PreconditionerKind
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.stiffness import Stiffness
from ann_dc.network.waveforms import HOLDS, Waveform
from ann_dc.scale import Scale
from ann_dc.weights.entries import Entries
from ann_dc.weights.hashes import check_hashes
from ann_dc.weights.manifest import Table, read_manifest, weight_names
from ann_dc.weights.writing import STIFFNESSES

MAX_MANIFEST = 2_000_000
"""Largest manifest size in bytes."""
MAX_STAGES = 1_000_000
"""Largest number of stages in a file."""

KEYS = (
    "format schema title about stages neurons inputs blocks connections duals inequality_duals "
    "objectives chains fixed omitted left_boundary start preconditioner shifted ranged "
    "waveforms tensors hashes"
)
BLOCKS = {kind.__name__.lower(): kind for kind in (Sum, Product, Function)}
TEMPLATES = {template.name.lower(): template for template in Template}
ROLES = {role.value: role for role in Role}


def network_of(manifest: str, entries: Entries) -> Network:
    """Return the network that a manifest and its entries describe.

    Raises `FileFormatError`, `NetworkError` or `UnknownNameError` if they do not describe a network
    or contain additional entries.
    """
    if len(manifest) > MAX_MANIFEST:
        raise FileFormatError(f"manifest: larger than {MAX_MANIFEST} bytes")
    table = read_manifest(manifest)
    table.only(KEYS)
    stages = table.whole("stages", 1, MAX_STAGES)
    cell = _cell(table, entries, stages)
    network = Network(
        cell=cell,
        stages=stages,
        inputs={name: entries.array(f"input/{name}", (stages,)) for name in cell.inputs},
        input_scales=_input_scales(entries, cell) if _is_shifted(table) else {},
        fixed=table.records("fixed", FixedNeuron),
        omitted=table.records("omitted", Omitted),
        left_boundary=table.texts("left_boundary"),
        start={name: entries.array(f"start/{name}", (stages,)) for name in table.names("start")},
        preconditioner=_preconditioner(table, entries, cell, stages),
        title=table.get("title", str),
        ranges=_ranges(table, entries, cell),
        waveforms=_waveforms(table, entries, cell, stages),
    )
    if isinstance(network.preconditioner, Stiffness):
        with np.errstate(over="ignore"):  # of rates, where a time constant is next to nothing
            network.preconditioner.check(network.layout)
    entries.finish()
    check_hashes(table, entries.taken)
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
        inequality_duals=table.records("inequality_duals", InequalityDual),
        objectives=table.records("objectives", ObjectiveDual),
        chains=tuple(_pair(chain) for chain in table.get("chains", list)),
    )


def _neurons(table: Table, entries: Entries, stages: int) -> tuple[Neuron, ...]:
    rows = list(table.rows("neurons"))
    for row in rows:
        row.only("name role shared")
    names = [row.get("name", str) for row in rows]
    limits = entries.array("limits", (len(rows), 2), limits=True)
    factors = entries.array("scale_factor", (len(rows),))
    offsets = np.zeros(len(rows))
    if _is_shifted(table):
        offsets = entries.array("scale_offset", (len(rows),))
    return tuple(
        Neuron(
            name=name,
            role=row.choice("role", ROLES),
            tau=entries.one_or_each(f"tau/{name}", stages),
            limiter=Limiter(low=float(low), high=float(high)),
            scale=Scale(float(factor), float(offset)),
            shared=row.has("shared") and bool(row.whole("shared", 1, 1)),
        )
        for row, name, (low, high), factor, offset in zip(rows, names, limits, factors, offsets)
    )


def _is_shifted(table: Table) -> bool:
    """Return True if neurons have offsets and inputs have scales."""
    return table.has("shifted") and bool(table.whole("shifted", 1, 1))


def _input_scales(entries: Entries, cell: Cell) -> dict[str, Scale]:
    rows = entries.array("input_scale", (len(cell.inputs), 2))
    return {name: Scale(*map(float, row)) for name, row in zip(cell.inputs, rows)}


def _ranges(table: Table, entries: Entries, cell: Cell) -> dict[str, tuple[float, float]]:
    """Return the input ranges of the design; empty if it was made for one problem."""
    if not (table.has("ranged") and table.whole("ranged", 1, 1)):
        return {}
    rows = entries.array("range", (len(cell.inputs), 2), limits=True)
    ranges = {name: (float(low), float(high)) for name, (low, high) in zip(cell.inputs, rows)}
    return {name: ends for name, ends in ranges.items() if np.isfinite(ends).any()}


def _waveforms(table: Table, entries: Entries, cell: Cell, stages: int) -> dict[str, Waveform]:
    """Return the inputs over time; empty if all are constant."""
    if not table.has("waveforms"):
        return {}
    found = {}
    for name, hold in table.texts("waveforms").items():
        if name not in cell.inputs or hold not in HOLDS:
            raise FileFormatError(
                f"manifest.waveforms: expected inputs, each with one of {', '.join(HOLDS)}, got "
                f"{name!r}: {hold!r}"
            )
        times = entries.array(f"times/{name}", (None,))
        values = entries.array(f"values/{name}", (len(times),), (len(times), stages))
        found[name] = Waveform(times=times, values=values, hold=HOLDS[hold])
    return found


def _connections(table: Table, entries: Entries, stages: int) -> tuple[Connection, ...]:
    wires = []
    for row in table.rows("connections"):
        row.only("source target template")
        source, target = row.get("source", str), row.get("target", str)
        is_far = type(row.given.get("template")) is int
        template = _far(row) if is_far else row.choice("template", TEMPLATES)
        wires.append(Connection(source=source, target=target, template=template))
    return tuple(
        replace(wire, weight=entries.one_or_each(name, stages))
        for wire, name in zip(wires, weight_names(wires))
    )


def _far(row: Table) -> int:
    """Return the stage distance to a source beyond the neighbouring cells, which have names."""
    template = row.whole("template", -MAX_STAGES, MAX_STAGES)
    if abs(template) <= 1:
        raise FileFormatError(f"{row.place}.template: expected a name, got {template}")
    return template


def _pair(chain) -> tuple[str, str]:
    if not isinstance(chain, list) or len(chain) != 2 or not all(isinstance(c, str) for c in chain):
        raise FileFormatError(f"manifest.chains: expected two neuron names, got {chain!r}")
    return chain[0], chain[1]


def _preconditioner(table: Table, entries: Entries, cell: Cell, stages: int) -> Preconditioner:
    given = table.inner("preconditioner")
    given.only("kind levels")
    kind = given.choice("kind", {kind.value: kind for kind in PreconditionerKind})
    is_coarse = kind in (PreconditionerKind.MULTILEVEL, PreconditionerKind.COUPLED_MULTILEVEL)
    levels, chains = given.whole("levels", 0, 64 if is_coarse else 0), len(cell.chains)
    if kind in STIFFNESSES:
        m = sum(neuron.role is Role.PRIMAL for neuron in cell.neurons)
        found: Preconditioner = STIFFNESSES[kind](
            own=entries.array("stiffness/own", (stages, m, m)),
            following=entries.array("stiffness/following", (stages - 1, m, m)),
        )
    else:
        shape = (None, chains, chains)
        gains = tuple(entries.array(f"gain/{level}", shape) for level in range(levels))
        found = Multilevel(gains=gains) if gains else Diagonal()
    if found.kind is not kind:
        raise FileFormatError(
            f"{given.place}.kind: {kind.value!r}, but the data are those of a {found.kind.value}"
        )
    return found
