r"""Margins at which clamps hold what presses neurons against their rails.

A clamp that holds a neuron carries the current that would move it. Its op amp has to give what that
drops across a resistor of 50 / (2 pi GBW C) and its own output resistance, and the drop of a diode:

.. math:: \Big(\frac{50}{2 \pi\, GBW} + r C\Big) \Big|\frac{dv}{dt}\Big| + 0.6\,V ,

dv/dt being the slope that is cut off. With a margin k all slopes are 1 / k as steep, and capacitors
k times as large: the more a neuron is pressed, the slower its circuit has to be.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import CLAMP_DROP, CLAMP_LAG, Circuit
from ann_dc.hardware.parts.board_models import macro_parameters
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import Integrator
from ann_dc.hardware.sizing.resistors import two_digits
from ann_dc.hints.checked import checked
from ann_dc.hints.values import State
from ann_dc.network.cell import Limiter
from ann_dc.network.network import Network

GIVEN = 0.7
"""Of the rails of its op amp that a clamp gives at most; beyond, its gain ends."""

MOST = 200
"""States of a way that are looked at."""


@checked
def holding_margin(circuit: Circuit, level: Level, x: State) -> float:
    """The smallest margin with which the clamps of a circuit hold where the ideal network stands.

    Parameters
    ----------
    circuit : Circuit
        Of any margin; its resistors are kept.
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network where it settles.

    Returns
    -------
    float
        Zero where nothing presses, infinite if no margin is enough.
    """
    return _margin(circuit, level, x[None], GIVEN)


@checked
def lost_on_the_way(circuit: Circuit, level: Level, states: np.ndarray) -> str:
    """That clamps let neurons past their rails on the way, in a clause; empty where they hold.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        What its parts are like.
    states : (T, n) array
        Of the ideal network on its way; `MOST` of them are looked at.

    Returns
    -------
    str
    """
    least = _margin(circuit, level, states[:: -(-len(states) // MOST)], 1.0)
    if least <= circuit.scaling.margin:
        return ""
    cure = f"a margin of {-two_digits(-least):.3g}" if math.isfinite(least) else "parts with more"
    return (
        "on their way neurons are pressed against bounds harder than the op amps of clamps, with "
        f"rails of {_rails(level):.3g} V, can hold: take {cure}"
    )


def _margin(circuit: Circuit, level: Level, states: np.ndarray, share: float) -> float:
    """The smallest margin with which clamps give up to a share of their rails at some states."""
    if not level.emulated:
        return 0.0
    sheet, margin, least = level.datasheet, circuit.scaling.margin, 0.0
    for slope, farads in _pressed(circuit, states):
        left = share * _rails(level) - CLAMP_DROP - sheet.rout * farads * slope
        across = CLAMP_LAG / (2 * math.pi * sheet.gbw) * slope
        if slope:
            least = max(least, margin * across / left if left > 0 else math.inf)
    return least


def _pressed(circuit: Circuit, states: np.ndarray) -> Iterator[tuple[float, float]]:
    """Of every integrator with rails: steepest slope that they cut off, in V/s, and its farads."""
    scaling, network = circuit.scaling, circuit.schematic.network
    railed = [p for p in circuit.schematic.parts if isinstance(p, Integrator) and p.railed]
    if not railed:
        return
    free = evaluator(_unlimited(network))
    for part in railed:
        row, built, slope = network.neuron_index[part.name], circuit.limiter(part), 0.0
        for x in states:
            values, drives = network.unpack(x)[row], free.drives(x)[row]
            outwards = np.where(
                values >= built.high, drives, np.where(values <= built.low, -drives, 0)
            )
            there = scaling.volts(part.name, outwards / part.tau) / scaling.time
            slope = max(slope, float(there[part.present].max(initial=0.0)))
        yield slope, float(circuit.capacitors[part.name][part.present].max(initial=0.0))


@checked
def check_clamps(circuit: Circuit, level: Level, x: State) -> None:
    """Refuse a circuit whose clamps would not hold where the ideal network stands.

    Parameters
    ----------
    circuit : Circuit
    level : Level
    x : (n,) array
        State vector of the ideal network where it settles.

    Raises
    ------
    NetworkError
        With the margin that would do.
    """
    least, margin = holding_margin(circuit, level, x), circuit.scaling.margin
    if least > margin * (1 + 1e-6):
        cure = (
            f"take a margin of {-two_digits(-least):.3g} or more (ann-dc circuit --margin)"
            if math.isfinite(least)
            else "take parts with more"
        )
        raise NetworkError(
            f"margin: {margin:.3g} is too small: neurons are pressed against their bounds harder "
            f"than the op amps of clamps, with rails of {_rails(level):.3g} V, can hold; {cure}"
        )


def _rails(level: Level) -> float:
    """Volts between which the op amps of a netlist stay; those of endless ones, too, are finite."""
    return macro_parameters(level.datasheet, level.full_scale)["opamp_vsat"]


def _unlimited(network: Network) -> Network:
    """Without rails: what arrives at neurons that stand at theirs."""
    neurons = tuple(replace(n, limiter=Limiter()) for n in network.cell.neurons)
    return replace(network, cell=replace(network.cell, neurons=neurons))
