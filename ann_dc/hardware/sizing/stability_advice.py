"""What would keep a circuit from ringing: a larger margin, or smaller resistors, in words."""

from __future__ import annotations

import math
from dataclasses import replace

from ann_dc.hardware.circuit.circuit import Circuit, circuit_of
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.sizing.margins import following_margin, least_margin
from ann_dc.hardware.sizing.resistors import fitting_resistor, two_digits
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State


@checked
def cure(circuit: Circuit, level: Level, x: State) -> str:
    """What would keep a circuit from ringing, in a clause.

    Parameters
    ----------
    circuit : Circuit
        Which is unstable as it is built; a margin is told for exact parts.
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network where it settles.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.
    """
    least, farads = least_margin(circuit, level, x), level.datasheet.parasitics.ground
    if least <= circuit.scaling.margin:
        return (
            f"exact parts would not ring from a margin of {_up(least)} on: take closer ones, or "
            f"raise the margin above {circuit.scaling.margin:.3g}"
        )
    means = [f"raise the margin to {_up(least)} or more"] if math.isfinite(least) else []
    if farads and (smaller := _of_resistors(circuit, level, x)):
        means.append(f"{smaller}, for the {farads:.3g} F at every virtual ground")
    if not means and circuit.conductances:
        means = _of_lag(circuit, level, x)
    what = "op amps with less capacitance" if farads else "faster op amps"
    return ", or ".join(means) or f"no margin cures that; take {what}"


def _of_lag(circuit: Circuit, level: Level, x: State) -> list[str]:
    """Return what faster nodes of a grid do, or nothing: no margin changes their share."""
    faster = replace(circuit, lag=circuit.lag / 10)
    least = max(least_margin(faster, level, x), following_margin(circuit, level))
    if math.isinf(least):
        return []
    return [f"take a node_lag a tenth as large with a margin of {_up(least)} or more"]


def _of_resistors(circuit: Circuit, level: Level, x: State) -> str:
    """What smaller resistors do, or nothing."""
    ohms = fitting_resistor(circuit, level)
    if ohms >= circuit.inverter:
        return ""
    built = circuit_of(circuit.schematic, circuit.scaling, smallest=ohms, lag=circuit.lag)
    least = least_margin(built, level, x)
    if math.isinf(least):
        return ""
    further = f" and a margin of {_up(least)} or more" * (least > circuit.scaling.margin)
    return f"take a smallest_resistor of {ohms:.3g} ohm{further}"


def _up(margin: float) -> str:
    """The next margin of two digits, which is enough."""
    return f"{-two_digits(-margin):.3g}"
