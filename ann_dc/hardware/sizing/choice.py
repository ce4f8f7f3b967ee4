"""The smallest resistor and the margin of a circuit, from capacitances and currents.

Resistors come first, see `resistors`. What is then missing in the capacitors the margin has to make
up for, at the expense of speed, and what clamps could not hold; and where the emulation rings at a
margin `SPARE` times smaller, it grows until it does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit, circuit_of
from ann_dc.hardware.circuit.loads import heaviest
from ann_dc.hardware.circuit.scaling import Scaling
from ann_dc.hardware.emulation.grounds import FAST
from ann_dc.hardware.parts.datasheet import SMALLEST_RESISTOR
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.hardware.sizing.clamps import check_clamps, holding_margin
from ann_dc.hardware.sizing.margins import (
    SPARE,
    check_following,
    following_margin,
    is_stable,
    least_margin,
)
from ann_dc.hardware.sizing.resistors import SHARE, fitting_resistor, two_digits
from ann_dc.hardware.sizing.stability_advice import cure
from ann_dc.progress import Progress, silent
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Sizing:
    """What is to be sized, and what is given.

    Attributes
    ----------
    schematic : Schematic
    scaling : Scaling
        At any margin.
    level : Level
    x : (n,) array
        State vector of the ideal network where it settles.
    margin : float or None
        None where it may be chosen; then the scaling's is the smallest.
    lag : float
        Of a grid's nodes, in units of network time.
    """

    schematic: Schematic
    scaling: Scaling
    level: Level
    x: State
    margin: float | None = None
    lag: float = 0.0


@checked
def sized_circuit(sizing: Sizing, *, progress: Progress = silent) -> Circuit:
    """A circuit whose smallest resistor and margin suit its parts.

    What is given is obeyed; the rest is chosen. Where parts have neither parasitics nor a smallest
    capacitor, that is `SMALLEST_RESISTOR` and the scaling's own margin.

    Parameters
    ----------
    sizing : Sizing
    progress : Progress
        Told the margins that are tried, what was chosen, and what it costs.

    Returns
    -------
    Circuit

    Raises
    ------
    NetworkError
        If an op amp has to give more than it can, no margin makes the circuit stable, or the given
        one is too small.
    """
    level, given = sizing.level, sizing.level.smallest_resistor
    circuit, matters = _built(sizing, given or SMALLEST_RESISTOR), _matters(level)
    if given is None and matters:
        circuit = _built(sizing, fitting_resistor(circuit, level))
    if sizing.margin is None:
        circuit = _with_margin(circuit, sizing, progress)
    check_clamps(circuit, level, sizing.x)
    check_following(circuit, level)
    if matters:
        check_currents(circuit, level)
    if matters or circuit.scaling.margin > sizing.scaling.margin:
        _tell(circuit, sizing, progress)
    return circuit


def _matters(level: Level) -> bool:
    parts = level.datasheet.parasitics
    asked = level.smallest_capacitor or parts.ground or math.isfinite(parts.output_current)
    return bool(asked) or _second_pole(level)


def _second_pole(level: Level) -> bool:
    return level.datasheet.parasitics.second_pole < FAST * level.datasheet.gbw


def _built(sizing: Sizing, ohms: float) -> Circuit:
    return circuit_of(sizing.schematic, sizing.scaling, smallest=ohms, lag=sizing.lag)


def _with_margin(circuit: Circuit, sizing: Sizing, progress: Progress) -> Circuit:
    """With a margin that lifts capacitors, unless resistors are given, holds, and does not ring."""
    level, begun = sizing.level, circuit.scaling.margin
    wanted = max(begun, holding_margin(circuit, level, sizing.x))
    if wanted > begun:
        progress(
            f"neurons are pressed against bounds: clamps hold from a margin of {wanted:.3g} on"
        )
    wanted = max(wanted, following_margin(circuit, level))
    if level.smallest_resistor is None and level.smallest_capacitor:
        wanted = max(wanted, begun * level.smallest_capacitor / circuit.ranges[1][0])
    rings = level.datasheet.parasitics.ground or _second_pole(level)
    if level.emulated and rings:
        spared = circuit.slower(wanted / begun / SPARE)
        if not is_stable(spared, level, sizing.x):
            least = least_margin(circuit, level, sizing.x, progress=progress)
            wanted = max(wanted, SPARE * least)
    if math.isinf(wanted):
        raise NetworkError(
            f"smallest_resistor: with {circuit.inverter:.3g} ohm and "
            f"{level.datasheet.parasitics.ground:.3g} F at every virtual ground no margin makes "
            f"the circuit stable; {cure(circuit, level, sizing.x)}"
        )
    return circuit if wanted == begun else circuit.slower(-two_digits(-wanted) / begun)


@checked
def check_currents(circuit: Circuit, level: Level) -> None:
    """Refuse a circuit whose op amps have to give more than they can.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        With the output current of its op amps.

    Raises
    ------
    NetworkError
        With the op amp that has to give most, and the resistor that would do.
    """
    limit, load = level.datasheet.parasitics.output_current, heaviest(circuit)
    if load.amperes <= SHARE * limit * (1 + 1e-9):
        return
    ohms = -two_digits(-circuit.inverter * load.amperes / (SHARE * limit))
    raise NetworkError(
        f"smallest_resistor: with {circuit.inverter:.3g} ohm the op amp of {load} has to give "
        f"{load.amperes:.3g} A, and its part gives {SHARE:.0%} of {limit:.3g} A undistorted; "
        f"take {ohms:.3g} ohm or more, or a smaller full scale"
    )


def _tell(circuit: Circuit, sizing: Sizing, progress: Progress) -> None:
    """What was chosen; what it costs, or what more it would cost."""
    wanted, smallest = sizing.level.smallest_capacitor, circuit.ranges[1][0]
    margin, begun = circuit.scaling.margin, sizing.scaling.margin
    told = (
        f"resistors on the scale of {circuit.inverter:.3g} ohm, capacitors from {smallest:.2g} F, "
        f"margin {margin:.3g}"
    )
    if margin > begun:
        told += f": {margin / begun:.3g} times slower than at margin {begun:.3g}"
    if smallest < wanted * (1 - 1e-9):
        times = wanted / smallest
        told += (
            f"; for the {wanted:.2g} F that strays ask for, take resistors {times:.3g} times "
            "smaller, or a margin as many times larger, which makes it as many times slower"
        )
    progress(told)
