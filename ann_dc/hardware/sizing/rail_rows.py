r"""Saturation limits of coupled neurons as constraint rows with rectifying neurons.

At a limit the state derivatives are the projection v = M (d + lambda), with lambda the currents of
ideal diodes and M the preconditioner. A circuit has separate integrators D, z = z_0 + M D. The
current of a limit therefore acts on the net input of its neuron, D' = d + lambda; a stop of z alone
would let D drift. The rectifying multiplier neuron of the constraint s (z - rail) <= 0, with s = 1
for the upper and -1 for the lower limit, supplies this current:

.. math:: \lambda = -s\, m, \quad m = \max(0, y + w\, s\, (z - rail)), \qquad
    \tau\, \dot y = m - y .

It settles with z at the limit and m = s d, which is the equilibrium of the projection. During the
transient it is a proportional-integral controller of z. With w = omega / M_ii and tau = `SLOWER` /
omega, the crossover is at omega = `FASTER` times the fastest rate of the network. A larger omega
follows the projection more closely but makes the circuit slower, because its op amps have to be
faster.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.scaling import Scaling, responses
from ann_dc.hardware.schematic.elements import Integrator, PICell
from ann_dc.hardware.schematic.preconditioner_wiring import OWN
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.network.cell import ONE, Cell, Function, Limiter, Neuron, Role, Sum
from ann_dc.network.duals import InequalityDual
from ann_dc.network.ends import Omitted
from ann_dc.network.network import Network
from ann_dc.network.rewiring import wire
from ann_dc.network.selection import clamped_rows

FASTER = 4.0
"""Ratio of omega to the fastest rate of the network."""

SLOWER = 4.0
"""Product omega tau: ratio of the crossover to the corner of the integral part."""

BANDWIDTH = 2 * FASTER
"""Rate for op-amp sizing over the fastest rate: the loop of a constraint has several op amps."""

GAIN = 2.0
"""Largest sum of the input gains of a PI cell, whose bandwidth decreases with that sum."""

INTO = 1.0
"""Largest net input of a separate integrator in full scales per 1 / rate, for the same reason."""


def with_rail_rows(network: Network, scaling: Scaling, rate: float) -> Network:
    """Replace the saturation limits of coupled neurons by constraint rows.

    The preconditioner of the network couples neurons with limits; ``rate`` is the fastest rate of
    the network in units of 1 / network time. Limits beyond full scale are omitted, as for other
    neurons. The result starts with the currents of the projection at the start of the given
    network.
    """
    coupled = {network.cell.neurons[row].name: row for row in clamped_rows(network)}
    neurons = [
        replace(n, limiter=Limiter()) if n.name in coupled else n for n in network.cell.neurons
    ]
    free = replace(network, cell=replace(network.cell, neurons=tuple(neurons)))
    response, pushed = responses(network), _currents(network, free)
    at = network.unpack(network.start_state)
    cell, start, absent = free.cell, dict(network.start), list(network.omitted)
    for name, row in coupled.items():
        live = network.live[row]
        w = FASTER * rate / np.where(live, response[row], 1.0)
        for word, side, rail in _limits(network.cell.neurons[row], scaling):
            diode = _diode(f"{word}.{name}")
            cell = _with_row(cell, diode, name, (side, rail), w, SLOWER / FASTER / rate)
            held = side * (at[row] - rail) >= 0  # elsewhere a current is a rounding error
            start[diode.neuron] = np.where(held, np.maximum(-side * pushed[row], 0.0), 0.0)
            absent += [Omitted(neuron=diode.neuron, stage=int(k)) for k in np.flatnonzero(~live)]
    return replace(free, cell=cell, start=start, omitted=tuple(absent))


def _limits(neuron: Neuron, scaling: Scaling) -> Iterator[tuple[str, float, float]]:
    """Return name, side and value of the limits within full scale."""
    for word, side in (("low", -1.0), ("high", 1.0)):
        rail = getattr(neuron.limiter, word)
        if abs(rail) <= scaling.unit[neuron.name]:
            yield word, side, rail


def _diode(place: str) -> InequalityDual:
    return InequalityDual(
        neuron=f"z_{place}", residual=f"g_{place}", sum=f"s_{place}", multiplier=f"zeta_{place}"
    )


def _currents(network: Network, free: Network) -> np.ndarray:
    """Return lambda (P, N) at the start; ``free`` is the network without the limits."""
    x = network.start_state
    drives = network.pack(evaluator(free).drives(x))
    moves = evaluator(network).rhs(x)
    return network.unpack(network.preconditioner.inverse(network.layout)(moves) - drives)


def _with_row(
    cell: Cell,
    diode: InequalityDual,
    neuron: str,
    rail: tuple[float, float],
    w: np.ndarray,
    tau: float,
) -> Cell:
    """Add the rectifying multiplier neuron of one limit, (side, value), to a cell."""
    side, value = rail
    ends = (
        wire(neuron, diode.residual, side),
        wire(ONE, diode.residual, -side * value),
        wire(diode.neuron, diode.sum),
        wire(diode.residual, diode.sum, w),
        wire(diode.multiplier, diode.neuron),
        wire(diode.neuron, diode.neuron, -1.0),
        wire(diode.multiplier, neuron, -side),
    )
    blocks = (
        Sum(name=diode.residual),
        Sum(name=diode.sum),
        Function(name=diode.multiplier, function="rectify", x=diode.sum),
    )
    return replace(
        cell,
        neurons=(*cell.neurons, Neuron(name=diode.neuron, tau=tau, role=Role.DUAL)),
        blocks=(*cell.blocks, *blocks),
        connections=(*cell.connections, *(end for end in ends if np.any(end.weight))),
        inequality_duals=(*cell.inequality_duals, diode),
    )


def intervals_of_inputs(
    schematic: Schematic, scaling: Scaling, rate: float, headroom: float
) -> dict[str, tuple[float, float]]:
    """Return wider intervals of PI cells and integrators that avoid slow inputs.

    The bandwidth of an amplifier decreases with the signal at its virtual ground, in full scales of
    the amplifier. With these intervals that signal is at most `GAIN` for a PI cell and `INTO` for a
    separate integrator. Op amps are sized for ``rate`` in units of 1 / network time, and
    ``headroom`` is the ratio of full scale to the ends of an interval. The result is an argument of
    `ScalingRules` and contains only intervals that are wider than the probe run requires. PI cells
    of a large penalty have large gains and get larger units.
    """
    units, found = dict(scaling.unit), dict[str, tuple[float, float]]()
    for part in sorted(schematic.parts, key=lambda part: isinstance(part, Integrator)):
        if isinstance(part, PICell):
            times, most = part.rho, GAIN
        elif part.name.startswith(OWN) and isinstance(part, Integrator):
            times, most = 1.0, INTO * rate
        else:
            continue
        arriving = [np.abs(wire.weight) * times * units[wire.source] for wire in part.wires]
        unit = float(np.sum(arriving, axis=0).max()) / most
        if unit > units[part.name]:
            units[part.name] = unit
            found[part.name] = -unit / headroom, unit / headroom
    return found
