"""A network as a manifest and arrays, as `reading` takes them back."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.export.weights.manifest import FORMAT, SCHEMA, weight_names
from ann_dc.network.cell import Connection, Template
from ann_dc.network.metrics.pyramid import Pyramid
from ann_dc.network.network import Network


def manifest_of(network: Network) -> dict:
    """Names and wiring of a ``network`` as a JSON table, without numbers."""
    cell, gains = network.cell, _gains(network)
    return {
        "format": FORMAT,
        "schema": SCHEMA,
        "title": network.title,
        "stages": network.stages,
        "neurons": [{"name": n.name, "role": n.role.value} for n in cell.neurons],
        "inputs": list(cell.inputs),
        "blocks": [{"kind": type(b).__name__.lower(), **asdict(b)} for b in cell.blocks],
        "connections": [
            {"source": c.source, "target": c.target, "template": _template(c)}
            for c in cell.connections
        ],
        "duals": [asdict(dual) for dual in cell.duals],
        "chains": [list(chain) for chain in cell.chains],
        "pins": [asdict(pin) for pin in network.pins],
        "absent": [asdict(absent) for absent in network.absent],
        "left": dict(sorted(network.left.items())),
        "start": sorted(network.start),
        "levels": len(gains),
    }


def arrays_of(network: Network) -> dict[str, object]:
    """Every number of a ``network``, in arrays by the name of its entry."""
    cell, gains = network.cell, _gains(network)
    arrays: dict[str, object] = {
        "rails": [(n.limiter.low, n.limiter.high) for n in cell.neurons],
        "unit": [n.unit for n in cell.neurons],
    }
    arrays |= {f"tau/{n.name}": _one_or_each(n.tau, network) for n in cell.neurons}
    for name, connection in zip(weight_names(cell.connections), cell.connections):
        arrays[name] = _one_or_each(connection.weight, network)
    arrays |= {f"input/{name}": network.inputs[name] for name in cell.inputs}
    arrays |= {f"start/{name}": network.start[name] for name in sorted(network.start)}
    return arrays | {f"gain/{level}": gain for level, gain in enumerate(gains)}


def _template(connection: Connection) -> str:
    if abs(connection.template) > 1:
        raise NetworkError(
            f"{connection.name}: weight files have wires between neighbours only; save the network "
            "that was designed, not the emulation of its circuit"
        )
    return Template(connection.template).name.lower()


def _gains(network: Network) -> tuple[np.ndarray, ...]:
    """Of the levels of a pyramid."""
    return network.metric.gains if isinstance(network.metric, Pyramid) else ()


def _one_or_each(value, network: Network) -> np.ndarray:
    """One number, or one a stage."""
    return np.asarray(value) if np.ndim(value) == 0 else np.broadcast_to(value, network.stages)
