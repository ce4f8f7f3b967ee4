r"""Amplitude and time scaling: volts per network value, seconds per network time.

Every node j of a cell gets a unit S_j, equal at all stages: x_j = S_j v_j / V with V the full scale
in volts. S_j is the largest magnitude of the node during the run times a headroom. A multiplier
computes v_a v_b / V, so the unit of a product is the product of the units. Network time s takes t =
T s seconds, with

.. math:: T = \frac{k\, \rho(J)}{2\pi\, GBW} ,

so that op amps of gain-bandwidth product GBW are k times as fast as the fastest mode of the
network. Both scalings are invertible, and results are in the user's units.

A resistive grid settles at z with G z = D, node by node. With S the units of the nodes, :math:`v_i
= z_i V / S_i` volts and any :math:`\kappa`, the currents into node i add up to zero with resistors
of conductance

.. math:: g_{ij} = \kappa\, S_i |G_{ij}| S_j \quad\text{between two nodes}, \qquad
    g_i^{in} = \kappa\, S_i S_{D_i} \quad\text{from the integrator},

and the remainder of :math:`\kappa S_i^2 G_{ii}` to ground. The remainder is negative if the other
conductances exceed this sum, and then requires a negative resistance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.drive import values_over_time
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.schematic.elements import Generator, GridNode, Wire, plain_sums
from ann_dc.hardware.schematic.preconditioner_wiring import (
    OWN,
    preconditioner_parts,
    preconditioner_values,
    wiring_of,
)
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.network.cell import ONE, Product
from ann_dc.network.functions import function_block
from ann_dc.network.network import Network
from ann_dc.scale import Scale
from ann_dc.validation import checked

HEADROOM = 1.2
"""Ratio of full scale to the largest magnitude of the probe run."""

QUIET = 0.1
"""Smallest unit of a separate integrator, over the input that moves its neuron by full scale."""

NOISE_GAIN = 4.0
"""Largest input of a preconditioner sum, over the unit of the sum."""

MARGIN = 10.0
"""Bandwidth margin k: ratio of op-amp bandwidth to the fastest mode of the network."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class ProbeRun:
    """Run that determines the ranges of all nodes and the fastest rate of a network.

    State vectors ``states`` (T, n) from the start to the settled point, network ``times`` (T,), and
    the spectral ``radius`` of the flow at the settled point. Raises `NetworkError` if the run is
    not finite or the radius not positive.
    """

    states: np.ndarray
    times: np.ndarray
    radius: float

    def __post_init__(self) -> None:
        _check_above(0.0, radius=self.radius)
        if not np.isfinite(self.states).all():
            raise NetworkError("scaling: the probe run is not finite; it has to settle")


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class ScalingRules:
    """Rules for a scaling.

    ``gbw`` is the gain-bandwidth product of the op amps in Hz, ``bandwidth_margin`` is k,
    ``full_scale`` V in volts, and ``headroom`` (at least 1) the ratio of full scale to the largest
    magnitude of the probe run. ``intervals`` are declared ranges of nodes in the user's units, for
    example ``{"u.nu": (-20, 20)}``; they replace the ranges of the probe run. Raises `NetworkError`
    if a number is out of its range.
    """

    gbw: float = 10e6
    bandwidth_margin: float = MARGIN
    full_scale: float = 1.0
    headroom: float = HEADROOM
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_above(
            0.0, gbw=self.gbw, bandwidth_margin=self.bandwidth_margin, full_scale=self.full_scale
        )
        _check_above(1.0 - 1e-12, headroom=self.headroom)


@dataclass(frozen=True, kw_only=True, eq=False)
class Peak:
    """Largest magnitude of a node in network units, its stage (0 to N - 1) and its network time.

    ``low`` and ``high`` are the smallest and the largest signed value over all stages and times.
    """

    value: float
    stage: int
    time: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Scaling:
    """Volts per network value and seconds per unit of network time.

    ``full_scale`` is V in volts, ``unit`` S by node: the value at full scale in network units.
    ``time`` is in seconds per unit of network time, ``bandwidth_margin`` is the resulting k,
    and ``peaks`` are the ranges of the probe run by node.
    """

    network: Network
    full_scale: float
    unit: Mapping[str, float]
    time: float
    bandwidth_margin: float
    peaks: Mapping[str, Peak]

    def volts(self, node: str, value):
        """Return the voltage of a node's value in network units; of any shape."""
        return value * (self.full_scale / self.unit[node])

    def value(self, node: str, volts):
        """Return the value of a node in network units from its voltage; of any shape."""
        return volts * (self.unit[node] / self.full_scale)

    def slower(self, times: float) -> Scaling:
        """Return the scaling with margin and time multiplied by ``times``."""
        return replace(self, time=self.time * times, bandwidth_margin=self.bandwidth_margin * times)

    def used(self, node: str) -> float:
        """Return the largest fraction of full scale that a node used in the probe run."""
        return self.peaks[node].value / self.unit[node]

    @property
    def tightest(self) -> str:
        """Node that uses the largest fraction of full scale."""
        return max(self.peaks, key=self.used)

    @property
    def loosest(self) -> str:
        """Node that uses the least of full scale: noise and offsets matter most there."""
        moving = [node for node in self.peaks if self.peaks[node].value > 0]
        return min(moving or self.peaks, key=self.used)

    def __str__(self) -> str:
        tight, loose = self.tightest, self.loosest
        peak = self.peaks[tight]
        return "\n".join(
            [
                f"full scale     {self.full_scale:g} V; one unit time constant is "
                f"{self.time:.3g} s",
                f"tightest node  {tight}: {self.used(tight):.0%} of full scale at stage "
                f"{peak.stage}, after {peak.time:.3g} of them",
                f"loosest node   {loose}: {self.used(loose):.1%} of full scale",
            ]
        )


@checked
def scale(network: Network, probe: ProbeRun, rules: ScalingRules | None = None) -> Scaling:
    """Scale a network by a probe run, by declared intervals, or by both.

    Raises `NetworkError` if an interval is empty or narrower than the range of the probe run, and
    `UnknownNameError` if an interval belongs to an unknown node.
    """
    rules = rules or ScalingRules()
    states, times = probe.states, probe.times
    values = values_over_time(network, times, states)
    names = list(network.node_index)
    peaks = {name: _peak(values[:, row], times) for row, name in enumerate(names)}
    peaks |= {
        name: _peak(node, times) for name, node in preconditioner_values(network, states).items()
    }
    peaks |= _declared(network, rules.intervals, peaks)
    return Scaling(
        network=network,
        full_scale=rules.full_scale,
        unit=_units(network, peaks, rules.headroom),
        time=time_unit(probe.radius, rules.gbw, rules.bandwidth_margin),
        bandwidth_margin=rules.bandwidth_margin,
        peaks={name: peak for name, peak in peaks.items() if name != ONE},
    )


def time_unit(radius: float, gbw: float, bandwidth_margin: float = MARGIN) -> float:
    """Return T = k radius / (2 pi GBW), the seconds per unit of network time.

    A fastest time constant of 1 has a ``radius`` of 1. The margin is k, and GBW is in Hz.
    """
    return bandwidth_margin * radius / (2 * math.pi * gbw)


def _check_above(low: float, **given: float) -> None:
    for name, value in given.items():
        if not (math.isfinite(value) and value > low):
            raise NetworkError(f"{name}: expected a number above {low:g}, got {value!r}")


def _peak(values: np.ndarray, times: np.ndarray) -> Peak:
    """Return the peak of one node from its values (T, N)."""
    sample, stage = np.unravel_index(np.abs(values).argmax(), values.shape)
    return Peak(
        value=float(np.abs(values[sample, stage])),
        stage=int(stage),
        time=float(times[sample]),
        low=float(values.min()),
        high=float(values.max()),
    )


def _declared(
    network: Network, intervals: Mapping[str, tuple[float, float]], peaks: Mapping[str, Peak]
) -> dict[str, Peak]:
    """Return the peaks of the declared intervals."""
    declared = {}
    for name, (low, high) in intervals.items():
        if name not in peaks or name == ONE:
            raise UnknownNameError.of("interval: node", name, [n for n in peaks if n != ONE])
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise NetworkError(f"interval of {name}: expected low < high, got {(low, high)!r}")
        scale = network.neuron(name).scale if name in network.neuron_index else Scale()
        low, high = sorted((scale.network(low), scale.network(high)))
        value = max(abs(low), abs(high))
        if value < peaks[name].value:
            reached = sorted((scale.user(peaks[name].low), scale.user(peaks[name].high)))
            raise NetworkError(
                f"interval of {name}: the probe run went from {reached[0]:.4g} to "
                f"{reached[1]:.4g}; declare a wider one"
            )
        declared[name] = Peak(value=value, stage=0, time=0.0, low=low, high=high)
    return declared


def _units(network: Network, peaks: Mapping[str, Peak], headroom: float) -> dict[str, float]:
    products = {block.name: block for block in network.cell.blocks if isinstance(block, Product)}
    largest = {name: peak.value for name, peak in peaks.items()}
    for q, t in network.cell.chains:  # their difference is what a residual is made of
        largest[q] = largest[t] = max(largest[q], largest[t])
    units: dict[str, float] = {}
    plain = plain_sums(network.cell)
    for name in network.node_index:  # what a block reads comes before it
        if name in products:
            units[name] = units[products[name].a] * units[products[name].b]
        elif name in plain:
            units[name] = float(plain[name].weight) * units[plain[name].source]
        else:
            units[name] = headroom * largest[name] or 1.0
    units[ONE] = 1.0
    return units | _preconditioner_units(network, units, peaks, headroom)


def _preconditioner_units(
    network: Network, units: Mapping[str, float], peaks: Mapping[str, Peak], headroom: float
) -> dict[str, float]:
    """Return the units of a preconditioner's nodes.

    The contents of an integrator may cancel in all net effects, so the integrator gets at least
    `QUIET` of the value that would move its neuron by full scale. The unit of a sum of cancelling
    terms limits its noise gain to `NOISE_GAIN`. Otherwise nodes that hardly move would get units
    that slow them down.
    """
    wiring = wiring_of(network)
    if wiring is None:
        return {}
    found = {n: headroom * peak.value for n, peak in peaks.items() if n not in units}
    response = responses(network)
    for name in found:
        if name.startswith(OWN):
            neuron = name.removeprefix(OWN)
            full = units[neuron] / response[network.neuron_index[neuron]].max()
            found[name] = max(found[name], QUIET * full)
    for adder in preconditioner_parts(wiring, network.stages):
        if adder.name in found:
            known = {**units, **found}
            arriving = sum(np.abs(wire.weight) * known[wire.source] for wire in adder.wires)
            found[adder.name] = max(found[adder.name], float(np.max(arriving)) / NOISE_GAIN)
    return found


def responses(network: Network) -> np.ndarray:
    """Return M_ii of all neurons (P, N); zero where a neuron is fixed or omitted."""
    response = np.zeros(network.live.shape)
    response[tuple(network.places.T)] = evaluator(network).preconditioner.diagonal()
    return response


def values_of_grid(
    nodes: Sequence[GridNode], scaling: Scaling, smallest: float
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the resistors (wires, N) in ohms and conductances (N,) in siemens of a grid by node.

    The smallest resistor has ``smallest`` ohms. Resistors are in the order of the part's wires; one
    between two nodes is listed with both.
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
    return resistors, {name: per_share * total for name, total in totals.items()}


def to_ground(conductance: np.ndarray, resistors: np.ndarray) -> np.ndarray:
    """Return the conductance (N,) to ground that a node lacks, in siemens.

    The value is negative if the resistors (wires, N) exceed the conductance (N,) of the node.
    """
    return np.where(conductance > 0, conductance - (1.0 / resistors).sum(axis=0), 0.0)


def begins(part: GridNode, wire: Wire, order: Sequence[str]) -> bool:
    """Return True if a resistor is listed with this part.

    Each resistor belongs to two nodes but is listed once, by the ``order`` of part names.
    """
    if wire.source.startswith(OWN) or wire.offset:
        return wire.offset >= 0
    return order.index(part.name) < order.index(wire.source)


def slopes_of(schematic: Schematic, scaling: Scaling, part: Generator) -> tuple[float, float]:
    """Return the signed values of one volt at the input and output of a generator."""
    return (
        schematic.sign(part.x) * scaling.unit[part.x] / scaling.full_scale,
        schematic.sign(part.name) * scaling.unit[part.name] / scaling.full_scale,
    )


def built_range(part: Generator, scaling: Scaling) -> tuple[float, float]:
    """Return the range of a function generator: probed range plus a quarter per side.

    The range stays in the domain and covers at most half of the remaining distance to an end of the
    domain.
    """
    peak = scaling.peaks[part.x]
    spare = 0.25 * max(peak.high - peak.low, 0.1 * peak.value, 1e-9)
    low, high = function_block(part.function).domain
    return (
        max(peak.low - spare, 0.5 * (peak.low + low)),
        min(peak.high + spare, 0.5 * (peak.high + high)),
    )
