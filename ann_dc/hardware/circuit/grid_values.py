r"""Resistors of a grid: a network that settles at z with G z = D, node by node.

With S the units of the nodes, :math:`v_i = z_i V / S_i` volts, and any :math:`\kappa`, the
currents into node i add up to zero with a resistor of conductance

.. math:: g_{ij} = \kappa\, S_i |G_{ij}| S_j \quad\text{between two nodes}, \qquad
    g_i^{in} = \kappa\, S_i S_{D_i} \quad\text{from the integrator},

and what is left of :math:`\kappa S_i^2 G_{ii}` to ground. It is negative where the others are more
than that: then the resistance there has to be a negative one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.hardware.circuit.scaling import Scaling
from ann_dc.hardware.schematic.elements import GridNode, Wire
from ann_dc.hardware.schematic.metric_wiring import OWN


@dataclass(frozen=True, kw_only=True, eq=False)
class GridValues:
    """Ohms and siemens of a grid.

    Attributes
    ----------
    resistors : dict of part name to (wires, N) array
        In the order of the part's wires; one between two nodes stands with both.
    conductances : dict of part name to (N,) array
        All that comes together in a node.
    """

    resistors: dict[str, np.ndarray]
    conductances: dict[str, np.ndarray]


def values_of_grid(nodes: Sequence[GridNode], scaling: Scaling, smallest: float) -> GridValues:
    """Values of the nodes of a grid, empty without any.

    Parameters
    ----------
    nodes : sequence of GridNode
    scaling : Scaling
    smallest : float
        Smallest resistor, in ohms.

    Returns
    -------
    GridValues
    """
    units = scaling.unit
    totals, shares = {}, {}
    for node in nodes:
        own = next(wire for wire in node.wires if wire.source.startswith(OWN)).weight
        stiffness = np.divide(1.0, own, out=np.zeros(len(own)), where=own > 0)
        totals[node.name] = stiffness * units[node.name] ** 2
        gain = [np.abs(w.weight) * units[w.source] / units[node.name] for w in node.wires]
        shares[node.name] = totals[node.name] * np.array(gain)
    largest = max((float(share.max()) for share in shares.values()), default=1.0)
    per_share = 1.0 / (smallest * largest)
    with np.errstate(divide="ignore"):
        resistors = {name: 1.0 / (per_share * share) for name, share in shares.items()}
    return GridValues(
        resistors=resistors,
        conductances={name: per_share * total for name, total in totals.items()},
    )


def to_ground(conductance: np.ndarray, resistors: np.ndarray) -> np.ndarray:
    """Siemens (N,) that are missing at a node; negative where its resistors are too many.

    Parameters
    ----------
    conductance : (N,) array
        Of the node.
    resistors : (wires, N) array
    """
    return np.where(conductance > 0, conductance - (1.0 / resistors).sum(axis=0), 0.0)


def begins(part: GridNode, wire: Wire, order: Sequence[str]) -> bool:
    """Whether a resistor is listed with this part: each belongs to two nodes, but stands once.

    Parameters
    ----------
    part : GridNode
    wire : Wire
        Of the part.
    order : sequence of str
        Names of all parts.
    """
    if wire.source.startswith(OWN) or wire.offset:
        return wire.offset >= 0
    return order.index(part.name) < order.index(wire.source)
