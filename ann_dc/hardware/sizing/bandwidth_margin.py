r"""Selection of the smallest resistor and the bandwidth margin of a circuit.

Capacitances and currents determine both. Resistors are chosen first, see `resistors`. The margin
then compensates for capacitors that are still too small and for clamps that could not hold their
limits, at the expense of speed. If the emulation is unstable at a margin `SPARE` times smaller, the
margin is increased until the emulation is stable.

The clamp of a saturated neuron carries the current that would move the neuron. This current flows
through a resistor of 50 / (2 pi GBW C), the output resistance r of the clamp's op amp and a diode.
The op amp has to supply the voltage drop

.. math:: \Big(\frac{50}{2 \pi\, GBW} + r C\Big) \Big|\frac{dv}{dt}\Big| + 0.6\,V ,

where dv/dt is the suppressed slope. With a margin k all slopes are 1 / k as steep and capacitors k
times as large. A neuron that is pushed harder against its limit therefore needs a slower circuit.

For a resistive grid with rectifying multiplier neurons the eigenvalues are not sufficient. While a
constraint is inactive, the op amp of its multiplier neuron still moves and passes a fraction of the
constraint rate, smaller for faster op amps. The nodes of a grid divide by lambda, the smallest
eigenvalue of their stiffness relative to its diagonal, so Omega lambda has to be at least
`FOLLOWING`. In ngspice with macro models, long waves of the lander (N = 50, lambda = 2.8e-4) grow
at 0.022 and settle as predicted at 0.09.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.analysis.spectra import spectrum
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import CLAMP_DROP, CLAMP_LAG, Circuit, circuit_of
from ann_dc.hardware.circuit.loads import heaviest
from ann_dc.hardware.circuit.scaling import Scaling
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.clamps import has_second_pole
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts.board_models import op_amp_output_swing
from ann_dc.hardware.parts.datasheet import SMALLEST_RESISTOR
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.preconditioner_wiring import wiring_of
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.hardware.sizing.resistors import SHARE, fitting_resistor, two_digits
from ann_dc.network.cell import Limiter
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.validation import State, checked

GIVEN = 0.7
"""Largest used fraction of the output swing of a clamp's op amp; its gain drops beyond."""


@checked
def holding_margin(circuit: Circuit, level: Level, x: State, time: float = 0.0) -> float:
    """Return the smallest margin with which clamps hold at a state of the ideal network.

    The state ``x`` (n,) is the settled point of the ideal network, or a state at a network ``time``
    of its run, with the inputs of this time. The circuit may have any margin; its resistors are not
    changed. The result is zero if no neuron is saturated, and infinite if no margin is sufficient.
    """
    sheet, scaling = level.datasheet, circuit.scaling
    limited = circuit.schematic.limited
    if not (limited and level.emulated):
        return 0.0
    network, swing = circuit.schematic.network, op_amp_output_swing(sheet, level.full_scale)
    drives, least = evaluator(_unlimited(network.at_time(time))).drives(x), 0.0
    values = network.unpack(x)
    for part in limited:
        row, built = network.neuron_index[part.name], circuit.limiter(part)
        held = (values[row] <= built.low) | (values[row] >= built.high)
        slope = scaling.volts(part.name, np.abs(drives[row] / part.tau)) / scaling.time
        slope = float(slope[held & part.present].max(initial=0.0))
        farads = float(circuit.capacitors[part.name][part.present].max(initial=0.0))
        left = GIVEN * swing - CLAMP_DROP - sheet.rout * farads * slope
        across = CLAMP_LAG / (2 * math.pi * sheet.gbw) * slope
        if slope:
            least = max(least, scaling.bandwidth_margin * across / left if left > 0 else math.inf)
    return least


@checked
def check_clamps(circuit: Circuit, level: Level, least: float) -> None:
    """Raise `NetworkError` if the margin is below the `holding_margin` ``least`` of the clamps.

    The message names a sufficient margin.
    """
    bandwidth_margin = circuit.scaling.bandwidth_margin
    if least > bandwidth_margin * (1 + 1e-6):
        cure = (
            f"use a margin of {-two_digits(-least):.3g} or more (--bandwidth-margin)"
            if math.isfinite(least)
            else "use parts with a larger output swing"
        )
        swing = op_amp_output_swing(level.datasheet, level.full_scale)
        raise NetworkError(
            f"bandwidth_margin: {bandwidth_margin:.3g} is too small: the control bounds are too "
            f"strongly active for the op amps of the clamps with an output swing of {swing:.3g} "
            f"V; {cure}"
        )


def _unlimited(network: Network) -> Network:
    """Return the network without limits, for the net inputs of saturated neurons."""
    neurons = tuple(replace(n, limiter=Limiter()) for n in network.cell.neurons)
    return replace(network, cell=replace(network.cell, neurons=neurons))


HIGHEST = 1e4
"""Largest margin that is considered."""

HALVINGS = 7
"""Number of halvings of an octave up to the accuracy of the smallest margin, 0.54 %."""

SLOPE = 1 / 3
"""Typical increase of the smallest damping ratio per unit of log margin, near zero."""

FARTHEST = 4.0
"""Largest ratio of one tried margin to the one before."""

SPARE = 1.5
"""Factor on the smallest margin, for effects outside the pole model and for settling."""

TWO_DIGITS = np.outer(10.0 ** np.arange(-1, 3), np.arange(10, 100)).ravel()
"""All margins of two digits up to about `HIGHEST`."""

FOLLOWING = 0.08
"""Smallest Omega lambda of a grid with rectifying neurons; Omega in radians per network time."""


@checked
def is_stable(circuit: Circuit, level: Level, x: State) -> bool:
    """Return True if a circuit is stable at the state ``x`` (n,) of the ideal network.

    Raises `NetworkError` if the circuit has no emulation.
    """
    return _damping(circuit, level, x) > 0


@checked
def least_margin(circuit: Circuit, level: Level, x: State, *, progress: Progress = silent) -> float:
    """Return the smallest margin from 1 on with which a circuit is stable, to 1 %.

    The state ``x`` (n,) is the settled point of the ideal network. The circuit may have any margin;
    its resistors are not changed. Every tried margin is reported to ``progress``. The result is
    infinite if a margin of 10000 is not sufficient. Raises `NetworkError` if the circuit has no
    emulation.
    """
    search = _MarginSearch(circuit, level, x, progress)
    first = search.tried(1.0)
    return 1.0 if first.damping > 0 else search.first_stable(_margins(), first)


class _MarginSearch:
    """Search for the smallest margin of a circuit's resistors with which the circuit is stable.

    The smallest damping ratio of the poles increases with the logarithm of the margin. Near zero it
    is almost linear, unlike the spectral abscissa, which slow modes bound from below.
    """

    def __init__(self, circuit: Circuit, level: Level, x: State, progress: Progress) -> None:
        self.circuit, self.level, self.x, self.progress = circuit, level, x, progress
        radius = spectrum(circuit.schematic.network, x).radius
        self.unit_time = radius / (2 * np.pi * level.datasheet.usable_bandwidth)  # margin of one

    def tried(self, bandwidth_margin: float) -> _Tried:
        """Return a margin with the smallest damping ratio of the circuit."""
        self.progress(f"smallest margin: is {bandwidth_margin:.3g} enough?")
        slower = self.circuit.slower(bandwidth_margin * self.unit_time / self.circuit.scaling.time)
        return _Tried(bandwidth_margin, _damping(slower, self.level, self.x))

    def first_stable(self, margins: np.ndarray, unstable: _Tried) -> float:
        """Return the first stable one of increasing margins; infinite if there is none.

        The margin ``unstable`` is too small. The steps are those of the Illinois method: if an end
        of the bracket is kept twice, its damping ratio is halved.
        """
        stable, slope, side = None, SLOPE, 0
        low = (
            int(np.searchsorted(margins, unstable.bandwidth_margin * (1 + 1e-9))) - 1
        )  # up to rounding
        high = len(margins)
        while high - low > 1:
            at = int(np.searchsorted(margins, unstable.zero(slope)))
            at = max(low + 1, min(at, high - 1))
            tried = self.tried(float(margins[at]))
            if tried.damping > 0:
                unstable = unstable.halved() if side > 0 else unstable
                stable, high, side = tried, at, 1
                slope = unstable.slope(stable)
            else:
                stable = stable.halved() if stable and side < 0 else stable
                slope = tried.slope(stable or unstable)
                unstable, low, side = tried, at, -1
        return float(margins[high]) if stable else math.inf


@dataclass(frozen=True)
class _Tried:
    """Margin with the smallest damping ratio of the circuit's poles."""

    bandwidth_margin: float
    damping: float

    def halved(self) -> _Tried:
        """Return the margin with half the damping ratio."""
        return replace(self, damping=self.damping / 2)

    def slope(self, other: _Tried) -> float:
        """Return the damping ratio per unit of log margin between two margins."""
        return (other.damping - self.damping) / math.log(
            other.bandwidth_margin / self.bandwidth_margin
        )

    def zero(self, slope: float) -> float:
        """Return the margin, at most `FARTHEST` times as large, at which the ratio is zero."""
        further = -self.damping / slope if slope > 0 else math.inf
        return self.bandwidth_margin * math.exp(min(further, math.log(FARTHEST)))


def _margins() -> np.ndarray:
    """Return margins from 1 to `HIGHEST`, every octave halved `HALVINGS` times."""
    margins = 2.0 ** np.arange(math.floor(math.log2(HIGHEST)) + 1)
    for _ in range(HALVINGS):
        between = np.sqrt(margins[:-1] * margins[1:])
        margins = np.sort(np.concatenate([margins, between]))
    return margins


def _damping(circuit: Circuit, level: Level, x: State) -> float:
    """Return the smallest damping ratio of a circuit's poles; negative if one grows."""
    found = pole_spectrum(emulate(circuit, level), x).damping_ratio
    return -1.0 if math.isnan(found) else found


@checked
def following_margin(circuit: Circuit, level: Level) -> float:
    """Return the smallest margin at which idle multiplier neurons do not move a grid.

    The result is zero without a grid of several nodes or without rectifying multiplier neurons. The
    circuit may have any margin.
    """
    network, scaling = circuit.schematic.network, circuit.scaling
    wiring = wiring_of(network) if network.cell.inequality_duals else None
    if wiring is None or not wiring.passive or len(wiring.moved) == 1:
        return 0.0
    between = sparse.csr_array(wiring.weights)[wiring.moved][:, wiring.moved]
    paired = between.sign() * (between * between.T).power(0.5)
    stiffness = sparse.csc_array(sparse.eye_array(len(wiring.moved)) - paired)
    softest = scipy.sparse.linalg.eigsh(
        stiffness, k=1, sigma=0.0, v0=np.ones(len(wiring.moved)), return_eigenvectors=False
    )
    per_margin = (
        2 * np.pi * level.datasheet.usable_bandwidth * scaling.time / scaling.bandwidth_margin
    )
    return FOLLOWING / (per_margin * float(softest[0]))


@checked
def check_following(circuit: Circuit, level: Level) -> None:
    """Raise `NetworkError` if a grid would be unstable in spite of its eigenvalues.

    The circuit fails with less than half of the sufficient margin, which the message names.
    """
    wanted, bandwidth_margin = following_margin(circuit, level), circuit.scaling.bandwidth_margin
    if 2 * bandwidth_margin < wanted:
        kind = circuit.schematic.network.preconditioner.kind.value
        raise NetworkError(
            f"bandwidth_margin: {bandwidth_margin:.3g} is too small: op amps of inactive "
            f"rectifying multiplier neurons would disturb the slow modes of the {kind}; use a "
            f"margin of {-two_digits(-wanted):.3g} (--bandwidth-margin), or design the network "
            "with preconditioner=PreconditionerKind.CYCLIC_REDUCTION (--preconditioner "
            "cyclic-reduction)"
        )


@checked
def cure(circuit: Circuit, level: Level, x: State) -> str:
    """Return advice on how to stabilise a circuit, as a clause.

    The circuit is unstable as built, with its part errors. Advice on the margin assumes exact
    parts. The state ``x`` (n,) is the settled point of the ideal network. Raises `NetworkError` if
    the circuit has no emulation.
    """
    least, farads = least_margin(circuit, level, x), level.datasheet.parasitics.ground
    if least <= circuit.scaling.bandwidth_margin:
        return (
            f"exact parts do not oscillate from a margin of {_up(least)}: use parts with "
            "smaller tolerances, or raise the margin above "
            f"{circuit.scaling.bandwidth_margin:.3g}"
        )
    means = [f"raise the margin to {_up(least)} or more"] if math.isfinite(least) else []
    if farads and (smaller := _of_resistors(circuit, level, x)):
        means.append(f"{smaller}, for the {farads:.3g} F at every virtual ground")
    if not means and circuit.conductances:
        means = _of_lag(circuit, level, x)
    what = "op amps with less capacitance" if farads else "faster op amps"
    return ", or ".join(means) or f"no margin is sufficient; use {what}"


def _of_lag(circuit: Circuit, level: Level, x: State) -> list[str]:
    """Return advice on faster nodes of a resistive grid, or an empty list.

    A larger margin does not help, because the relative lag of the nodes does not depend on it.
    """
    faster = replace(circuit, lag=circuit.lag / 10)
    least = max(least_margin(faster, level, x), following_margin(circuit, level))
    if math.isinf(least):
        return []
    return [f"use a node_lag of one tenth with a margin of {_up(least)} or more"]


def _of_resistors(circuit: Circuit, level: Level, x: State) -> str:
    """Return advice on smaller resistors, or an empty string."""
    ohms = fitting_resistor(circuit, level)
    if ohms >= circuit.inverter:
        return ""
    built = circuit_of(circuit.schematic, circuit.scaling, smallest=ohms, lag=circuit.lag)
    least = least_margin(built, level, x)
    if math.isinf(least):
        return ""
    further = f" and a margin of {_up(least)} or more" * (least > circuit.scaling.bandwidth_margin)
    return f"use a smallest_resistor of {ohms:.3g} ohm{further}"


def _up(bandwidth_margin: float) -> str:
    """Return the next sufficient margin of two digits."""
    return f"{-two_digits(-bandwidth_margin):.3g}"


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Sizing:
    """Input of the sizing.

    The scaling may have any margin, and ``x`` (n,) is the settled state of the ideal network, or
    the end of its run if it does not settle; then no margin is sought for its stability, and
    clamps have to hold at all states (K, n) of ``run``, with the network times (K,). If
    the bandwidth ``bandwidth_margin`` is None, it is chosen and that of the scaling is the minimum.
    ``lag`` is that of the nodes of a resistive grid, in units of network time.
    """

    schematic: Schematic
    scaling: Scaling
    level: Level
    x: State
    run: tuple[np.ndarray, np.ndarray] | None = None
    bandwidth_margin: float | None = None
    lag: float = 0.0

    def holding_margin(self, circuit: Circuit) -> float:
        """Return the smallest margin with which the clamps of a circuit hold in the whole run."""
        states, times = ([self.x], [0.0]) if self.run is None else self.run
        moments = zip(states, times)
        return max(holding_margin(circuit, self.level, x, float(time)) for x, time in moments)


@checked
def sized_circuit(sizing: Sizing, *, progress: Progress = silent) -> Circuit:
    """Return a circuit whose smallest resistor and margin suit its parts.

    Prescribed values are used unchanged; the others are chosen. Parts without parasitics and
    without a smallest capacitor get `SMALLEST_RESISTOR` and the margin of the scaling. Tried
    margins, the choice and its cost are reported to ``progress``. Raises `NetworkError` if an op
    amp would exceed its output current, no margin makes the circuit stable, or the prescribed
    margin is too small.
    """
    level, given = sizing.level, sizing.level.smallest_resistor
    circuit, matters = _built(sizing, given or SMALLEST_RESISTOR), _matters(level)
    if given is None and matters:
        circuit = _built(sizing, fitting_resistor(circuit, level))
    if sizing.bandwidth_margin is None:
        circuit = _with_margin(circuit, sizing, progress)
    check_clamps(circuit, level, sizing.holding_margin(circuit))
    check_following(circuit, level)
    if matters:
        check_currents(circuit, level)
    if matters or circuit.scaling.bandwidth_margin > sizing.scaling.bandwidth_margin:
        _tell(circuit, sizing, progress)
    return circuit


def _matters(level: Level) -> bool:
    parts = level.datasheet.parasitics
    asked = level.smallest_capacitor or parts.ground or math.isfinite(parts.output_current)
    return bool(asked) or has_second_pole(level.datasheet)


def _built(sizing: Sizing, ohms: float) -> Circuit:
    return circuit_of(sizing.schematic, sizing.scaling, smallest=ohms, lag=sizing.lag)


def _with_margin(circuit: Circuit, sizing: Sizing, progress: Progress) -> Circuit:
    """Return the circuit with a sufficient margin.

    The margin raises the capacitors (unless resistors are prescribed), lets clamps hold and makes
    the circuit stable.
    """
    level, begun = sizing.level, circuit.scaling.bandwidth_margin
    wanted = max(begun, sizing.holding_margin(circuit))
    if wanted > begun:
        progress(f"control bounds are active: clamps need a margin of {wanted:.3g} on")
    wanted = max(wanted, following_margin(circuit, level))
    if level.smallest_resistor is None and level.smallest_capacitor:
        wanted = max(wanted, begun * level.smallest_capacitor / circuit.ranges[1][0])
    rings = level.datasheet.parasitics.ground or has_second_pole(level.datasheet)
    if level.emulated and rings and sizing.run is None:
        wanted = max(wanted, _spared(circuit, sizing, wanted, progress))
    if math.isinf(wanted):
        raise NetworkError(
            f"smallest_resistor: with {circuit.inverter:.3g} ohm and "
            f"{level.datasheet.parasitics.ground:.3g} F at every virtual ground no margin makes "
            f"the circuit stable; {cure(circuit, level, sizing.x)}"
        )
    return circuit if wanted == begun else circuit.slower(-two_digits(-wanted) / begun)


def _spared(circuit: Circuit, sizing: Sizing, wanted: float, progress: Progress) -> float:
    """Return the first margin, ``wanted`` or one of two digits, that is stable over `SPARE`."""
    level, x = sizing.level, sizing.x
    slower = wanted / circuit.scaling.bandwidth_margin / SPARE
    damping = _damping(circuit.slower(slower), level, x)
    if damping > 0:
        return wanted
    search = _MarginSearch(circuit, level, x, progress)
    tried = _Tried(slower * circuit.scaling.time / search.unit_time, damping)
    return SPARE * search.first_stable(TWO_DIGITS / SPARE, tried)


@checked
def check_currents(circuit: Circuit, level: Level) -> None:
    """Raise `NetworkError` if op amps would exceed their output current.

    The message names the op amp with the largest current and a sufficient resistor. The model level
    gives the output current.
    """
    limit, load = level.datasheet.parasitics.output_current, heaviest(circuit)
    if load.amperes <= SHARE * limit * (1 + 1e-9):
        return
    ohms = -two_digits(-circuit.inverter * load.amperes / (SHARE * limit))
    raise NetworkError(
        f"smallest_resistor: with {circuit.inverter:.3g} ohm the op amp of {load} has to supply "
        f"{load.amperes:.3g} A, and its part gives {SHARE:.0%} of {limit:.3g} A undistorted; "
        f"use {ohms:.3g} ohm or more, or a smaller full scale"
    )


def _tell(circuit: Circuit, sizing: Sizing, progress: Progress) -> None:
    """Report the chosen values, the slowdown, and the slowdown of a further increase."""
    wanted, smallest = sizing.level.smallest_capacitor, circuit.ranges[1][0]
    bandwidth_margin, begun = circuit.scaling.bandwidth_margin, sizing.scaling.bandwidth_margin
    reported = (
        f"resistors on the scale of {circuit.inverter:.3g} ohm, capacitors from {smallest:.2g} F, "
        f"margin {bandwidth_margin:.3g}"
    )
    if bandwidth_margin > begun:
        reported += f": {bandwidth_margin / begun:.3g} times slower than at margin {begun:.3g}"
    if smallest < wanted * (1 - 1e-9):
        times = wanted / smallest
        reported += (
            f"; for the {wanted:.2g} F of parasitic capacitance, use resistors {times:.3g} "
            "times smaller, or a margin as many times larger, which makes it as many times "
            "slower"
        )
    progress(reported)
