"""Margins at which a circuit does not ring: the eigenvalues of its emulation decide.

Of a grid with diode neurons they do not suffice. While a row presses nothing, the op amp of its
diode neuron moves all the same, which lets a share of the row's rate through, the smaller the
faster op amps are. The nodes of a grid divide by lambda, the smallest eigenvalue of their stiffness
over its diagonal, so that Omega lambda has to be `FOLLOWING` or more. In ngspice, macro models,
long waves of the lander (N = 50, lambda = 2.8e-4) grow at 0.022 and settle as predicted at 0.09.

What would keep a circuit from ringing: a larger margin, or smaller resistors, in words.

The smallest resistor and the margin of a circuit, from capacitances and currents.

Resistors come first, see `resistors`. What is then missing in the capacitors the margin has to make
up for, at the expense of speed, and what clamps could not hold; and where the emulation rings at a
margin `SPARE` times smaller, it grows until it does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.analysis.spectra import spectrum
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit, circuit_of
from ann_dc.hardware.circuit.loads import heaviest
from ann_dc.hardware.circuit.scaling import Scaling
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.clamps import FAST
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts.datasheet import SMALLEST_RESISTOR
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.metric_wiring import wiring_of
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.hardware.sizing.clamps import check_clamps, holding_margin
from ann_dc.hardware.sizing.resistors import SHARE, fitting_resistor, two_digits
from ann_dc.progress import Progress, silent
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State

HIGHEST = 1e4
"""Margins above that are none."""

SPARE = 1.5
"""Margin over the smallest one: what a pole model does not know, and time to settle."""

FOLLOWING = 0.08
"""Omega lambda of a grid with diode neurons, at least; Omega in radians per network time."""


@checked
def is_stable(circuit: Circuit, level: Level, x: State) -> bool:
    """Whether a circuit comes to rest where the ideal network stands.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.
    """
    return pole_spectrum(emulate(circuit, level), x).abscissa < 0


@checked
def least_margin(circuit: Circuit, level: Level, x: State, *, progress: Progress = silent) -> float:
    """The smallest margin from 1 on with which a circuit is stable, to 1 %.

    Parameters
    ----------
    circuit : Circuit
        Of any margin; its resistors are kept.
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network where it settles.
    progress : Progress
        Told every margin that is tried.

    Returns
    -------
    float
        Infinite if not even 10000 is enough.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.
    """
    radius = spectrum(circuit.schematic.network, x).radius
    wanted = radius / (2 * np.pi * level.datasheet.usable_bandwidth)  # time at a margin of one

    def stable(margin: float) -> bool:
        progress(f"smallest margin: is {margin:.3g} enough?")
        return is_stable(circuit.slower(margin * wanted / circuit.scaling.time), level, x)

    low, high = 1.0, 1.0
    while not stable(high):
        low, high = high, 2 * high
        if high > HIGHEST:
            return float("inf")
    while high > 1.01 * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if stable(middle) else (middle, high)
    return high


@checked
def following_margin(circuit: Circuit, level: Level) -> float:
    """Return the smallest margin at which idle diode neurons do not move a grid.

    Parameters
    ----------
    circuit : Circuit
        Of any margin.
    level : Level
        Speed of its parts.

    Returns
    -------
    float
        Zero without a grid of several nodes, and without diode neurons.
    """
    network, scaling = circuit.schematic.network, circuit.scaling
    wiring = wiring_of(network) if network.cell.diodes else None
    if wiring is None or not wiring.passive or len(wiring.moved) == 1:
        return 0.0
    between = sparse.csr_array(wiring.weights)[wiring.moved][:, wiring.moved]
    paired = between.sign() * (between * between.T).power(0.5)
    stiffness = sparse.csc_array(sparse.eye_array(len(wiring.moved)) - paired)
    softest = scipy.sparse.linalg.eigsh(
        stiffness, k=1, sigma=0.0, v0=np.ones(len(wiring.moved)), return_eigenvectors=False
    )
    per_margin = 2 * np.pi * level.datasheet.usable_bandwidth * scaling.time / scaling.margin
    return FOLLOWING / (per_margin * float(softest[0]))


@checked
def check_following(circuit: Circuit, level: Level) -> None:
    """Refuse a circuit whose grid would repel, although its eigenvalues do not say so.

    Parameters
    ----------
    circuit : Circuit
    level : Level

    Raises
    ------
    NetworkError
        With the margin that is enough, if the circuit has less than half of it.
    """
    wanted, margin = following_margin(circuit, level), circuit.scaling.margin
    if 2 * margin < wanted:
        raise NetworkError(
            f"margin: {margin:.3g} is too small: op amps of idle diode neurons would move the "
            f"soft long waves of the {circuit.schematic.network.metric.kind.value}; take a margin "
            f"of {-two_digits(-wanted):.3g} (ann-dc circuit --margin), or design the network with "
            "kinds=[Kind.TREE] (--metric tree)"
        )


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
