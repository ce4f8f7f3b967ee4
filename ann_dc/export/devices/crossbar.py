"""Map between weights and conductances: one scale per summing node, in decimals.

Decimal numbers have twice the digits of a float64, so a multiplication followed by the division
recovers the last bit.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Context, Decimal

import numpy as np

from ann_dc.errors import ExportError
from ann_dc.export.devices.connection_weights import time_constants, weights_in
from ann_dc.network.network import Network

EXACT = Context(prec=34)
"""Decimal context of conductances."""
INTEGRATORS = "integrators"
"""Name of the common scale of all integrators if time constants are folded in."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossbar:
    """Map between weights and conductances.

    Attributes
    ----------
    scales : mapping of str to Decimal
        Scale k in siemens, by summing node.
    divisors : mapping of str to tuple of N Decimal
        Divisors of the weights, by connection: 1 or tau.
    columns : mapping of str to str
        Summing node, by connection.
    """

    scales: Mapping[str, Decimal]
    divisors: Mapping[str, tuple[Decimal, ...]]
    columns: Mapping[str, str]

    def siemens(self, name: str, weights: np.ndarray) -> list[Decimal]:
        """Return the signed conductances of a connection's weights (N,)."""
        scale, divisors = self.scales[self.columns[name]], self.divisors[name]
        return [exact(w) * scale / by for w, by in zip(weights.tolist(), divisors)]

    def weights(self, name: str, siemens: list[Decimal]) -> np.ndarray:
        """Return the weights (N,) of a connection's conductances (inverse of `siemens`)."""
        scale, divisors = self.scales[self.columns[name]], self.divisors[name]
        return np.array([float(g * by / scale) for g, by in zip(siemens, divisors)])


def crossbar_of(network: Network, highest: Decimal, decades: float, folded: bool) -> Crossbar:
    """Compute scales that map the largest weight of a node to the highest conductance.

    Argument ``highest`` is in siemens, ``decades`` is the range down to the lowest conductance, and
    ``folded`` folds the time constants in. Raises `ExportError` if the weights of a node do not
    fit.
    """
    weights, tau = weights_in(network), time_constants(network)
    columns, divisors = {}, {}
    sizes: dict[str, list[tuple[Decimal, str]]] = defaultdict(list)
    for c in network.cell.connections:
        with_tau = folded and c.target in tau
        columns[c.name] = INTEGRATORS if with_tau else c.target
        by = [exact(t) if with_tau else Decimal(1) for t in tau.get(c.target, weights[c.name])]
        divisors[c.name] = tuple(by)
        given = zip(weights[c.name].tolist(), by)
        sizes[columns[c.name]] += [(abs(exact(w)) / t, c.name) for w, t in given if w]
    scales = {}
    for node in dict.fromkeys(columns.values()):
        there = sizes[node] or [(Decimal(1), "")]
        (largest, most), (least, few) = max(there), min(there)
        scales[node] = highest / largest
        needed = float((largest / least).log10())
        if needed > decades * (1 + 1e-12):
            hint = "take folded=False, or " if node == INTEGRATORS else ""
            raise ExportError(
                f"{network.title}: the weights at {node}, from {few} to {most}, span {needed:.2f} "
                f"decades, conductances {decades:g}; {hint}give "
                f"decades={np.ceil(10 * needed) / 10:g} or more, or scale the problem so that its "
                "weights lie closer together"
            )
    return Crossbar(scales=scales, divisors=divisors, columns=columns)


def nearest(g: Decimal, lowest: float, highest: Decimal, levels: int) -> Decimal:
    """Return the nearest conductance of a device, with its sign, in siemens.

    An open position remains open. A device has ``levels`` values in equal steps from ``lowest`` to
    ``highest``.
    """
    if g == 0:
        return g
    first = exact(lowest)
    step = (highest - first) / (levels - 1)
    return (first + step * ((abs(g) - first) / step).to_integral_value()).copy_sign(g)


def exact(number: float) -> Decimal:
    """Return the shortest decimal number that parses to the float64."""
    return Decimal(repr(float(number)))
